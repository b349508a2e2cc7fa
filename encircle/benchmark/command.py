"""``encircle benchmark``: score a policy on the benchmark's tasks, beside the shipped policies."""

import json
import shlex
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from encircle.extras import needing
from encircle.protocol.process.log import say, say_error
from encircle.protocol.programs.option_values import whole_number_in
from encircle.protocol.programs.options import Options

if TYPE_CHECKING:
    from encircle.benchmark.submission import Request

SEEDS_MAX, WORKERS_MAX = 100, 1024
OF_RUNS = ("name", "seeds", "set", "workers")
"""The options that say something of runs, and nothing of a bundle, whose runs are made."""


def main(arguments: Sequence[str], program: str) -> int:
    """Score a policy, or print the published table; returns the exit status."""
    options = _options(program)
    settings = options.parse(arguments)
    bundle = settings.policy is not None and settings.policy.endswith(".zip")
    _refuse_meaningless(options, settings, bundle)
    if settings.policy is not None and not bundle and settings.name is None:
        options.error('a policy needs --name, as in --name "Jane\'s auction": it heads the page')
    if bundle and settings.out is None:
        options.error("a bundle needs --out, the directory for its page")
    with needing("the benchmark", "studies"):
        from encircle.benchmark import submission
        from encircle.bundles.bundle_file import BundleError
        from encircle.studies.plan import StudyError
        from encircle.studies.workers import StudyFailed
    if settings.policy is None:
        say(*submission.published_lines())
        return 0
    try:
        if bundle:
            answer = submission.score_bundle(Path(settings.policy), settings.out)
        else:
            answer = submission.run_submission(_request(settings))
    except (StudyError, BundleError) as error:
        say_error(*f"encircle: {error}".split("\n"))
        return 2
    except StudyFailed as error:
        say_error(f"encircle: the benchmark stopped: {error}")
        return 1
    _show(answer, settings.json)
    return 0


def _refuse_meaningless(options: Options, settings: Namespace, bundle: bool) -> None:
    """Refuse options that would change nothing; none of them has a default."""
    names: tuple[str, ...] = ()
    why = ""
    if settings.policy is None:
        names, why = (*OF_RUNS, "out", "json"), "without a POLICY the published table is printed"
    elif bundle:
        names, why = OF_RUNS, "a bundle has its name, seeds and runs in it"
    for name in names:
        if getattr(settings, name) not in (None, [], False):
            options.error(f"--{name} means nothing here: {why}")


def _request(settings: Namespace) -> "Request":
    from encircle.benchmark.submission import Request

    return Request(
        settings.policy,
        settings.name,
        settings.out,
        SEEDS_MAX if settings.seeds is None else settings.seeds,
        settings.workers,
        settings.set,
    )


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
    for sentence in answer.get("unchecked", ()):
        say(f"not checked: {sentence}")
    say(f"page    {answer['page']}")
    if "bundle" in answer:
        say(f"bundle  {answer['bundle']}")
        say(f"sha256  {answer['sha256']} of its manifest")
        say(f"verify  encircle verify {shlex.quote(answer['bundle'])} --run-policies")


def _options(program: str) -> Options:
    options = Options(
        program,
        "Score a policy on the benchmark's tasks, beside the shipped policies.",
        environment=False,
    )
    options.add(
        "policy",
        "a shipped name, that of a plug-in, path/file.py:function, or a submission's bundle, to"
        " score its rows; without one, print the published table",
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
        f" {SEEDS_MAX} are for a first try; {SEEDS_MAX} if left out",
        read=whole_number_in(1, SEEDS_MAX),
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
