"""The node that identifies and diagnoses on request."""
