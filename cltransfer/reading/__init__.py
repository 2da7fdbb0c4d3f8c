"""What a run is measured against: clips, scenes with a path and feature files, read once and cleaned."""
