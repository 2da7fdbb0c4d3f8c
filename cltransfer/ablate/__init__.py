"""Ablations: a table of overrides, each row run on the same cases, and what the rows differ by."""
