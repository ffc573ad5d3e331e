"""Paths round singular loci: planned, checked, and followed."""
