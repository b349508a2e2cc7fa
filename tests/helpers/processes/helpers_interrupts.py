"""Commands as a terminal starts them, each in a process group of its own, and all they leave."""

import itertools
import os
import secrets
import signal
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

from helpers_waiting import until

SEMAPHORES, PYTHONS = Path("/dev/shm"), ("sem.mp-*", "psm_*")
"""Where semaphores and shared memory have names, and those that Python's workers give them."""


class Group:
    """A command with all that it starts, which a mark in their environment tells from others.

    Its output goes to files, and what it keeps for a while into a directory of its own.
    """

    def __init__(self, command: Sequence[str], folder: Path) -> None:
        self._mark = f"INTERRUPTED_GROUP={secrets.token_hex(8)}"
        self._out, self._err = (folder / f"{self._mark[-16:]}.{end}" for end in ("out", "err"))
        self.scratch = folder / f"{self._mark[-16:]}.tmp"
        self.scratch.mkdir()
        name, _, value = self._mark.partition("=")
        self._begun_ns = time.time_ns()
        with open(self._out, "wb") as out, open(self._err, "wb") as err:
            self._process = subprocess.Popen(
                command,
                cwd=folder,
                env=os.environ | {name: value, "TMPDIR": str(self.scratch)},
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                start_new_session=True,
            )

    @property
    def said(self) -> str:
        return self._err.read_text()

    @property
    def printed(self) -> str:
        return self._out.read_text()

    @property
    def status(self) -> int | None:
        return self._process.poll()

    def wait_for_first_line(self) -> None:
        """Until our own code runs: Python itself does not catch SIGTERM."""
        until(lambda: self.status is not None or self._catches_sigterm(), "the first line")

    def _catches_sigterm(self) -> bool:
        try:
            lines = Path(f"/proc/{self._process.pid}/status").read_text().splitlines()
        except OSError:
            return False
        caught = next((int(x.split()[1], 16) for x in lines if x.startswith("SigCgt:")), 0)
        return bool(caught >> (signal.SIGTERM - 1) & 1)

    def wait_for_lines(self, count: int) -> None:
        """Until it has said so many lines, or has ended."""
        until(lambda: self.status is not None or self.said.count("\n") >= count, f"line {count}")

    def signal(self, number: int = signal.SIGINT) -> bool:
        """Send a signal to the whole group, as a terminal does; whether it was there to get it."""
        if self.status is None:
            os.killpg(self._process.pid, number)
            return True
        return False

    def end(self) -> int:
        """Wait for its end, and for that of all that it has started; its exit status."""
        until(lambda: self.status is not None, f"the end after {self.said}")
        until(lambda: not self.living(), "the end of what it started")
        until(lambda: not self.semaphores(), "its semaphores to go")
        assert self.status is not None
        return self.status

    def living(self) -> list[int]:
        """All processes that it has started, whoever their parents are, that are still there."""
        found = []
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                # A process that has ended, but was not waited for, has no environment.
                if self._mark.encode() in (entry / "environ").read_bytes():
                    found.append(int(entry.name))
            except OSError:
                continue
        return found

    def semaphores(self) -> set[str]:
        """Semaphores and shared memory made since its start that no process uses any more."""
        made = set()
        for path in itertools.chain.from_iterable(map(SEMAPHORES.glob, PYTHONS)):
            try:
                status = path.stat()
            except OSError:
                continue
            if status.st_uid == os.getuid() and status.st_ctime_ns >= self._begun_ns:
                made.add(path.name)
        return made - _in_use() if made else made

    def kill(self) -> None:
        for pid in self.living():
            os.kill(pid, signal.SIGKILL)
        self._process.wait()


def _in_use() -> set[str]:
    """The names of what processes have mapped of shared memory."""
    found = set()
    for maps in Path("/proc").glob("[0-9]*/maps"):
        try:
            lines = maps.read_text().splitlines()
        except OSError:
            continue
        found |= {line.rsplit("/", 1)[1] for line in lines if f" {SEMAPHORES}/" in line}
    return found
