"""``make bench-check``: has anything become slower? Ratios of a run, beside those on record.

Only ratios are compared, each of two things that were measured in turns within one run: they move
little from machine to machine, where times say nothing. Margins are wide. Status 1 if something is
slower than on record, and its name is told; what one of the two runs did not measure is told, too.
"""

import argparse
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

RECORDED = Path(__file__).with_name("results.json")
MARGIN = 1.5
"""How many times worse a ratio may be than on record."""
FASTER_IF_HIGHER = {
    "ratio_to_bare": "hunt over Zenoh / bare barrier",
    "ratio_to_mango": "hunt over Zenoh / mango's barrier",
    "two_processes_ratio_to_bare": "robots in two processes / bare barrier",
    "two_processes_ratio_to_mango": "robots in two processes / mango's barrier",
    "ratio_to_mpe2": "hunt in memory / MPE2's physics",
    "ratio_to_simple_tag": "learning environment / simple_tag",
    "floor_over_alike": "64 robots with equal views / their assignments",
    "floor_over_own": "64 robots with views of their own / their assignments",
    "physics_over_alike": "64 robots with equal views / MPE2's physics",
    "physics_over_own": "64 robots with views of their own / MPE2's physics",
    "scaling_one_to_two": "study with two workers / with one",
}
FASTER_IF_LOWER = {
    "first_tick_ratio": "start to the first tick / bare imports",
    "run_in_memory_ratio": "a run in memory / bare imports",
    "list_of_studies_ratio": "list of studies / bare imports",
    "list_of_scenarios_ratio": "list of scenarios / bare imports",
    "joined_ratio": "64 robots joined / bare imports",
    "ratio": "a decision / its bare arithmetic",
    "logged_over_bare": "a logged hunt / a bare one",
    "logged_and_measured_over_bare": "a measured hunt / a bare one",
}


class Comparison(NamedTuple):
    """One ratio, on record and now; ``slowdown``: how many times worse it is now."""

    name: str
    recorded: float
    now: float
    slowdown: float


def ratios(results: Mapping[str, Any]) -> dict[str, tuple[float, bool]]:
    """All ratios of a result file by name, each with whether higher is faster."""
    return dict(_ratios(results, ""))


def _ratios(part: Any, of: str) -> Iterator[tuple[str, tuple[float, bool]]]:
    if isinstance(part, list):
        for row in part:
            yield from _ratios(row, f", {row['robots']} robots" if "robots" in row else of)
    elif isinstance(part, Mapping):
        for key, value in part.items():
            if isinstance(value, Mapping | list):
                yield from _ratios(value, of)
            elif value is not None and key in FASTER_IF_HIGHER:
                yield FASTER_IF_HIGHER[key] + of, (float(value), True)
            elif value is not None and key in FASTER_IF_LOWER:
                yield FASTER_IF_LOWER[key] + of, (float(value), False)


def compared(
    recorded: Mapping[str, Any], now: Mapping[str, Any]
) -> tuple[list[Comparison], list[str]]:
    """What both have, slowest first, and the names of what only one of them has."""
    before, after = ratios(recorded), ratios(now)
    comparisons = []
    for name in before.keys() & after.keys():
        (old, higher_is_faster), (new, _) = before[name], after[name]
        slowdown = old / new if higher_is_faster else new / old
        comparisons.append(Comparison(name, old, new, slowdown))
    comparisons.sort(key=lambda c: (-c.slowdown, c.name))
    return comparisons, sorted(before.keys() ^ after.keys())


def main() -> int:
    """Compare, print a line for each ratio; 1 if something is slower."""
    parser = argparse.ArgumentParser(description="Is anything slower than on record?")
    parser.add_argument("now", type=Path, help="what bench/run.py has written just now")
    parser.add_argument("--recorded", type=Path, default=RECORDED)
    parser.add_argument("--margin", type=float, default=MARGIN)
    options = parser.parse_args()
    recorded, now = (json.loads(p.read_text()) for p in (options.recorded, options.now))
    comparisons, missing = compared(recorded, now)
    slower = [c for c in comparisons if c.slowdown > options.margin]
    for c in comparisons:
        verdict = "SLOWER" if c in slower else "ok"
        print(f"{verdict:7}{c.name}: {c.recorded:.3g} on record, {c.now:.3g} now")
    for name in missing:
        print(f"missing {name}: measured in one of the two runs only")
    if slower:
        print(f"slower than on record by more than {options.margin:g}: {len(slower)}")
    return int(bool(slower))


if __name__ == "__main__":
    raise SystemExit(main())
