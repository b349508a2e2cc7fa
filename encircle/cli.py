"""The command line. Heavy imports stay inside the command that needs them.

What a command was asked for goes to standard output, everything else to standard error. Exit
status: 0 done, captured or not; 1 the run failed; 2 bad usage or configuration.
"""

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

app = typer.Typer(
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


def main() -> None:
    """Entry point of ``encircle``: one clear line for whatever goes wrong."""
    from encircle.launch import RunFailed
    from world.run_directory import RunDirectoryError
    from world.scenario import ScenarioError

    try:
        app()
    except (ScenarioError, RunDirectoryError) as error:
        print(f"encircle: {error}", file=sys.stderr)
        sys.exit(2)
    except RunFailed as error:
        print(f"encircle: the run failed: {error}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print("encircle: the run failed: stopped by SIGINT", file=sys.stderr)
        sys.exit(1)


@app.command("run")
def run_command(
    scenario: Annotated[str, typer.Argument(help="A shipped scenario's name or a TOML file.")],
    seed: Annotated[int | None, typer.Option(help="Instead of the scenario's own.")] = None,
    link: Annotated[str, typer.Option(help="zenoh (a process per robot) or memory.")] = "zenoh",
    changes: SetOption = [],  # noqa: B006  # typer copies it
    out: Annotated[Path | None, typer.Option(help="Directory to record to, new or empty.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Run one hunt, record it and draw it."""
    from encircle.display import Display
    from encircle.hunts import LINKS, default_directory, run
    from world.scenario import load

    if link not in LINKS:
        raise typer.BadParameter(f"{link!r} is not one of {', '.join(LINKS)}", param_hint="--link")
    loaded = load(scenario, [*changes, *([f"seed={seed}"] if seed is not None else [])])
    directory = out or default_directory(scenario, loaded.seed)
    with Display(loaded, link) as display:
        hunt = run(loaded, link=link, out=directory, progress=display.update)
    # Imported after the hunt: the robots need not wait for the plotting library.
    from encircle.figures import draw_run

    figure = draw_run(directory, directory / "trajectory.png")
    if as_json:
        print(json.dumps({**hunt.as_dict(scenario), "figure": str(figure)}))
    else:
        display.show_result(hunt, directory, figure)


@app.command("scenarios")
def scenarios_command(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """List the scenarios that come with the program."""
    from world.scenario import load, shipped

    found = {name: load(name) for name in shipped()}
    if as_json:
        print(json.dumps({name: s.model_dump(mode="json") for name, s in found.items()}))
        return
    for name, scenario in found.items():
        print(f"{name:12} {len(scenario.ids):3} robots  {scenario.title}")


@app.command("replay")
def replay_command(
    run: Annotated[Path, typer.Argument(help="A run's directory or its recording.")],
    check: Annotated[
        bool, typer.Option("--check", help="Feed it to fresh brains and compare decisions.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Read a recording back; with --check, see whether fresh brains decide the same."""
    from encircle.replaying import read_recording, replay

    if not check:
        recording = read_recording(run)
        summary: dict[str, Any] = {
            "recording": str(recording.path),
            "run": recording.run,
            "seed": recording.seed,
            "robots": len(recording.scenario.ids),
            "messages": len(recording.messages),
            "last_tick": max((m[0] for m in recording.messages), default=0),
            "complete": recording.complete,
        }
        print(
            json.dumps(summary) if as_json else "\n".join(f"{k:10} {v}" for k, v in summary.items())
        )
        return
    found = replay(run)
    if as_json:
        print(
            json.dumps(
                {
                    "same": found.same,
                    "ticks": found.ticks,
                    "robots": found.robots,
                    "compared": found.compared,
                    "differences": len(found.differences),
                    "complete": found.complete,
                }
            )
        )
    else:
        part = (
            "" if found.complete else " (the recording is cut off; all that is there was checked)"
        )
        print(
            f"{found.compared} messages of {found.robots} robots over {found.ticks} ticks:"
            f" {len(found.differences)} decided differently{part}"
        )
        for tick, robot, channel in found.differences[:10]:
            print(f"  tick {tick}: {channel} of {robot}")
    if not found.same:
        raise typer.Exit(1)


@app.command("reproduce")
def reproduce_command(
    out: Annotated[Path, typer.Option(help="Directory for figures and tables.")] = Path(
        "runs/reproduce"
    ),
    seeds: Annotated[int, typer.Option(min=2, help="Paired runs per point of Fig. 7.")] = 40,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Run the paper's five simulations, draw their figures, and say what was found."""
    from encircle.reproduce import reproduce

    report = reproduce(out, seeds, tell=lambda line: print(line, file=sys.stderr, flush=True))
    print(json.dumps(report.as_dict()) if as_json else report.text())


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
    """Run a study, or go on with one, and write its table, figures and report."""
    from encircle.hunts import LINKS
    from encircle.studies.plan import StudyError, load_plan, shipped_studies

    if link not in LINKS:
        raise typer.BadParameter(f"{link!r} is not one of {', '.join(LINKS)}", param_hint="--link")
    if cluster is not None and (link != "memory" or workers is not None):
        raise typer.BadParameter(
            "goes neither with --link zenoh nor --workers", param_hint="--cluster"
        )
    if name is None:
        for known in shipped_studies():
            plan = load_plan(known)
            print(f"{known:12} {plan.runs:6} runs  {plan.title}")
        return
    try:
        from encircle.studies.command import Request, run_study, show
        from encircle.studies.workers import StudyFailed
    except ModuleNotFoundError as error:
        print(f"encircle: studies need {error.name}: install encircle[studies]", file=sys.stderr)
        raise typer.Exit(2) from None
    request = Request(name, out, seeds, link, workers, cluster, changes)
    try:
        show(run_study(request), as_json)
    except StudyError as error:
        print(f"encircle: {error}", file=sys.stderr)
        raise typer.Exit(2) from None
    except StudyFailed as error:
        print(f"encircle: the study stopped: {error}", file=sys.stderr)
        raise typer.Exit(1) from None


@app.command("robot", context_settings=PASSED_ON, add_help_option=False)
def robot_command(context: typer.Context) -> None:
    """Run one robot as this process."""
    from agents.__main__ import main as robot_main

    raise typer.Exit(robot_main(context.args, "encircle robot"))


@app.command("world", context_settings=PASSED_ON, add_help_option=False)
def world_command(context: typer.Context) -> None:
    """Run the world as this process and wait for its robots."""
    from world.__main__ import main as world_main

    raise typer.Exit(world_main(context.args, "encircle world"))


@app.command("router", context_settings=PASSED_ON, add_help_option=False)
def router_command(context: typer.Context) -> None:
    """Route between world and robots on many hosts."""
    from protocol.router import main as router_main

    raise typer.Exit(router_main(context.args, "encircle router"))


@app.command("alive", context_settings=PASSED_ON, add_help_option=False)
def alive_command(context: typer.Context) -> None:
    """Say whether a router, the world or a robot of a run is there."""
    from protocol.alive import main as alive_main

    raise typer.Exit(alive_main(context.args, "encircle alive"))


if __name__ == "__main__":
    main()
