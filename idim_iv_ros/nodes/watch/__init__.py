"""A live view of what the nodes say, on the terminal."""
