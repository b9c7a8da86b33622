"""Recordings: bags and tables in, immutable signals on a uniform grid out."""
