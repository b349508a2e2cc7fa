"""Intervals and tests, for results that can be published."""
