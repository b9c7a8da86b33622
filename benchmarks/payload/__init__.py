"""Payloads, missing parts and other parameter errors beside friction that the model lacks."""
