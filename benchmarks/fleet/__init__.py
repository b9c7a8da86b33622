"""A simulated fleet with a known truth, and what the statistics of a fleet make of it."""
