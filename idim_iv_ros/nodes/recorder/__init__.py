"""The node that writes the topics of a robot into bags."""
