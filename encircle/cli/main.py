"""The command line. Heavy imports stay inside the command that needs them.

What a command was asked for goes to standard output, everything else to standard error. Exit
status: 0 done, captured or not; 1 the run failed; 2 bad usage or configuration.
"""

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from encircle.protocol.process.log import say, say_error
from encircle.protocol.programs.options import InvalidOption, seconds, variable_of


class _Stopped(Exception):
    """What ``Interrupted`` becomes on its way out, for the library would say "Aborted"."""


class _Commands(TyperGroup):
    def invoke(self, ctx: Any) -> Any:
        """Run the command that was asked for."""
        from encircle.protocol.process.interrupts import Interrupted

        try:
            return super().invoke(ctx)
        except Interrupted as error:
            raise _Stopped(str(error)) from None


app = typer.Typer(
    cls=_Commands,
    name="encircle",
    help="Hunt a moving target with robots that share nothing but messages.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

PASSED_ON = {"allow_extra_args": True, "ignore_unknown_options": True}
"""For commands that are programs of their own: their arguments are read there, and only there."""

SetOption = Annotated[
    list[str], typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the scenario.")
]


def _as_seconds(value: str) -> float:
    try:
        return seconds(value)
    except InvalidOption as error:
        raise typer.BadParameter(str(error)) from None


def _seconds(name: str, text: str) -> Any:
    """An option that is a length of time, by the same name and variable as of single parties."""
    return typer.Option(name, help=text, metavar="S", parser=_as_seconds, envvar=variable_of(name))


def main() -> int:
    """Run a command; one clear line for whatever goes wrong. Returns the exit status."""
    from encircle.protocol.plugins import PluginFailed
    from encircle.protocol.process.tracebacks import failure_line
    from encircle.runner.launch import RunFailed
    from encircle.world.recording.run_directory import RunDirectoryError
    from encircle.world.scenario.errors import ScenarioError

    try:
        app()
    except (ScenarioError, RunDirectoryError) as error:
        say_error(*f"encircle: {error}".split("\n"))
        return 2
    except _Stopped as error:
        say_error(f"encircle: {error}")
        return 1
    except RunFailed as error:
        say_error(*f"encircle: the run failed: {error}".split("\n"))
        return 1
    except PluginFailed as error:
        # What only reads a run leaves nothing in its directory.
        say_error(f"encircle: {failure_line(error, None)}")
        return 1
    except SystemExit as ended:
        return int(ended.code or 0)
    return 0


def _read(run: Path) -> Any:
    """A recording, with a word if it is not whole."""
    from encircle.world.recording.recording import read_recording

    recording = read_recording(run)
    if not recording.complete:
        last = max((tick for tick, _, _ in recording.messages), default=0)
        say_error(
            f"encircle: {recording.path} is cut off or damaged: it can be read up to tick {last},"
            " and what follows is left out"
        )
    return recording


@app.command("run")
def run_command(
    scenario: Annotated[
        str | None, typer.Argument(help="A shipped scenario's name or a TOML file.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Instead of the scenario's own.")] = None,
    link: Annotated[str, typer.Option(help="zenoh (a process per robot) or memory.")] = "zenoh",
    changes: SetOption = [],  # noqa: B006  # typer copies it
    out: Annotated[Path | None, typer.Option(help="Directory to record to, new or empty.")] = None,
    when_lost: Annotated[
        str, typer.Option(help="What a lost robot process means: go-on without it, or end.")
    ] = "go-on",
    join_timeout: Annotated[
        float | None, _seconds("--join-timeout", "Wait this long for the processes to start, in s.")
    ] = None,
    answer_timeout: Annotated[
        float | None, _seconds("--answer-timeout", "Wait this long for a robot's answer, in s.")
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(metavar="RUN", help="Go on with a run that broke off.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Run one hunt, record it and draw it."""
    from encircle.cli.hunting import HuntRequest, hunt_and_draw
    from encircle.runner.hunts import LINKS
    from encircle.runner.launch import TIMEOUTS, Timeouts
    from encircle.world.coordinator.result import WHEN_LOST

    for name, value, known in (("link", link, LINKS), ("when-lost", when_lost, WHEN_LOST)):
        if value not in known:
            raise typer.BadParameter(
                f"{value!r} is not one of {', '.join(known)}", param_hint=f"--{name}"
            )
    if resume is None and scenario is None:
        raise typer.BadParameter("give a scenario, or --resume RUN", param_hint="SCENARIO")
    if resume is not None and (scenario, seed, changes, out) != (None, None, [], None):
        raise typer.BadParameter(
            "goes with neither a scenario nor --seed, --set or --out: the run has its own",
            param_hint="--resume",
        )
    changes = [*changes, *([f"seed={seed}"] if seed is not None else [])]
    timeouts = Timeouts(
        join_timeout or TIMEOUTS.join_s_max, answer_timeout or TIMEOUTS.answer_s_max
    )
    hunt_and_draw(
        HuntRequest(scenario or "", changes, out, resume, link, when_lost, timeouts), as_json
    )


@app.command("scenarios")
def scenarios_command(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """List the shipped scenarios."""
    from encircle.world.loading.files import shipped
    from encircle.world.loading.load import load

    found = {name: load(name) for name in shipped()}
    if as_json:
        say(json.dumps({name: s.model_dump(mode="json") for name, s in found.items()}))
        return
    for name, scenario in found.items():
        say(f"{name:12} {len(scenario.ids):3} robots  {scenario.title}")


@app.command("replay")
def replay_command(
    run: Annotated[Path, typer.Argument(help="A run's directory or its recording.")],
    check: Annotated[
        bool, typer.Option("--check", help="Feed it to fresh brains and compare decisions.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Read a recording back, and check it.

    With --check, fresh brains get the recorded observations: do they decide the same?
    """
    from encircle.replay.replaying import replay

    recording = _read(run)
    if not check:
        summary: dict[str, Any] = {
            "recording": str(recording.path),
            "run": recording.run,
            "seed": recording.seed,
            "robots": len(recording.scenario.ids),
            "messages": len(recording.messages),
            "last_tick": max((m[0] for m in recording.messages), default=0),
            "complete": recording.complete,
        }
        lines = [f"{k:10} {v}" for k, v in summary.items()]
        say(*([json.dumps(summary)] if as_json else lines))
        return
    found = replay(recording)
    if as_json:
        say(
            json.dumps(
                {
                    "same": found.same,
                    "ticks": found.ticks,
                    "robots": found.robots,
                    "compared": found.compared,
                    "differences": len(found.differences),
                    "complete": found.complete,
                    "unchecked": found.unchecked,
                }
            )
        )
    else:
        part = (
            "" if found.complete else " (the recording is cut off; all that is there was checked)"
        )
        say(
            f"{found.compared} messages of {found.robots} robots over {found.ticks} ticks:"
            f" {len(found.differences)} decided differently{part}"
        )
        for tick, robot, channel in found.differences[:10]:
            say(f"  tick {tick}: {channel} of {robot}")
        for reason in found.unchecked:
            say(f"  {reason}")
    if not found.same:
        raise typer.Exit(1)


@app.command("transport")
def transport_command(
    run: Annotated[Path, typer.Argument(help="A run's directory or its recording.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Show what the network did to each link.

    Of a run by the clock, beside what was injected.
    """
    from rich.console import Console

    from encircle.network.transport import ledger_of, show
    from encircle.world.network.transport import report

    found = report(ledger_of(_read(run)))
    if as_json:
        say(json.dumps(found))
    else:
        show(found, Console())


@app.command("trace")
def trace_command(
    run: Annotated[Path, typer.Argument(help="A run's directory or its recording.")],
    out: Annotated[Path, typer.Option(help="The file to write: .csv or .parquet.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Write what the network did as a trace.

    Loss and delay of a run by the clock, for the channel to replay.
    """
    from encircle.network.tracing import check_target, trace_of, write_trace

    check_target(out)
    trace = trace_of(_read(run))
    write_trace(trace, out)
    lost = sum(row.lost for row in trace.rows)
    if trace.delays_refused is not None:
        say_error(f"encircle: delays are left out: {trace.delays_refused}")
    if trace.left_out:
        say_error(f"encircle: {trace.left_out} later packets are left out")
    if as_json:
        summary = {"out": str(out), "packets": len(trace.rows), "lost": lost}
        say(json.dumps({**summary, "delays": trace.delays_refused is None}))
    else:
        say(f"{len(trace.rows)} packets, {lost} lost: {out}")


@app.command("reproduce")
def reproduce_command(
    out: Annotated[Path, typer.Option(help="Directory for figures and tables.")] = Path(
        "runs/reproduce"
    ),
    seeds: Annotated[int, typer.Option(min=2, help="Paired runs per point of Fig. 7.")] = 40,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Run the paper's five simulations.

    Draws their figures, and says what was found.
    """
    from encircle.paper.reproduce import reproduce
    from encircle.progress import Progress
    from encircle.protocol.process.interrupts import Interrupted

    try:
        report = reproduce(out, seeds, progress=Progress)
    except Interrupted as error:
        raise Interrupted(f"{error}; nothing of it is left in {out}") from None
    say(*(json.dumps(report.as_dict()) if as_json else report.text()).split("\n"))


@app.command("study")
def study_command(
    name: Annotated[
        str | None, typer.Argument(help="A shipped study's name or a TOML file; none: list them.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Directory; runs/study-NAME if left out.")
    ] = None,
    seeds: Annotated[int | None, typer.Option(min=1, help="How many, instead of its own.")] = None,
    link: Annotated[
        str, typer.Option(help="memory, or zenoh: through robot processes.")
    ] = "memory",
    workers: Annotated[
        int | None, typer.Option(min=1, max=1024, help="Processes; one per core if left out.")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A dask scheduler: tcp/... or tcp://...")
    ] = None,
    changes: SetOption = [],  # noqa: B006
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Run a study, or go on with one.

    Writes its table, figures and report.
    """
    from encircle.runner.hunts import LINKS
    from encircle.studies.plan import StudyError
    from encircle.studies.plan_files import load_plan, shipped_studies

    if link not in LINKS:
        raise typer.BadParameter(f"{link!r} is not one of {', '.join(LINKS)}", param_hint="--link")
    if cluster is not None and (link != "memory" or workers is not None):
        raise typer.BadParameter(
            "goes neither with --link zenoh nor --workers", param_hint="--cluster"
        )
    if name is None:
        for known in shipped_studies():
            plan = load_plan(known)
            say(f"{known:12} {plan.runs:6} runs  {plan.title}")
        return
    try:
        from encircle.studies.command import Request, run_study, show
        from encircle.studies.workers import StudyFailed
    except ModuleNotFoundError as error:
        say_error(f"encircle: studies need {error.name}: install encircle[studies]")
        raise typer.Exit(2) from None
    request = Request(name, out, seeds, link, workers, cluster, changes)
    try:
        answer = run_study(request)
        show(answer, as_json)
        if answer["failed"]:
            say_error(f"encircle: {answer['failure']}")
            raise typer.Exit(1)
    except StudyError as error:
        say_error(f"encircle: {error}")
        raise typer.Exit(2) from None
    except StudyFailed as error:
        say_error(f"encircle: the study stopped: {error}")
        raise typer.Exit(1) from None


@app.command("robot", context_settings=PASSED_ON, add_help_option=False)
def robot_command(context: typer.Context) -> None:
    """Run one robot as this process."""
    from encircle.agents.__main__ import main as robot_main

    raise typer.Exit(robot_main(context.args, "encircle robot"))


@app.command("world", context_settings=PASSED_ON, add_help_option=False)
def world_command(context: typer.Context) -> None:
    """Run the world as this process."""
    from encircle.world.__main__ import main as world_main

    raise typer.Exit(world_main(context.args, "encircle world"))


@app.command("router", context_settings=PASSED_ON, add_help_option=False)
def router_command(context: typer.Context) -> None:
    """Route between world and robots on many hosts."""
    from encircle.protocol.programs.router import main as router_main

    raise typer.Exit(router_main(context.args, "encircle router"))


@app.command("certificates")
def certificates_command(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="Where to put them; new or empty.")
    ],
    robots: Annotated[int, typer.Option(metavar="N", help="For robots r1 to rN.")],
    hosts: Annotated[
        list[str],
        typer.Option("--host", help="A name or address at which router or world is reached."),
    ] = [],  # noqa: B006
    days: Annotated[int, typer.Option(help="How long they are valid.")] = 30,
) -> None:
    """Make certificates for a lab.

    A private authority, and certificates for router, world, viewer and robots.
    """
    try:
        from encircle.network.certificates import CertificateError, describe, make_certificates
    except ModuleNotFoundError as error:
        say_error(f"encircle: certificates need {error.name}: pip install 'encircle[security]'")
        raise typer.Exit(2) from None
    try:
        say(*describe(make_certificates(directory, robots, hosts, days)).split("\n"))
    except CertificateError as error:
        say_error(f"encircle: {error}")
        raise typer.Exit(2) from None


@app.command("alive", context_settings=PASSED_ON, add_help_option=False)
def alive_command(context: typer.Context) -> None:
    """Say whether a party of a run is there."""
    from encircle.protocol.programs.alive import main as alive_main

    raise typer.Exit(alive_main(context.args, "encircle alive"))


@app.command("doctor", context_settings=PASSED_ON, add_help_option=False)
def doctor_command(context: typer.Context) -> None:
    """Examine this machine and a run's network."""
    from encircle.doctor.doctor import main as doctor_main

    raise typer.Exit(doctor_main(context.args, "encircle doctor"))


if __name__ == "__main__":
    main()
