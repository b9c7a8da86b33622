"""ROS 2 nodes: parameters, topics and services here, the work in plain functions elsewhere."""
