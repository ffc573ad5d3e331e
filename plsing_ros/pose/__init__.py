"""Camera pose from lines, and what singularities do to it."""
