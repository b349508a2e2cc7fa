"""A run on disk: written, read back, and taken up again."""
