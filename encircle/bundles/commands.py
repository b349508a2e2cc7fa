"""The commands ``encircle bundle`` and ``encircle verify``."""

import json
import shlex
from collections.abc import Sequence
from pathlib import Path

from encircle.extras import needing
from encircle.protocol.process.log import say, say_error
from encircle.protocol.programs.option_values import whole_number_in
from encircle.protocol.programs.options import Options

COUNT_MAX, SEED_MAX, WORKERS_MAX = 1_000_000, 2**63 - 1, 1024


def bundle_main(arguments: Sequence[str], program: str) -> int:
    """Pack a study into one file; returns the exit status."""
    options = Options(
        program,
        "Pack a study that has been run into one file that others can verify.",
        environment=False,
    )
    options.add(
        "study",
        "a study's directory, or a name or file as for encircle study",
        metavar="STUDY",
        required=True,
    )
    options.add("--out", "the file to make; NAME.zip if left out", read=Path, metavar="FILE")
    options.add(
        "--recordings",
        "how many runs to record, drawn evenly over the cells; 2 if left out",
        read=whole_number_in(0, 1000),
        default=2,
        metavar="N",
    )
    options.add(
        "--seed",
        "draws which runs are recorded; 0 if left out",
        read=whole_number_in(0, SEED_MAX),
        default=0,
        metavar="N",
    )
    options.add_flag("--json", "print one JSON object")
    settings = options.parse(arguments)
    # Imported late: a mistyped command need not wait for tables and figures.
    with needing("a bundle", "studies"):
        from encircle.bundles.bundle_file import BundleError
        from encircle.bundles.packing import directory_of, pack, plan_in
        from encircle.progress import Progress
        from encircle.studies.plan import StudyError
    from encircle.whole_files import check_new

    try:
        directory = directory_of(settings.study)
        plan = plan_in(directory)
        out = settings.out or Path(f"{plan.name}.zip")
        check_new(out)
        with Progress(plan.name, "recordings") as progress:
            packed = pack(directory, out, settings.recordings, settings.seed, progress)
    except (StudyError, BundleError) as error:
        say_error(*f"encircle: {error}".split("\n"))
        return 2
    for source in packed.left_out:
        say_error(
            f"encircle: {source} is imported by a policy, and lies elsewhere or is no source:"
            " left out"
        )
    if settings.json:
        facts = {"bundle": str(packed.path), "study": plan.name, "runs": packed.plan.runs}
        facts |= {"recordings": packed.recordings, "bytes": packed.bytes, "sha256": packed.sha256}
        say(json.dumps({**facts, "left_out": packed.left_out}))
        return 0
    say(f"bundle  {packed.path} ({packed.bytes} bytes)")
    say(f"rows    {packed.plan.runs}, and {packed.recordings} recordings")
    say(f"sha256  {packed.sha256} of its manifest, which has those of all its parts")
    with_policies = " --run-policies" if packed.policies else ""
    say(f"verify  encircle verify {shlex.quote(str(packed.path))}{with_policies}")
    return 0


def verify_main(arguments: Sequence[str], program: str) -> int:
    """Verify a bundle; returns 0 if all that was checked agrees, 1 if something differs."""
    options = _verify_options(program)
    settings = options.parse(arguments)
    if settings.all and settings.rows is not None:
        options.error("--all and --rows: give one of them")
    # Imported late: a mistyped command need not wait for tables and figures.
    with needing("a bundle", "studies"):
        from encircle.bundles.bundle_file import BundleError, NotABundle
        from encircle.bundles.verifying import ROWS, verify
        from encircle.progress import Progress

    rows = None if settings.all else ROWS if settings.rows is None else settings.rows
    try:
        with Progress(settings.bundle.name, "runs") as progress:
            found = verify(
                settings.bundle,
                rows,
                settings.seed,
                runs_files=settings.run_policies,
                workers=settings.workers,
                tell=progress,
            )
    except NotABundle as error:
        say_error(f"encircle: {error}")
        return 2
    except BundleError as error:
        if settings.json:
            say(json.dumps({"bundle": str(settings.bundle), "agrees": False, "error": str(error)}))
        say_error(*f"encircle: {error}".split("\n"))
        return 1
    if settings.json:
        say(json.dumps({"bundle": str(settings.bundle), **found.as_dict()}))
    else:
        say(*found.lines(), _verdict(found.count, len(found.unchecked)))
    return 1 if found.count else 0


def _verdict(different: int, unchecked: int) -> str:
    if different:
        many = "one thing differs" if different == 1 else f"{different} things differ"
        return (
            f"{many}: this is not the result of what it says was run, or not under code like this"
        )
    many = "one thing was" if unchecked == 1 else f"{unchecked} things were"
    return f"all that was checked agrees; {many} not checked, as said above"


def _verify_options(program: str) -> Options:
    options = Options(
        program,
        "Verify a bundle: hold it against itself, compute its report again, and run some of its"
        " rows again. Exit status 0: all that was checked agrees; 1: something differs.",
        environment=False,
    )
    options.add("bundle", "the file", read=Path, metavar="BUNDLE", required=True)
    options.add(
        "--rows",
        "how many rows to run again, drawn evenly over the cells; 20 if left out",
        read=whole_number_in(0, COUNT_MAX),
        metavar="N",
    )
    options.add_flag("--all", "run all rows again")
    options.add(
        "--seed",
        "draws which rows; if left out, one that nobody knows before, and that is told",
        read=whole_number_in(0, SEED_MAX),
        metavar="N",
    )
    options.add(
        "--workers",
        f"processes, 1 to {WORKERS_MAX}; one per core if left out",
        read=whole_number_in(1, WORKERS_MAX),
        metavar="N",
    )
    options.add_flag(
        "--run-policies",
        "run the policies that the bundle brings with it: they are code, read them before",
    )
    options.add_flag("--json", "print one JSON object")
    return options
