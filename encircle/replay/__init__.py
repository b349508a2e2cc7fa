"""Recordings fed to fresh brains, and compared."""
