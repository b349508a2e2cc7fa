"""Libraries that are not Python raise an error of one kind for all that goes wrong: told apart."""

from collections.abc import Iterator
from contextlib import contextmanager

WRITE_FAILURES = ("I/O error", "os error", "File-writer")
"""What the libraries' words have in them if a file could not be written."""


@contextmanager
def write_failures() -> Iterator[None]:
    """Raise ``OSError`` where a library raises ``RuntimeError`` for a file that fails."""
    try:
        yield
    except RuntimeError as error:
        if not any(words in str(error) for words in WRITE_FAILURES):
            raise
        raise OSError(str(error)) from None
