"""Proofs about a singular set: imported by nobody but its command."""
