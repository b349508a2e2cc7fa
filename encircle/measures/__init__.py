"""Numbers that say how a hunt went, a module for each subject."""
