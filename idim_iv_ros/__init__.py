"""Identification of robot dynamics from ROS 2 recordings."""
