"""Scenarios from files: read, overridden, refused where they contradict themselves, remarked on."""
