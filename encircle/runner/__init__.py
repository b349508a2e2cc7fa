"""Hunts that are run: in memory, or as processes over Zenoh."""
