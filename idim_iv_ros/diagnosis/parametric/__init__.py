"""Parametric causes: parameter errors of the nominal model."""
