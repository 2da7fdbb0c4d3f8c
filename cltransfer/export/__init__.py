"""Camera files for other programs."""
