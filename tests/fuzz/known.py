"""Inputs that are still answered wrongly, and why; each must fail, or it has to go from here."""

KNOWN: dict[str, str] = {}
