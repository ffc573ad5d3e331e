"""Offline questions about scenes, paths and recordings: before and after a run."""
