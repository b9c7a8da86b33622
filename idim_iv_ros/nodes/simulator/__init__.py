"""The node that simulates a robot in real time."""
