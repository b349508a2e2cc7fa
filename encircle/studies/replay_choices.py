"""Of which runs a study's report shows replays, as the command line says it."""

FEW, ALL, NONE = REPLAYS = ("few", "all", "none")
"""Of the two cells that differ most, of every cell, or of none."""
