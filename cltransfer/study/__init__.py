"""Preference studies: a blinded two-choice page that works from disk, and the analysis of what people answered."""
