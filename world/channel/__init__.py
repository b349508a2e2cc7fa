"""The radio channel between robots: a module for each stage of it."""
