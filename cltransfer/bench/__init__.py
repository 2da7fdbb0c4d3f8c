"""Scenes, shots and baselines that need no data: what the project measures itself with."""
