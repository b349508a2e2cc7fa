"""``encircle doctor``: what is wrong with this machine, a network, or a run."""
