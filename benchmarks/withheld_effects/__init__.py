"""Blind benchmark of the diagnosis: true robots with withheld effects, and their scorer."""
