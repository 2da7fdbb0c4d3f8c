"""Reading and writing clips: which part of a file, whom in it, made fit to be read."""
