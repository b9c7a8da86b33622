"""A live view of what the nodes say: on the terminal, or as a page on this machine."""
