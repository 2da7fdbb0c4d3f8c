"""Stress: what a method is given is made worse in one way, step by step, until it fails. One module a family."""
