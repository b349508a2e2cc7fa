"""``encircle benchmark``: score a policy on the benchmark's tasks, beside the shipped policies."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from encircle.extras import needing
from encircle.protocol.process.log import say, say_error
from encircle.protocol.programs.option_values import whole_number_in
from encircle.protocol.programs.options import Options

SEEDS_MAX, WORKERS_MAX = 100, 1024


def main(arguments: Sequence[str], program: str) -> int:
    """Score a policy, or print the published table; returns the exit status."""
    options = _options(program)
    settings = options.parse(arguments)
    if settings.policy is not None and settings.name is None:
        options.error('a policy needs --name, as in --name "Jane\'s auction": it heads the page')
    with needing("the benchmark", "studies"):
        from encircle.benchmark.submission import Request, published_lines, run_submission
        from encircle.studies.plan import StudyError
        from encircle.studies.workers import StudyFailed
    if settings.policy is None:
        say(*published_lines())
        return 0
    request = Request(
        settings.policy,
        settings.name,
        settings.out,
        settings.seeds,
        settings.workers,
        settings.set,
    )
    try:
        answer = run_submission(request)
    except StudyError as error:
        say_error(*f"encircle: {error}".split("\n"))
        return 2
    except StudyFailed as error:
        say_error(f"encircle: the benchmark stopped: {error}")
        return 1
    _show(answer, settings.json)
    return 0


def _show(answer: dict[str, Any], as_json: bool) -> None:
    if as_json:
        say(json.dumps(answer))
        return
    for sentence in answer["findings"]:
        say(f"- {sentence}")
    if answer["failed"]:
        say_error(
            f"encircle: {answer['failed']} of {answer['runs']} runs failed, and count as hunts"
            f" without capture: see {Path(answer['out']) / 'failed'}"
        )
    say(f"page   {answer['page']}")
    say(f"table  {Path(answer['out']) / 'table.parquet'}")


def _options(program: str) -> Options:
    options = Options(
        program,
        "Score a policy on the benchmark's tasks, beside the shipped policies.",
        environment=False,
    )
    options.add(
        "policy",
        "a shipped name, that of a plug-in, or path/file.py:function; without one, print the"
        " published table",
        metavar="POLICY",
    )
    options.add(
        "--name",
        "what the policy is called on its page; the held-out seeds are drawn from it",
        metavar="NAME",
    )
    options.add("--out", "directory; runs/benchmark-NAME if left out", read=Path, metavar="DIR")
    options.add(
        "--seeds",
        f"how many public seeds, and how many held-out ones, 1 to {SEEDS_MAX}; fewer than"
        f" {SEEDS_MAX} are for a first try",
        read=whole_number_in(1, SEEDS_MAX),
        default=SEEDS_MAX,
        metavar="N",
    )
    options.add_list(
        "--set", "set an own parameter of the policy; may be repeated", metavar="NAME=VALUE"
    )
    options.add(
        "--workers",
        f"processes, 1 to {WORKERS_MAX}; one per core if left out",
        read=whole_number_in(1, WORKERS_MAX),
        metavar="N",
    )
    options.add_flag("--json", "print one JSON object")
    return options
