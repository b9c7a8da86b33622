"""Tests of the catalogue of effects."""
