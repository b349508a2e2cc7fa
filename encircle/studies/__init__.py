"""Studies: a grid of hunts with common seeds, a table of measures, statistics and a report."""
