"""Elasticity, play and time offset, measured by encoders behind the gears."""
