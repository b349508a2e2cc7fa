"""``encircle doctor``: checks of this machine and of a run's network, each with advice."""
