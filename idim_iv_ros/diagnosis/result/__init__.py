"""What a diagnosis found: the document gap.json and what it consists of."""
