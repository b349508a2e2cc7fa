"""What a person is told while something runs, and how a finished line says how it ended."""

import io
import itertools
import json
import re
import signal
from types import SimpleNamespace

import pytest
from helpers_commands import ours
from helpers_interrupts import Group
from helpers_terminal import COLUMNS, screen, seen
from helpers_waiting import until
from rich.console import Console

from encircle.agents.process import status_lines as robots
from encircle.cli.display import Display
from encircle.progress import PERIOD_S, Progress
from encircle.runner.launch import free_endpoint
from encircle.world.loading.load import load
from encircle.world.process import reports as worlds

RESULT = {"ticks": 32, "captured": True, "ended": "captured", "distances_m": [1.0, 1.25]}
STARTED = {"started": {"world": 1, "r1": 2}, "run": "a", "endpoint": "tcp/127.0.0.1:1"}
LONG = ("--set", "team.strategy=pursuit", "--set", "ticks_max=1000000")


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


def console(terminal: bool) -> Console:
    return Console(file=io.StringIO(), force_terminal=terminal, width=COLUMNS, _environ={})


def shown(to: Console) -> list[str]:
    """What is left on the screen, or in the file."""
    # A terminal's driver does that.
    return screen(to.file.getvalue().replace("\n", "\r\n"))


def leave(progress: Display | Progress, *told: tuple) -> None:
    """Tell it something, and leave it by an error."""
    with pytest.raises(ValueError, match="error"):
        _fail(progress, told)


def _fail(progress: Display | Progress, told: tuple) -> None:
    with progress:
        for arguments in told:
            (progress.update if isinstance(progress, Display) else progress)(*arguments)
        raise ValueError("error")


@pytest.mark.parametrize("terminal", [True, False])
def test_a_finished_hunt_says_how_it_ended(terminal, clock):
    to = console(terminal)
    with Display(load("sim1"), "zenoh", to, clock) as display:
        display.update(STARTED)
        display.update({"tick": 31, "distances_m": [2.0, 3.0]})
        clock.now_s = 2.0
        display.update({"result": RESULT})
    assert shown(to) == [
        "run a at tcp/127.0.0.1:1",
        "processes: world 1, r1 2",
        "ended: captured at tick 32, 1.0 1.2 m to the target, 0:00:02",
    ]


@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize("reports", [[], [{"tick": 3, "distances_m": [2.0]}]])
def test_nothing_stale_stands_before_an_error(terminal, reports, clock):
    to = console(terminal)
    failed = {"result": RESULT | {"ended": "failed: r3 did not join"}}
    leave(Display(load("sim1"), "zenoh", to, clock), *((report,) for report in [*reports, failed]))
    assert shown(to) == []


def test_where_there_is_no_terminal_a_long_hunt_says_where_it_is_now_and_then(clock):
    to = console(terminal=False)
    with Display(load("sim1"), "memory", to, clock) as display:
        for tick in range(200):
            clock.now_s = 0.1 * tick
            display.update({"tick": tick, "distances_m": [2.0] * 8})
    assert shown(to) == [
        f"tick {tick} of 300, 2.0 2.0 2.0 2.0 2.0 2.0 ... m to the target"
        for tick in (50, 100, 150)
    ]


@pytest.mark.parametrize("terminal", [True, False])
def test_progress_ends_in_a_line_and_is_silent_about_what_was_left(terminal, clock):
    to = console(terminal)
    with Progress("loss", "runs", to, clock) as tell:
        for done in range(7):
            clock.now_s = 0.5 * done
            tell(done, 6)
    assert shown(to) == ["loss: 6 runs, 0:00:03"]
    left = console(terminal)
    leave(Progress("loss", "runs", left, clock), (1, 6))
    assert shown(left) == []


def test_progress_without_a_terminal_is_a_line_now_and_then_with_the_time_that_is_left(clock):
    to = console(terminal=False)
    with Progress("loss", "runs", to, clock) as tell:
        for done in range(101):
            clock.now_s = 0.2 * done
            # Ten were there before.
            tell(10 + done, 110)
    *lines, last = shown(to)
    assert lines[0] == "loss: 35 of 110 runs, 0:00:05, about 0:00:15 left"
    assert len(lines) == 20.0 // PERIOD_S
    assert last == "loss: 110 runs, 0:00:20"


def test_progress_on_a_terminal_is_a_bar_on_one_line(clock):
    to = console(terminal=True)
    with Progress("loss", "runs", to, clock) as tell:
        tell(0, 6)
        clock.now_s = 1.0
        tell(2, 6)
        [line] = shown(to)
    assert line.startswith("loss ━")
    assert line.endswith("2 of 6 runs, 0:00:01, about 0:00:02 left")
    assert len(line) < COLUMNS


def test_a_world_tells_a_person_a_tick_a_second_and_who_is_missing(clock, capsys):
    tell = worlds.ConsoleReporter(clock)
    for waited in (["r1", "r2"], ["r2"], []):
        tell({"expected": waited})
    for tick in range(40):
        clock.now_s = 0.1 * tick
        lost = ["r2"] if tick >= 20 else []
        tell({"tick": tick, "distances_m": [2.0, 3.04], "lost": lost})
        tell({"departure": [tick, "r2", "lost"]})
    tell({"waiting": ["r1"]})
    tell({"waiting": []})
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [
        "world: waiting for r1, r2",
        "world: waiting for r2",
        "world: every robot is there",
        "world: tick 10, 2.0 3.0 m to the target",
        "world: tick 20, without r2, 2.0 3.0 m to the target",
        "world: tick 30, without r2, 2.0 3.0 m to the target",
        "world: waiting for the answer of r1",
    ]


def test_a_large_team_is_told_of_in_a_short_line():
    names = [f"r{k}" for k in range(1, 17)]
    line = worlds.tick_line(7, names, [2.0] * 16)
    assert line == (
        "world: tick 7, without r1, r2, r3, r4, r5, r6, and 10 more,"
        " 2.0 2.0 2.0 2.0 2.0 2.0 and 10 more m to the target"
    )


def test_a_robot_says_each_change_and_a_tick_a_second(clock):
    said: list[str] = []
    look = robots.StatusLog(said.append, clock).update
    setup = SimpleNamespace(first_tick=0, team=("r1", "r2"))

    def core(tick: int, setups: int, setup: SimpleNamespace | None, mode: str = "search"):
        return SimpleNamespace(run="a", tick=tick, setups=setups, setup=setup, mode=mode)

    look(core(-1, 0, None))
    for tick in range(20):
        clock.now_s = 0.1 * tick
        look(core(tick, 1, setup, "search" if tick < 15 else "encircle"))
    clock.now_s = 5.0
    look(core(19, 1, setup))  # nothing new
    look(core(39, 2, SimpleNamespace(first_tick=40, team=("r1", "r2"))))
    look(core(-1, 0, None))  # the next run of one that stays
    look(core(0, 1, setup))
    assert said == [
        "joined run a, one of 2 robots",
        "tick 10, search",
        "joined run a again at tick 40, one of 2 robots",
        "joined run a, one of 2 robots",
    ]


def test_parties_started_by_hand_say_what_they_do_and_json_only_where_asked(tmp_path):
    endpoint = free_endpoint()
    where = ("--run", "hand")
    world = Group(ours("world", "sim1", "--listen", endpoint, *where, *LONG), tmp_path)
    nodes = [world]
    try:
        world.wait_for_first_line()
        join = ("--connect", endpoint, *where)
        nodes += [Group(ours("agents", f"r{k}", *join), tmp_path) for k in (1, 2, 3)]
        nodes.append(Group(ours("agents", "r4", *join, "--quiet"), tmp_path))
        until(lambda: len(re.findall("world: tick [1-9]", world.said)) >= 2, "two lines of ticks")
        until(lambda: re.search("robot r1: tick [1-9]", nodes[1].said), "a robot's tick")
        world.signal(signal.SIGTERM)
        statuses = [node.end() for node in nodes]
    finally:
        for node in nodes:
            node.kill()
    assert statuses == [1] * 5
    assert [node.printed for node in nodes] == [""] * 5
    assert re.search(r"world: waiting for (r\d, )*r\d\n", world.said)
    assert re.search(r"world: tick \d+(, \d+\.\d| \d+\.\d){4} m to the target\n", world.said)
    assert world.said.endswith("world: stopped by SIGTERM\n")
    lines = [re.sub(r"\d+, \w+$", "N, MODE", line) for line in nodes[1].said.splitlines()]
    assert [line for line, _ in itertools.groupby(lines) if "connecting" not in line] == [
        f"robot r1: waiting for the world of run hand at {endpoint}",
        "robot r1: joined run hand, one of 4 robots",
        "robot r1: tick N, MODE",
        "robot r1: run hand ended: failed: stopped by SIGTERM",
    ]
    assert nodes[4].said == "robot r4: run hand ended: failed: stopped by SIGTERM\n"


def test_a_world_that_is_asked_for_json_says_it_on_standard_output(tmp_path):
    options = ("--listen", free_endpoint(), "--run", "a", "--join-timeout", "0.5", "--json")
    world = Group(ours("world", "sim1", *options), tmp_path)
    try:
        assert world.end() == 1
    finally:
        world.kill()
    reports = [json.loads(line) for line in world.printed.splitlines()]
    assert reports[-1]["result"]["ended"].startswith("failed: r1, r2, r3, r4 did not join")
    assert "tick" not in world.said


@pytest.mark.parametrize("link", ["zenoh", "memory"])
def test_on_a_terminal_a_run_leaves_the_line_of_its_end_and_the_table(link, tmp_path):
    status, lines = seen(ours("encircle", "run", "sim1", "--link", link), tmp_path)
    assert status == 0
    place = 2 if link == "zenoh" else 0
    assert re.fullmatch(
        r"ended: captured at tick 32, [0-9. ]+ m to the target, 0:\d\d:\d\d", lines[place]
    )
    assert lines[place + 1].startswith("Simulation 1")
    assert not [line for line in lines if "━" in line and "tick" in line]


def test_on_a_terminal_an_error_stands_alone(tmp_path):
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "precious").write_text("keep me")
    status, lines = seen(ours("encircle", "run", "sim1", "--out", "made"), tmp_path)
    assert status == 2
    [line] = lines
    assert line.startswith("encircle: made is not empty")
