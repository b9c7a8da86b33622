"""The gap between simulator and robot: where it lies, what causes it, how far it shrinks."""
