"""The results of checks, as ``encircle doctor`` and ``encircle check-policy`` show them."""

import json
from collections.abc import Sequence
from typing import Literal, NamedTuple

Level = Literal["ok", "note", "wrong"]


class CheckResult(NamedTuple):
    """The result of one check.

    ``check``: what was checked. ``level``: ok, note or wrong. ``said``: what the check saw.
    ``advice``: what to do, empty if nothing is needed.
    """

    check: str
    level: Level
    said: str
    advice: str = ""


def well(results: Sequence[CheckResult]) -> bool:
    """Whether no result is wrong."""
    return all(result.level != "wrong" for result in results)


def as_json(results: Sequence[CheckResult]) -> str:
    """One object: whether all is well, and the results."""
    findings = [result._asdict() for result in results]
    return json.dumps({"well": well(results), "findings": findings})


def as_lines(results: Sequence[CheckResult]) -> list[str]:
    """A line for each result, with a line of advice below it if there is any; then the verdict."""
    lines = []
    for check, level, message, advice in results:
        lines.append(f"{level:5}  {check}: {message}")
        if advice:
            lines.append(f"       -> {advice}")
    wrong = sum(level == "wrong" for _, level, _, _ in results)
    verdict = (
        "all is well"
        if not wrong
        else f"{wrong} {'thing is' if wrong == 1 else 'things are'} wrong"
    )
    return [*lines, verdict]
