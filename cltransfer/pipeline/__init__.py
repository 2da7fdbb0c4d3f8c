"""The graph that a config builds: components, what of them is needed, running them, from terms to a total."""
