"""The parts of a transfer's story, and the folder that it leaves."""
