"""What ``encircle study`` is asked for."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from encircle.studies.command.replay_choices import FEW


@dataclass(frozen=True, slots=True)
class Request:
    """What the command line asks for."""

    source: str
    out: Path | None
    seeds: int | str | None
    link: str
    workers: int | None
    cluster: str | None
    changes: Sequence[str]
    replays: str = FEW

    @property
    def command(self) -> str:
        """The command that repeats the numbers, wherever it is run and on however many cores."""
        words = ["encircle", "study", self.source]
        words += [] if self.seeds is None else ["--seeds", str(self.seeds)]
        words += [part for change in self.changes for part in ("--set", change)]
        return shlex.join(words)
