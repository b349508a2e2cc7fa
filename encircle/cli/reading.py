"""Reading a recording for a command: one that is cut off is told of, and read all the same."""

import sys
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from encircle.protocol.process.log import say_error

if TYPE_CHECKING:
    from encircle.world.recording.recording import Recording


def prints_elsewhere() -> AbstractContextManager[TextIO]:
    """While this lasts, what a plug-in prints does not stand among what the command prints."""
    return redirect_stdout(sys.stderr)


def read_or_tell(run: Path) -> "Recording":
    """A recording, with a line on standard error if it is not whole."""
    # Imported late: a mistyped command need not wait for the recording's reader.
    from encircle.world.recording.recording import read_recording

    with prints_elsewhere():
        recording = read_recording(run)
    if not recording.complete:
        last = max((tick for tick, _, _ in recording.messages), default=0)
        say_error(
            f"encircle: {recording.path} is cut off or damaged: it can be read up to tick {last},"
            " and what follows is left out"
        )
    return recording


@contextmanager
def doubts_told() -> Iterator[None]:
    """Tell, in a line at the end, if it could not be worked out what robots believed."""
    from encircle.scene.builder import BeliefsLeftOut

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", BeliefsLeftOut)
        yield
    for warning in caught:
        if issubclass(warning.category, BeliefsLeftOut):
            say_error(f"encircle: {warning.message}")
