"""Singularity-aware visual servoing on straight lines."""
