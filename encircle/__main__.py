"""``python -m encircle`` is ``encircle``."""

from encircle.cli import main

main()
