"""Ways round singular loci: planned, judged, and followed."""
