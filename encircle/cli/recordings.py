"""The commands that read a recorded run: ``encircle replay``, ``transport`` and ``trace``."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from encircle.cli.reading import prints_elsewhere, read_or_tell
from encircle.protocol.process.log import printable, say, say_error
from encircle.protocol.programs.options import Options

if TYPE_CHECKING:
    from encircle.replay.replay_check import ReplayCheck
    from encircle.world.recording.recording import Recording

DIFFERENCES_SHOWN_MAX = 10


def replay_main(arguments: Sequence[str], program: str) -> int:
    """Read a recording back, or check it; returns 1 if a decision differs, and 0 otherwise."""
    options = _options(
        program,
        "Read a recording back, and check it. With --check, fresh brains get the recorded"
        " observations: do they decide the same?",
    )
    options.add_flag("--check", "feed it to fresh brains and compare decisions")
    options.add_flag("--robots", "measure each robot: way, modes, messages, beliefs, conflicts")
    options.add_flag("--digest", "play it to a fresh world: does it come to the same digest?")
    settings = options.parse(arguments)
    asked = [name for name in ("check", "robots", "digest") if getattr(settings, name)]
    if len(asked) > 1:
        options.error(f"--{asked[0]} and --{asked[1]}: give one of them")
    # Imported late: a mistyped command need not wait for the brains.
    from encircle.replay.replaying import replay

    recording = read_or_tell(settings.run)
    if settings.robots:
        _say_robots(recording, settings.json)
        return 0
    if settings.digest:
        return _say_digest(recording, settings.json)
    if not settings.check:
        summary = _summary(recording)
        lines = [f"{key:10} {value}" for key, value in summary.items()]
        say(*([json.dumps(summary)] if settings.json else lines))
        return 0
    with prints_elsewhere():
        outcome = replay(recording)
    say(*([json.dumps(_as_dict(outcome))] if settings.json else _as_lines(outcome)))
    return 0 if outcome.same else 1


def _summary(recording: "Recording") -> dict[str, Any]:
    return {
        "recording": str(recording.path),
        "run": recording.run,
        "seed": recording.seed,
        "robots": len(recording.scenario.ids),
        "messages": len(recording.messages),
        "last_tick": max((m[0] for m in recording.messages), default=0),
        "complete": recording.complete,
    }


def _say_digest(recording: "Recording", as_json: bool) -> int:
    """The digest of a run played again, and whether its summary has it; the exit status."""
    # Imported late: it brings the world.
    from encircle.world.recording.resuming import digest_of

    with prints_elsewhere():
        digest, recorded = digest_of(recording), _recorded_digest(recording)
    count = len(recording.scenario.events) - len(recording.scenario_as_written.events)
    if as_json:
        told = {"digest": digest, "recorded": recorded, "interventions": count}
        say(json.dumps({"run": recording.run, **told}))
    else:
        many = f"{count} intervention{'' if count == 1 else 's'}"
        beside = {None: "there is no summary to compare with", digest: "as in its summary"}
        say(f"digest {digest}, {many}; {beside.get(recorded, f'its summary has {recorded}')}")
    return 0 if recorded in (None, digest) else 1


def _recorded_digest(recording: "Recording") -> str | None:
    """The digest in the summary beside a recording that is whole; None if there is none."""
    from encircle.world.recording.run_directory import SUMMARY

    try:
        summary = json.loads(recording.path.with_name(SUMMARY).read_text(encoding="utf-8"))
        is_its = recording.complete and summary["run"] == recording.run
        return str(summary["digest"]) if is_its else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _say_robots(recording: "Recording", as_json: bool) -> None:
    """What is measured of each robot, as a table or as JSON."""
    from encircle.measures.breakdown import breakdown, breakdown_rows
    from encircle.runlog.recorded_log import log_of_recording

    with prints_elsewhere():
        robots = breakdown(log_of_recording(recording))
    if as_json:
        say(json.dumps({"run": recording.run, "seed": recording.seed, "robots": robots}))
        return
    rows = [("", "", *(robot["robot"] for robot in robots)), *breakdown_rows(robots)]
    rows = [tuple(printable(cell) for cell in row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for name, unit, *values in rows:
        cells = [name.ljust(widths[0]), unit.ljust(widths[1])]
        cells += [value.rjust(width) for value, width in zip(values, widths[2:], strict=True)]
        say("  ".join(cells).rstrip())


def _as_dict(outcome: "ReplayCheck") -> dict[str, Any]:
    return {
        "same": outcome.same,
        "ticks": outcome.ticks,
        "robots": outcome.robots,
        "compared": outcome.compared,
        "differences": len(outcome.differences),
        "complete": outcome.complete,
        "unchecked": outcome.unchecked,
    }


def _as_lines(outcome: "ReplayCheck") -> list[str]:
    part = "" if outcome.complete else " (the recording is cut off; all that is there was checked)"
    return [
        f"{outcome.compared} messages of {outcome.robots} robots over {outcome.ticks} ticks:"
        f" {len(outcome.differences)} decided differently{part}",
        *(
            f"  tick {tick}: {channel} of {robot}"
            for tick, robot, channel in outcome.differences[:DIFFERENCES_SHOWN_MAX]
        ),
        *(f"  {reason}" for reason in outcome.unchecked),
    ]


def transport_main(arguments: Sequence[str], program: str) -> int:
    """Show what the network did to each link; returns the exit status."""
    options = _options(
        program,
        "Show what the network did to each link, of a run by the clock, beside what was injected.",
    )
    settings = options.parse(arguments)
    # Imported late: a mistyped command need not wait for tables.
    from rich.console import Console

    from encircle.network.recorded_ledger import ledger_of
    from encircle.network.transport_tables import print_transport_report
    from encircle.world.network.transport import report

    links = report(ledger_of(read_or_tell(settings.run)))
    if settings.json:
        say(json.dumps(links))
    else:
        print_transport_report(links, Console())
    return 0


def trace_main(arguments: Sequence[str], program: str) -> int:
    """Write what the network did as a trace; returns the exit status."""
    options = _options(
        program,
        "Write what the network did as a trace: loss and delay of a run by the clock, for the"
        " channel to replay. With --from, of a public trace set instead.",
    )
    options.add(
        "--from",
        "RUN is a file of a public trace set in this format: orbit or uma",
        metavar="FORMAT",
    )
    options.add_list(
        "--nodes",
        "of a folder of orbit: which nodes are r1, r2, ..., as in 1-2,1-4,2-5",
        metavar="LIST",
    )
    options.add(
        "--out",
        "the file to write: .csv or .parquet",
        read=Path,
        metavar="FILE",
        required=True,
    )
    settings = options.parse(arguments)
    # Imported late: a mistyped command need not wait for the recording's reader.
    from encircle.network.public_traces import FORMATS
    from encircle.network.tracing import check_trace_path, trace_of, write_trace

    form = getattr(settings, "from")
    nodes = [node.strip() for listed in settings.nodes for node in listed.split(",")]
    if form is not None and form not in FORMATS:
        options.error(f"--from {form}: must be {' or '.join(FORMATS)}")
    if form is None and nodes:
        options.error("--nodes: is for --from orbit")
    out = settings.out
    check_trace_path(out)
    trace = (
        trace_of(read_or_tell(settings.run)) if form is None else FORMATS[form](settings.run, nodes)
    )
    write_trace(trace, out)
    lost = sum(row.lost for row in trace.rows)
    if trace.delays_refused is not None:
        say_error(f"encircle: delays are left out: {trace.delays_refused}")
    if trace.left_out:
        say_error(f"encircle: {trace.left_out} later packets are left out")
    if settings.json:
        summary = {"out": str(out), "packets": len(trace.rows), "lost": lost}
        say(json.dumps({**summary, "delays": trace.delays_refused is None}))
    else:
        say(f"{len(trace.rows)} packets, {lost} lost: {out}")
    return 0


def _options(program: str, description: str) -> Options:
    options = Options(program, description, environment=False)
    options.add(
        "run", "a recorded run's directory or recording", read=Path, metavar="RUN", required=True
    )
    options.add_flag("--json", "print one JSON object")
    return options
