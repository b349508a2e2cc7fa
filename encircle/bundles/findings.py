"""What a verification has found: what agrees, what differs, and what could not be checked."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

SHOWN_MAX = 40
"""How many differences are shown to people; a program gets all that are kept."""
KEPT_MAX = 2000
TEXT_MAX = 160


class Difference(NamedTuple):
    """One thing that is otherwise than it must be.

    ``where``: a row, a member, or the manifest; ``what``: the column or the part of it; ``given``:
    what the bundle has; ``recomputed``: what follows from the rest of it, or from running it.
    """

    where: str
    what: str
    given: str
    recomputed: str

    @property
    def line(self) -> str:
        """The difference as a line for people."""
        what = f", {self.what}" if self.what else ""
        return f"{self.where}{what}: {_cut(self.given)}; recomputed: {_cut(self.recomputed)}"


@dataclass(slots=True)
class Verification:
    """The findings so far, and in the end all of them.

    ``agreed``: what was checked and agrees, a sentence each. ``unchecked``: what could not be
    checked and why. ``numbers``: counts for programs.
    """

    agreed: list[str] = field(default_factory=list)
    differences: list[Difference] = field(default_factory=list)
    unchecked: list[str] = field(default_factory=list)
    numbers: dict[str, Any] = field(default_factory=dict)
    count: int = 0

    def differs(self, where: str, what: str, given: Any, recomputed: Any) -> None:
        """Enter a difference."""
        self.count += 1
        if len(self.differences) < KEPT_MAX:
            self.differences.append(Difference(where, what, str(given), str(recomputed)))

    def as_dict(self) -> Mapping[str, Any]:
        """What ``--json`` prints of it."""
        return {
            "agrees": not self.count,
            "different": self.count,
            "differences": [one._asdict() for one in self.differences],
            "agreed": self.agreed,
            "unchecked": self.unchecked,
            **self.numbers,
        }

    def lines(self) -> list[str]:
        """What is shown to people."""
        shown = [f"differs: {one.line}" for one in self.differences[:SHOWN_MAX]]
        more = self.count - len(shown)
        whole = self.numbers.get("sha256")
        return [
            *([f"the manifest has SHA-256 {whole}"] if whole else []),
            *(f"agrees: {line}" for line in self.agreed),
            *shown,
            *([f"and {more} more differences (--json has more of them)"] if more > 0 else []),
            *(f"not checked: {line}" for line in self.unchecked),
        ]


def _cut(text: str) -> str:
    return text if len(text) <= TEXT_MAX else f"{text[:TEXT_MAX]}..."
