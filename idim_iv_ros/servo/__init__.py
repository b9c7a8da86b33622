"""Robots without a torque signal: servos identified from commands and positions."""
