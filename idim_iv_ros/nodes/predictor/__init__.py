"""The node `predictor`."""
