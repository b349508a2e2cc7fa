"""``encircle check-policy``: whether a policy keeps to what the interface asks of it."""
