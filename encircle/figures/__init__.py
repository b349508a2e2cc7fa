"""Figures of one recorded run: trajectories, snapshots, execution times."""
