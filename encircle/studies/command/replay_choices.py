"""Of which runs a study's report shows replays, as the command line says it."""

from encircle.extras import needing

FEW, ALL, NONE = REPLAYS = ("few", "all", "none")
"""Of the two cells that differ most, of every cell, or of none."""


def check_pages() -> None:
    """``MissingExtra`` if pages of replays cannot be written here."""
    with needing("a replay in the report", "viewer"):
        import bokeh  # noqa: F401
