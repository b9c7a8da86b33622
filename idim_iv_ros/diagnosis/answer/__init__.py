"""From what the comparison selects to causes with numbers, evidence and sentences."""
