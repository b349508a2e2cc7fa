"""The commands that run many hunts: ``encircle study`` and ``encircle reproduce``."""

import json
from collections.abc import Sequence
from pathlib import Path

from encircle.cli.reading import prints_elsewhere
from encircle.cli.shipped import listed_studies
from encircle.extras import needing
from encircle.protocol.process.interrupts import Interrupted
from encircle.protocol.process.log import say, say_error
from encircle.protocol.programs.option_values import one_of, whole_number_in
from encircle.protocol.programs.options import Options
from encircle.runner.links import LINKS
from encircle.studies.command.replay_choices import FEW, REPLAYS

WORKERS_MAX = 1024
BENCHMARK = "benchmark"
"""The shipped study whose score has a page of its own."""


def reproduce_main(arguments: Sequence[str], program: str) -> int:
    """Run the paper's five simulations; returns the exit status."""
    options = Options(
        program,
        "Run the paper's five simulations, draw their figures, and check what the paper claims.",
        environment=False,
    )
    options.add(
        "--out",
        "directory for figures and tables; runs/reproduce if left out",
        read=Path,
        default=Path("runs/reproduce"),
        metavar="DIR",
    )
    options.add(
        "--seeds",
        "paired runs per point of Fig. 7, 2 or more; 40 if left out",
        read=whole_number_in(2),
        default=40,
        metavar="N",
    )
    options.add_flag("--json", "print one JSON object")
    settings = options.parse(arguments)
    # Imported late: a mistyped command need not wait for figures.
    from encircle.paper.reproduce import reproduce
    from encircle.progress import Progress

    try:
        report = reproduce(settings.out, settings.seeds, progress=Progress)
    except Interrupted as error:
        raise Interrupted(f"{error}; nothing of it is left in {settings.out}") from None
    say(*(json.dumps(report.as_dict()) if settings.json else report.text()).split("\n"))
    return 0


def _seeds(value: str) -> int | str:
    """A number of seeds, or the first and the last of them."""
    return value if "-" in value.strip("-") else whole_number_in(1)(value)


def study_main(arguments: Sequence[str], program: str) -> int:
    """Run a study, or go on with one, or list those that are shipped; returns the exit status."""
    options = _study_options(program)
    settings = options.parse(arguments)
    if settings.cluster is not None and (settings.link != "memory" or settings.workers is not None):
        options.error("--cluster goes neither with --link zenoh nor with --workers")
    if settings.name is None:
        for name, runs, title in listed_studies():
            say(f"{name:12} {runs:6} runs  {title}")
        return 0
    # Imported late: a list need not wait for tables and figures.
    from encircle.studies.plan import StudyError

    with needing("a study", "studies"):
        from encircle.studies.command.request import Request
        from encircle.studies.command.study_command import run_study, show
        from encircle.studies.workers import StudyFailed
    request = Request(
        settings.name,
        settings.out,
        settings.seeds,
        settings.link,
        settings.workers,
        settings.cluster,
        settings.set,
        settings.replays,
    )
    try:
        with prints_elsewhere():
            answer = run_study(request)
        if settings.name == BENCHMARK and not settings.set:
            # Imported late, as the study itself: no other study needs it.
            from encircle.benchmark.submission import write_table_page

            answer["page"] = write_table_page(Path(answer["out"]))["page"]
        show(answer, settings.json)
    except StudyError as error:
        say_error(*f"encircle: {error}".split("\n"))
        return 2
    except StudyFailed as error:
        say_error(f"encircle: the study stopped: {error}")
        return 1
    if answer["failed"]:
        say_error(f"encircle: {answer['failure']}")
        return 1
    return 0


def _study_options(program: str) -> Options:
    options = Options(
        program,
        "Run a study, or go on with one: its table, its figures and its report.",
        environment=False,
    )
    options.add(
        "name", "a shipped study's name or a TOML file; without one, list them", metavar="NAME"
    )
    options.add("--out", "directory; runs/study-NAME if left out", read=Path, metavar="DIR")
    options.add(
        "--seeds",
        "how many seeds, 1 or more, or which, as in 1001-1200, instead of its own",
        read=_seeds,
        metavar="N",
    )
    options.add(
        "--link",
        "memory, or zenoh: through robot processes; memory if left out",
        read=one_of(LINKS),
        default="memory",
    )
    options.add(
        "--workers",
        f"processes, 1 to {WORKERS_MAX}; one per core if left out",
        read=whole_number_in(1, WORKERS_MAX),
        metavar="N",
    )
    options.add("--cluster", "a dask scheduler: tcp/... or tcp://...", metavar="ADDRESS")
    options.add_list("--set", "change a key of the scenario; may be repeated", metavar="KEY=VALUE")
    options.add(
        "--replays",
        "which runs the report links replays of: few (median and worst of the two cells that"
        " differ most), all (of every cell) or none; few if left out",
        read=one_of(REPLAYS),
        default=FEW,
        metavar="WHICH",
    )
    options.add_flag("--json", "print one JSON object")
    return options
