"""A result as the files of a simulator."""
