"""Identification of a robot from its recordings."""
