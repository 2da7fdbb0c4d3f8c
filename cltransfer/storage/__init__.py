"""Files in and out: whole or not there, capped before they are read."""
