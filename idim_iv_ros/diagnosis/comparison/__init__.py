"""One comparison of numbers and physics: rows, candidates, evidence, selection."""
