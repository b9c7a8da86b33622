"""Writing bags, at once or while a robot runs."""
