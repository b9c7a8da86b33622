"""Simulated robots that are recorded like real ones."""
