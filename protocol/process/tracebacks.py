"""Where the traceback of a plug-in that failed is kept, and the line that tells of it.

It lies in the run's directory, or else in a temporary file. Nothing that is there is overwritten.
"""

import os
import tempfile
from pathlib import Path

from encircle.protocol.plugins import PluginFailed

TRACEBACK_IN = "; traceback in "
"""Stands in every line that tells of a plug-in that failed, before the file."""
ENDINGS = ("", *(f"-{number}" for number in range(2, 1000)))


def failure_line(failed: PluginFailed, directory: Path | None) -> str:
    """The one line that tells of it; its traceback has been written to the file that it names."""
    try:
        return f"{failed}{TRACEBACK_IN}{_written(failed, directory)}"
    except OSError as error:
        return f"{failed}{TRACEBACK_IN}no file: {error.strerror}"


def _written(failed: PluginFailed, directory: Path | None) -> Path:
    text = f"{failed}\n\n{failed.trace}".encode(errors="backslashreplace")
    if directory is None:
        number, name = tempfile.mkstemp(".txt", f"encircle-{failed.who}-")
        Path(name).write_bytes(text)
        os.close(number)
        return Path(name)
    names = [f"traceback-{failed.who}{ending}.txt" for ending in ENDINGS]
    path = next(
        (p for p in map(directory.joinpath, names) if not p.exists()), directory / names[-1]
    )
    with open(path, "xb") as file:
        file.write(text)
    return path
