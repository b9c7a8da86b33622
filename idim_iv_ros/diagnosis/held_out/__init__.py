"""Gaps on data that was not used to fit."""
