"""The report in a bundle, made again from plan and table, and compared number by number.

Numbers are compared to nine digits, for another processor may add in another order; texts to the
letter; figures by their pixels, for the same picture can be packed into other bytes.
"""

import base64
import csv
import io
import json
import re
from collections.abc import Callable, Iterator
from itertools import zip_longest
from math import isclose
from pathlib import Path
from typing import Any

import matplotlib

from encircle.bundles.bundle_file import FIGURES_FOLDER, NUMBERS, REPORT, REPORT_FOLDER
from encircle.bundles.contents import Contents
from encircle.bundles.findings import Verification
from encircle.bundles.report_members import report_members
from encircle.figures.picture_comparison import picture_problem
from encircle.protocol.plugins import error_line
from encircle.strict_json import strict_json
from encircle.studies.study_table import StudyTable

RELATIVE, ABSOLUTE = 1e-9, 1e-12
LARGE = 1e300
LARGER, LARGER_BYTES = 2, 2**20
"""What is larger than ours by this is another text, and is not looked through."""
BOUNDS = ("value", "low", "high")
IMAGE = re.compile(rb"data:image/png;base64,([A-Za-z0-9+/=]*)")
TAGS = re.compile(r"<[^<>]*>")

Differs = Callable[[str, Any, Any], None]


class _Nothing:
    """In place of what only one of two trees has; no text is equal to it."""

    def __str__(self) -> str:
        return "not there"


NOTHING = _Nothing()


def check_report(contents: Contents, found: Verification) -> None:
    """Make the report again and enter what differs."""
    if not contents.whole:
        found.unchecked.append("the report: it cannot be made from rows that are not the plan's")
        return
    try:
        made = _made(contents)
    except Exception as error:
        # The table is a stranger's: a run without capture may end before its limit.
        found.differs("report", "", "a report", f"none can be made: {error_line(error)}")
        return
    given = {n: c for n, c in contents.members.items() if n.startswith(REPORT_FOLDER)}
    before = found.count
    for name in sorted({*given, *made}):
        if name not in given:
            found.differs(name, "", "missing", "the report has it")
        elif name not in made:
            found.differs(name, "", "a part of the report", "the report has none of that name")
        elif not name.startswith(FIGURES_FOLDER):
            _compare_texts(name, given[name], made[name], contents, found)
    if found.count == before:
        count = sum(1 for _ in _leaves(json.loads(made[NUMBERS])))
        csv_files = " and its CSV files" if any(name.endswith(".csv") for name in made) else ""
        found.agreed.append(
            f"the report, computed again from the table: {count} numbers and sentences, its page"
            f"{csv_files}"
        )
    _check_figures(contents, given, made, found)


def _made(contents: Contents) -> dict[str, bytes]:
    folder = Path(contents.folder) / "study"
    table = StudyTable(folder, contents.plan, {"code": contents.rows[0]["code"]})
    try:
        table.append(contents.rows)
        table.merge()
        return report_members(contents.plan, table)
    finally:
        table.close()


def _compare_texts(
    name: str, given: bytes, made: bytes, contents: Contents, found: Verification
) -> None:
    def differs(what: str, theirs: Any, own: Any) -> None:
        found.differs(name, what, theirs, own)

    if given == made:
        return
    try:
        if len(given) > LARGER * len(made) + LARGER_BYTES:
            differs("", f"{len(given)} bytes", f"{len(made)} bytes")
        elif name == NUMBERS:
            _compare_trees(strict_json(given), json.loads(made), "", differs)
        elif name == REPORT:
            _compare_pages(given, made, differs)
            _compare_page_pictures(given, made, contents, found)
        else:
            _compare_csv(given.decode(), made.decode(), differs)
    except (ValueError, RecursionError, csv.Error) as error:
        differs("", f"cannot be read: {error_line(error)}", "a part of the report")


def _compare_trees(given: Any, made: Any, where: str, differs: Differs) -> None:
    """Enter every leaf of two trees that differs."""
    if isinstance(given, dict) and isinstance(made, dict):
        for key in sorted({*given, *made}):
            own = made.get(key, NOTHING)
            _compare_trees(given.get(key, NOTHING), own, f"{where}{key} ", differs)
    elif isinstance(given, list) and isinstance(made, list):
        for index, (theirs, own) in enumerate(zip_longest(given, made, fillvalue=NOTHING)):
            named = _is_interval(made) and index < len(BOUNDS)
            part = BOUNDS[index] if named else str(index)
            _compare_trees(theirs, own, f"{where}{part} ", differs)
    elif not _same(given, made):
        differs(where.strip(), given, made)


def _is_interval(numbers: list[Any]) -> bool:
    plain = all(n is None or isinstance(n, int | float) or n in ("inf", "-inf") for n in numbers)
    return len(numbers) == len(BOUNDS) and plain


def _same(given: Any, made: Any) -> bool:
    numbers = all(isinstance(n, int | float) and not isinstance(n, bool) for n in (given, made))
    if numbers and abs(given) < LARGE:
        return isclose(given, made, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    return type(given) is type(made) and bool(given == made)


def _leaves(tree: Any) -> Iterator[Any]:
    if isinstance(tree, dict | list):
        for part in tree.values() if isinstance(tree, dict) else tree:
            yield from _leaves(part)
    else:
        yield tree


def _compare_csv(given: str, made: str, differs: Differs) -> None:
    theirs, own = (list(csv.reader(io.StringIO(text, newline=""))) for text in (given, made))
    header = own[0]
    if theirs[:1] != own[:1]:
        differs("header", theirs[:1], own[:1])
        return
    for number, (line, mine) in enumerate(zip_longest(theirs[1:], own[1:]), start=2):
        if line is None or mine is None or len(line) != len(mine):
            differs(f"line {number}", line, mine)
            continue
        for column, text, right in zip(header, line, mine, strict=True):
            if text != right and not _same_text(text, right):
                differs(f"line {number}, {column}", text, right)


def _same_text(given: str, made: str) -> bool:
    try:
        return isclose(float(given), float(made), rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    except ValueError:
        return False


def _compare_pages(given: bytes, made: bytes, differs: Differs) -> None:
    """Compare the text of two pages line by line, without the pictures in them."""
    theirs, own = (IMAGE.sub(b"data:image", page).decode().split("\n") for page in (given, made))
    for number, (line, mine) in enumerate(zip_longest(theirs, own), start=1):
        if line != mine:
            texts = _shown(line), _shown(mine)
            if texts[0] == texts[1]:
                texts = str(line), str(mine)
            differs(f"line {number}", *_about_difference(*texts))
            if len(theirs) != len(own):
                # All that follows is moved.
                return


def _compare_page_pictures(
    given: bytes, made: bytes, contents: Contents, found: Verification
) -> None:
    images, own_images = (IMAGE.findall(page) for page in (given, made))
    for number, (image, mine) in enumerate(zip_longest(images, own_images), start=1):
        problem = "" if image == mine else picture_problem(_decoded(image), _decoded(mine))
        if problem:
            _enter_picture(REPORT, f"picture {number}", problem, contents, found)


def _decoded(text: bytes | None) -> bytes:
    try:
        return base64.b64decode(text or b"", validate=True)
    except ValueError:
        return b""


def _shown(line: str | None) -> str:
    return "none" if line is None else " ".join(TAGS.sub(" ", line).split())


def _about_difference(given: str, made: str, around: int = 60) -> tuple[str, str]:
    """Two texts from a little before where they begin to differ."""
    same = next(
        (k for k, pair in enumerate(zip(given, made, strict=False)) if pair[0] != pair[1]), 0
    )
    start = max(0, same - around)
    return given[start : start + 3 * around], made[start : start + 3 * around]


def _check_figures(
    contents: Contents, given: dict[str, bytes], made: dict[str, bytes], found: Verification
) -> None:
    names = [name for name in sorted(given) if name in made and name.startswith(FIGURES_FOLDER)]
    problems = {name: picture_problem(given[name], made[name]) for name in names}
    different = {name: problem for name, problem in problems.items() if problem}
    found.numbers["figures"] = {"of": len(names), "different": len(different)}
    if names and not different:
        found.agreed.append(f"{len(names)} figures, drawn again, have the same pixels")
    for name, problem in different.items():
        _enter_picture(name, "", problem, contents, found)


def _enter_picture(
    where: str, what: str, problem: str, contents: Contents, found: Verification
) -> None:
    """Enter a picture that is another one, which another matplotlib may have drawn."""
    drawn = contents.manifest["drawn_with"]["matplotlib"]
    if drawn == matplotlib.__version__:
        found.differs(where, what, problem, "the same picture")
    else:
        found.unchecked.append(
            f"{', '.join(filter(None, (where, what)))}: drawn by matplotlib {drawn}, here by"
            f" {matplotlib.__version__}, and not the same: {problem}"
        )
