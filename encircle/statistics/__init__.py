"""Confidence intervals and tests for paired runs: pure functions on arrays."""
