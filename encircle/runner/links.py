"""The ways in which a hunt is run."""

LINKS = ("zenoh", "memory")
"""One process per robot and one for the world, over Zenoh; or all of it in one process."""
