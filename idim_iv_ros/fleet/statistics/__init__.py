"""Statistics of a fleet: comparison of many bags of many robots."""
