"""Small recordings that the project made itself, and how."""
