"""Recorded commands against the control law of the configuration."""
