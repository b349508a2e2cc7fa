"""The picture of a run in memory, drawn by a process that gets ready while the hunt goes on.

Importing what draws takes longer than the hunt itself, and a machine has more than one core. What
comes back is the picture's bytes, so that a command that is left leaves no picture that is written
after its end.
"""

import os
import signal
import sys
import threading
from pathlib import Path
from typing import NoReturn

from encircle.protocol.process.deferred_imports import UNUSED, deferred, lazy
from encircle.protocol.process.interrupts import NUMBERS


class Painter:
    """A process that draws one run, forked from this one; it ends by itself or with its parent.

    To be made before there are threads.
    """

    def __init__(self) -> None:
        self._pid = 0
        if threading.active_count() > 1 or not hasattr(os, "fork"):
            return
        asked, ask = os.pipe()
        answered, answer = os.pipe()
        self._pid = os.fork()
        if self._pid == 0:
            os.close(ask)
            os.close(answered)
            _paint(asked, answer)
        os.close(asked)
        os.close(answer)
        # Closed by ``close``.
        self._ask = open(ask, "wb")  # noqa: SIM115
        self._answered = open(answered, "rb")  # noqa: SIM115

    def draw(self, directory: Path) -> bytes:
        """A PNG of the run that is recorded there; empty if this process cannot tell."""
        if self._pid == 0:
            return b""
        try:
            self._ask.write(os.fsencode(directory))
            self._ask.close()
            return self._answered.read()
        except OSError:
            return b""
        finally:
            self.close()

    def close(self) -> None:
        """End it."""
        if self._pid:
            os.kill(self._pid, signal.SIGKILL)
            os.waitpid(self._pid, 0)
            self._pid = 0
            for file in (self._ask, self._answered):
                try:
                    file.close()
                except OSError:
                    continue


def _paint(asked: int, answer: int) -> NoReturn:
    """In the new process: get ready, draw what is asked for, and end."""
    for number in NUMBERS:
        signal.signal(number, signal.SIG_DFL)
    # A policy's file, which it reads as well, may print.
    sys.stdout = sys.stderr
    try:
        # What draws imports the world's physics for its geometry, and never draws a random number.
        # The world takes the laws of its random numbers from there; a picture needs none.
        with lazy(*UNUSED), deferred("scipy.special"):
            from encircle.figures.drawing import warm_up
            from encircle.figures.run_figures import picture_of_run

        warm_up()
        with open(asked, "rb") as request:
            directory = request.read()
        if directory:
            picture = picture_of_run(Path(os.fsdecode(directory)))
            with open(answer, "wb") as file:
                file.write(picture)
    finally:
        # Whatever goes wrong, the parent draws itself, and says so itself if it cannot.
        os._exit(0)
