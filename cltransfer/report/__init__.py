"""What a run leaves for people to look at: tables, side-by-side frames and one page."""
