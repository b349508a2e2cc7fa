"""Where to go: a module for each group of the paper's equations."""
