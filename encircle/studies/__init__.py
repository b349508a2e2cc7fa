"""Studies: grids of hunts with common seeds, their tables, statistics, figures and reports."""
