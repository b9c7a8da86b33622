"""Structural causes: effects that the nominal model does not have."""
