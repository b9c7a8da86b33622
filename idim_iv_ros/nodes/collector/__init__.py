"""The node that moves a robot, records it and has the recording identified."""
