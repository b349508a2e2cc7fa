"""What happened in a run, tick by tick: what robots believed, and the ground truth."""
