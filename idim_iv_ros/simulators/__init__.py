"""Simulated robots that that are recorded like real ones."""
