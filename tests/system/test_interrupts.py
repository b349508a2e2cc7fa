"""Ctrl-C and SIGTERM at any time, to a whole process group: a line, status 1, and nothing left.

The moments are random: a number of lines that a command has said, and some time on top. A command
may come to its end before; then it says nothing of it.
"""

import json
import random
import re
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from helpers_commands import ours
from helpers_interrupts import Group
from helpers_waiting import completed, until

import encircle
from encircle.bundles.packing import pack
from encircle.protocol.process.interrupts import (
    STATUS,
    Interrupted,
    check,
    signals_held,
    signals_to,
)
from encircle.replay.replaying import replay
from encircle.runner.launch import free_endpoint

RUN = ("run", "sim1", "--set", "team.strategy=pursuit", "--set", "ticks_max=600", "--out", "made")
STUDY = ("study", "study.toml", "--out", "made")
WATCH = ("--watch", "--no-browser", "--watch-end", "run")
NOWHERE = ("--connect", "ENDPOINT", "--run", "none", "--join-timeout", "60")
COMMANDS: dict[str, tuple[int, float, tuple[str, ...]]] = {
    "run": (3, 1.5, ("encircle", *RUN)),
    "run in memory": (0, 2.5, ("encircle", *RUN, "--link", "memory")),
    "run and watch": (3, 2.0, ("encircle", *RUN, "--pace", "50", *WATCH)),
    "run in memory and watch": (
        1,
        2.5,
        ("encircle", *RUN, "--pace", "50", *WATCH, "--link", "memory"),
    ),
    "watch": (1, 1.0, ("encircle", "watch", "recorded", "--no-browser")),
    "watch over zenoh": (0, 1.5, ("encircle", "watch", *NOWHERE, "--no-browser")),
    "study": (2, 4.0, ("encircle", *STUDY)),
    "study over zenoh": (2, 4.0, ("encircle", *STUDY, "--link", "zenoh")),
    "reproduce": (4, 4.0, ("encircle", "reproduce", "--seeds", "2", "--out", "made")),
    "world": (1, 0.5, ("world", "sim1", "--listen", "ENDPOINT", "--run", "a", "--out", "made")),
    "world that connects": (0, 1.0, ("world", "sim1", *NOWHERE, "--out", "made")),
    "encircle world": (0, 2.0, ("encircle", "world", "sim1", *NOWHERE)),
    "robot": (0, 1.0, ("agents", "r1", *NOWHERE)),
    "encircle robot": (0, 2.0, ("encircle", "robot", "r1", *NOWHERE)),
    "router": (1, 0.3, ("encircle.protocol.programs.router", "--listen", "ENDPOINT")),
    "alive": (0, 1.0, ("encircle.protocol.programs.alive", "router", "--connect", "ENDPOINT")),
    "doctor": (0, 1.5, ("encircle", "doctor", "--connect", "ENDPOINT")),
    "replay": (0, 1.5, ("encircle", "replay", "recorded", "--check")),
    "trace": (0, 1.0, ("encircle", "trace", "recorded", "--out", "made.csv")),
    "certificates": (0, 1.0, ("encircle", "certificates", "made", "--robots", "16")),
    "scenarios": (0, 0.6, ("encircle", "scenarios")),
    "bundle": (0, 4.0, ("encircle", "bundle", "studied", "--out", "made.zip")),
    "verify": (0, 5.0, ("encircle", "verify", "studied.zip", "--all")),
}
"""How many lines one says before its end at most, a time in s, and the command."""
GOES_ON = ("run", "run in memory", "run and watch", "run in memory and watch", "study")
SERVES = ("router", "watch")
"""To be stopped is how they end, once they do nothing but serve."""
NODES = ("world", "world that connects", "encircle world", "robot", "encircle robot", "router")
ENDLESS = (*NODES, "watch", "watch over zenoh")
UNHEARD = ("Traceback", "leaked", "ignored", "KeyboardInterrupt", "Aborted", "Error")
NIGHTLY_SEEDS = 12


@pytest.fixture(scope="session")
def studied(tmp_path_factory) -> Path:
    """A folder with a small study, and its bundle beside it."""
    folder = tmp_path_factory.mktemp("studied")
    few = {"name": "few", "scenario": "sim1", "seeds": 12, "set": {"ticks_max": 40}}
    encircle.study(few, folder / "studied").run(workers=1)
    pack(folder / "studied", folder / "studied.zip")
    return folder


@pytest.fixture
def folder(tmp_path, studied) -> Path:
    shutil.copytree(studied, tmp_path, dirs_exist_ok=True)
    encircle.run("sim2", link="memory", out=tmp_path / "recorded")
    (tmp_path / "study.toml").write_text(
        'name = "two"\nscenario = "sim1"\nseeds = 12\n'
        '[[axes]]\nname = "loss"\nkey = "channel.loss.rate"\nvalues = [0.0, 0.5]\n'
        '[set]\n"channel.loss.model" = "bernoulli"\n'
    )
    return tmp_path


def started(name: str, folder: Path) -> Group:
    _, _, words = COMMANDS[name]
    group = Group(ours(*(free_endpoint() if w == "ENDPOINT" else w for w in words)), folder)
    group.wait_for_first_line()
    return group


def interrupt(name: str, seed: int, group: Group) -> None:
    """Send one signal or two, at moments that the seed decides."""
    draws = random.Random(f"{name} {seed}")
    lines, s_max, _ = COMMANDS[name]
    group.wait_for_lines(draws.randint(0, lines))
    time.sleep(draws.uniform(0.0, s_max))
    for pause_s in (0.0, draws.uniform(0.0, 0.3))[: draws.randint(1, 2)]:
        time.sleep(pause_s)
        group.signal(draws.choice((signal.SIGINT, signal.SIGINT, signal.SIGTERM)))


def check_end(name: str, group: Group) -> bool:
    """How it has ended is as promised; whether it was stopped, and not at its end before."""
    status, said = group.end(), group.said
    stopped = [line for line in said.splitlines() if "stopped by SIG" in line]
    assert not [word for word in UNHEARD if word in said], said
    assert list(group.scratch.iterdir()) == []
    assert len(stopped) <= 1, said
    if stopped:
        assert said.splitlines()[-1] == stopped[0]
        assert status == 1 or (name in SERVES and status == 0), said
    else:
        assert name not in ENDLESS, said
        assert status >= 0, f"killed by signal {-status}"
    return bool(stopped)


def is_over(run: Path) -> bool:
    """Whether a run has come to its end, and only its figure is not drawn."""
    summary = run / "summary.json"
    return summary.exists() and not json.loads(summary.read_text())["ended"].startswith("failed")


def check_next_start(name: str, folder: Path) -> None:
    """What was left does not keep the next start from its place."""
    words, made = COMMANDS[name][2], folder / "made"
    if is_over(made):
        return
    if (made / "recording.mcap").exists():
        words = ("encircle", "run", "--resume", "made")
    group = Group(ours(*words), folder)
    try:
        assert group.end() == 0, group.said
    finally:
        group.kill()
    if "run" in name:
        assert replay(folder / "made").same


@pytest.mark.parametrize("name", COMMANDS)
def test_in_the_first_moment_it_is_one_line(name, folder):
    group = started(name, folder)
    try:
        group.signal()
        # A list may be complete before the signal comes.
        if check_end(name, group):
            assert group.printed == ""
            assert len(group.said.splitlines()) == 1
    finally:
        group.kill()
    assert not (folder / "made").exists()


def sweep(name: str, seed: int, folder: Path) -> None:
    group = started(name, folder)
    try:
        interrupt(name, seed, group)
        stopped = check_end(name, group)
    finally:
        group.kill()
    if stopped and name in GOES_ON:
        check_next_start(name, folder)
    elif stopped and (folder / "made").exists():
        assert list((folder / "made").rglob("*")) == [] or "study" in name


@pytest.mark.parametrize("name", COMMANDS)
def test_at_any_time_it_ends_with_a_line_and_leaves_nothing(name, folder):
    sweep(name, 0, folder)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(1, NIGHTLY_SEEDS + 1))
@pytest.mark.parametrize("name", COMMANDS)
def test_at_many_times_it_ends_with_a_line_and_leaves_nothing(name, seed, folder):
    sweep(name, seed, folder)


NODE_KINDS = """
export ENCIRCLE_RUN=shared
{python} -m encircle.world sim1 --listen {endpoint} --out made \
    --set team.strategy=pursuit --set ticks_max=1000000 &
for robot in r1 r2 r3 r4; do {python} -m encircle.agents $robot --connect {endpoint} & done
wait
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_script_that_starts_world_and_robots_leaves_none_of_them(number, folder):
    """The shell has those that it starts in the background ignore Ctrl-C; they must not."""
    python = sys.executable
    script = NODE_KINDS.format(python=python, endpoint=free_endpoint())
    group = Group(["sh", "-c", script], folder)
    try:
        until(lambda: re.search("world: tick [1-9]", group.said), "the hunt to be under way")
        group.signal(number)
        group.end()
        said = group.said
    finally:
        group.kill()
    assert not [word for word in UNHEARD if word in said], said
    assert said.count(f"world: stopped by {number.name}\n") == 1
    for robot in ("r1", "r2", "r3", "r4"):
        # Its own signal ends it, or that the world tells it of its.
        last = [line for line in said.splitlines() if line.startswith(f"robot {robot}: ")][-1]
        assert last.endswith(f"stopped by {number.name}"), said
    assert replay(folder / "made").same


SIGNALLED_WHEN_OVER = """
import asyncio, signal, sys
from encircle.agents.process import robot, robot_life
from encircle.protocol.process.interrupts import exit_on_signal
from encircle.protocol.zenoh.endpoints import Endpoints
exit_on_signal("robot")
conclude, run_robot = robot_life.RobotLife.conclude, robot.run_robot
def signalled(*of):
    signal.raise_signal(signal.SIGTERM)
    return conclude(*of)
async def run(*of):
    status = await run_robot(*of)
    signal.raise_signal(signal.SIGTERM)
    return status
robot_life.RobotLife.conclude = signalled
options = robot_life.RobotOptions(join_s_max=0.1)
sys.exit(asyncio.run(run("r1", "none", Endpoints(listen=(sys.argv[1],)), options)))
"""


def test_a_robot_whose_end_has_come_says_why_whatever_signals_come_then():
    done = completed([sys.executable, "-c", SIGNALLED_WHEN_OVER, free_endpoint()])
    assert (done.returncode, done.stdout) == (1, "")
    _waits, last = done.stderr.splitlines()
    assert last.startswith("robot r1: the world of run none")
    assert "did not take this robot in within 0.1 s" in last


def work(*steps: Callable[[], None]) -> None:
    """Do this and that while signals are held."""
    with signals_held():
        for step in steps:
            step()


def raising(number: int) -> Callable[[], None]:
    return partial(signal.raise_signal, number)


INT, TERM = raising(signal.SIGINT), raising(signal.SIGTERM)


def test_what_is_held_is_raised_where_the_work_can_be_left():
    before, reached = signal.getsignal(signal.SIGINT), []
    with pytest.raises(Interrupted, match="stopped by SIGINT at tick 3"):
        work(INT, lambda: reached.append("after it"), partial(check, " at tick 3"), INT)
    assert reached == ["after it"]
    assert signal.getsignal(signal.SIGINT) is before
    check()


def test_what_is_held_is_raised_at_the_end_at_the_latest():
    with pytest.raises(Interrupted, match="stopped by SIGTERM"):
        work(TERM, INT)
    check()


def test_a_second_signal_while_the_work_is_left_is_not_kept_for_other_work():
    def left() -> None:
        try:
            check()
        finally:
            INT()

    with pytest.raises(Interrupted):
        work(INT, left)
    work(check)


def test_an_error_does_not_hide_a_signal():
    def fail() -> None:
        raise ValueError("of the work")

    with pytest.raises(Interrupted):
        work(INT, fail)
    with pytest.raises(ValueError, match="of the work"):
        work(fail)


def test_who_takes_signals_over_is_told_of_one_that_was_kept():
    told: list[str] = []
    with signals_held():
        signal.raise_signal(signal.SIGINT)
        with signals_to(told.append):
            assert told == ["SIGINT"]
            signal.raise_signal(signal.SIGTERM)
    assert told == ["SIGINT", "SIGTERM"]


def test_another_thread_than_the_main_one_holds_nothing_and_raises_nothing():
    before, outcome = signal.getsignal(signal.SIGINT), []
    look = lambda: outcome.append(signal.getsignal(signal.SIGINT))  # noqa: E731
    thread = threading.Thread(target=work, args=(look, check))
    thread.start()
    thread.join()
    assert outcome == [before]


def test_a_process_that_leaves_a_thread_at_work_ends_with_its_status_and_all_that_it_said():
    """Python's own way out would have the thread come back into what is being taken down."""
    program = """
import atexit, sys
from encircle.protocol.process.interrupts import exit_process, expect_library_threads
atexit.register(print, "taken down")
print("the last word", end="")
if sys.argv[1] == "at work":
    expect_library_threads()
exit_process(3)
"""
    for how, expected in (("done", "the last wordtaken down\n"), ("at work", "the last word")):
        done = completed([sys.executable, "-c", program, how])
        assert (done.returncode, done.stdout, done.stderr) == (3, expected, "")


def test_a_thread_that_other_peoples_code_has_started_does_not_keep_a_process_that_ends():
    program = """
import threading
from encircle.protocol.process.interrupts import exit_process
threading.Thread(target=threading.Event().wait).start()
print("the last word", end="")
exit_process(3)
"""
    done = completed([sys.executable, "-c", program])
    assert (done.returncode, done.stdout, done.stderr) == (3, "the last word", "")


def test_a_process_that_ends_in_the_middle_ends_also_where_nobody_can_be_told():
    program = """
import os, signal
from encircle.protocol.process import interrupts
interrupts.exit_on_signal("encircle")
interrupts.HELD_S_MAX = -1.0
os.close(2)
try:
    with interrupts.signals_held():
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
except BaseException as error:
    print("went on to", type(error))
"""
    done = completed([sys.executable, "-c", program])
    assert (done.returncode, done.stdout) == (STATUS, "")
