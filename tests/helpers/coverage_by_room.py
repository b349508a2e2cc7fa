"""What ``make coverage`` prints at its end: how much of each room's code has run."""

import json
import tempfile
from pathlib import Path
from typing import NamedTuple

from coverage import Coverage


class Count(NamedTuple):
    """Statements and branches of some files together."""

    statements: int = 0
    missing: int = 0
    branches: int = 0
    missing_branches: int = 0

    @property
    def share(self) -> float:
        """Of statements and branches, those that ran; 1 if there are none."""
        everything = self.statements + self.branches
        return 1.0 - (self.missing + self.missing_branches) / everything if everything else 1.0

    def plus(self, other: "Count") -> "Count":
        return Count(*(mine + its for mine, its in zip(self, other, strict=True)))


def room_of(path: Path) -> str:
    """The folder of a file, at most two deep."""
    return "/".join(path.parent.parts[:2])


def counts(files: dict[str, dict]) -> dict[str, Count]:
    """By room, of the files of coverage's own report."""
    rooms: dict[str, Count] = {}
    for name in sorted(files):
        summary = files[name]["summary"]
        count = Count(
            summary["num_statements"],
            summary["missing_lines"],
            summary["num_branches"],
            summary["missing_branches"],
        )
        room = room_of(Path(name))
        rooms[room] = rooms.get(room, Count()).plus(count)
    return rooms


def total(counted: list[Count]) -> Count:
    """All of them together."""
    everything = Count()
    for count in counted:
        everything = everything.plus(count)
    return everything


def main() -> None:
    """Print a line for each room, one for each package, and one for all."""
    measured = Coverage()
    measured.load()
    with tempfile.NamedTemporaryFile() as report:
        measured.json_report(outfile=report.name)
        rooms = counts(json.loads(Path(report.name).read_text())["files"])
    print(f"{'':28} {'statements':>10} {'missing':>8} {'branches':>9} {'ran':>7}")
    for room, count in rooms.items():
        print(line(room, count))
    for package in dict.fromkeys(room.split("/")[0] for room in rooms):
        of_it = [count for room, count in rooms.items() if room.split("/")[0] == package]
        print(line(f"all of {package}", total(of_it)))
    print(line("all", total(list(rooms.values()))))


def line(name: str, count: Count) -> str:
    """One row of the table."""
    return (
        f"{name:28} {count.statements:10} {count.missing:8} {count.branches:9} {count.share:7.1%}"
    )


if __name__ == "__main__":
    main()
