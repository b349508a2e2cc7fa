"""``python -m encircle.planner STUDY``: what an omniscient planner reaches from its starts."""

import argparse
import os
import sys

from encircle.planner.omniscient import CANDIDATES
from encircle.planner.table import rows
from encircle.protocol.process.interrupts import Interrupted
from encircle.protocol.process.log import say, say_error
from encircle.studies.plan import StudyError
from encircle.studies.plan_files import load_plan

PROGRESS_EVERY = 100
SUMMARY = "How often an omniscient planner captures the target from the starts of a study."


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a whole number, 1 or more")
    return int(text)


def main(arguments: list[str]) -> int:
    """Print the table of a study; the exit status."""
    parser = argparse.ArgumentParser("python -m encircle.planner", description=SUMMARY)
    parser.add_argument("study", help="a shipped study's name or a TOML file")
    parser.add_argument("--seeds", type=_count, help="how many, instead of the study's own number")
    parser.add_argument("--candidates", type=_count, default=CANDIDATES, help="plans per start")
    parser.add_argument("--workers", type=_count, default=os.cpu_count() or 1, help="processes")
    options = parser.parse_args(arguments)
    try:
        plan = load_plan(options.study)
        if options.seeds is not None:
            plan = plan.model_copy(update={"seeds": options.seeds})
    except StudyError as error:
        say_error(*f"encircle.planner: {error}".split("\n"))
        return 2

    def tell(done: int) -> None:
        if done % PROGRESS_EVERY == 0:
            say_error(f"{done} starts done")

    try:
        table = rows(plan, options.candidates, options.workers, tell)
    except Interrupted as error:
        say_error(f"encircle.planner: {error}")
        return 1
    names = list(table[0].levels)
    say("| " + " | ".join([*names, "captured", "95 % interval", "starts"]) + " |")
    say("|" + "---|" * (len(names) + 3))
    for row in table:
        shown = [str(level) for level in row.levels.values()]
        low, high = 100 * row.rate.low, 100 * row.rate.high
        ends = [f"{100 * row.rate.value:.0f} %", f"{low:.0f} to {high:.0f} %", str(row.seeds)]
        say("| " + " | ".join([*shown, *ends]) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
