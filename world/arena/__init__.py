"""Physics: bodies, sight, starts and capture. Pure functions of the arena's state."""
