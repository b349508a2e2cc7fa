"""Waiting for progress, the machine's load, and that no test waits in another way."""

import ast
import os
import subprocess
import sys
import threading
from concurrent.futures import Future
from pathlib import Path

import helpers_waiting
import pytest
from helpers_paths import TESTS
from helpers_waiting import completed, result_of, until, worked_s
from under_load import load

EXEMPT = {"helpers_waiting.py", "test_waiting.py", "robot.py"}
"""What waits for all others, and a program of another make."""
CLOCKS = {"monotonic", "perf_counter", "time", "process_time"}


class Clock:
    """A time that passes only where somebody sleeps."""

    now_s = 0.0

    def monotonic(self):
        return self.now_s

    def sleep(self, duration_s):
        self.now_s += duration_s


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(helpers_waiting, "time", made)
    monkeypatch.setattr(helpers_waiting, "worked_s", lambda: 0.0)
    return made


def test_what_moves_is_waited_for_however_long_it_takes(clock):
    assert until(lambda: clock.now_s > 1e4, "the end", lambda: clock.now_s // 100)


def test_who_only_gets_a_share_of_the_processor_is_waited_for(clock, monkeypatch):
    monkeypatch.setattr(helpers_waiting, "worked_s", lambda: clock.now_s / 20.0)
    assert until(lambda: clock.now_s > 1e4, "the end")


@pytest.mark.parametrize("share", [0.0, 0.002])
def test_where_nothing_moves_the_test_fails_in_the_end(clock, monkeypatch, share):
    """Also where what hangs looks around now and then."""
    monkeypatch.setattr(helpers_waiting, "worked_s", lambda: share * clock.now_s)
    with pytest.raises(AssertionError, match="waited in vain for a miracle"):
        until(lambda: False, "a miracle")
    assert 100.0 < clock.now_s < 400.0


def test_a_test_that_was_itself_frozen_has_not_waited(clock):
    """As if it had no turn for an hour, again and again."""
    looks = []

    def happened():
        clock.now_s += 3600.0
        looks.append(clock.now_s)
        return len(looks) > 50

    assert until(happened, "the end")


def test_the_work_of_what_was_started_counts():
    before_s = worked_s()
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as busy:
        until(lambda: worked_s() - before_s > 0.5, "a busy process to have worked")
        busy.kill()


def test_a_command_that_fails_says_how():
    script = "import sys; print('out'); print('err', file=sys.stderr); sys.exit(3)"
    done = completed([sys.executable, "-c", script])
    assert (done.returncode, done.stdout, done.stderr) == (3, "out\n", "err\n")


def test_what_a_call_raises_comes_through():
    future = Future()
    threading.Timer(0.05, future.set_exception, [KeyError("gone")]).start()
    with pytest.raises(KeyError, match="gone"):
        result_of(future)


def test_busy_loops_are_there_as_long_as_they_are_to():
    with load(2) as loops:
        assert all(Path(f"/proc/{pid}").exists() for pid in loops)
    assert not any(Path(f"/proc/{pid}").exists() for pid in loops)


def test_busy_loops_do_not_outlive_who_started_them():
    script = "import os, under_load as u\nwith u.load(1) as p: print(*p, flush=True); os._exit(0)"
    environment = os.environ | {"PYTHONPATH": str(TESTS / "helpers" / "processes")}
    done = completed([sys.executable, "-c", script], env=environment, stderr=subprocess.DEVNULL)
    pid = int(done.stdout)
    until(lambda: not Path(f"/proc/{pid}").exists(), "the busy loop's end")


def limits_of(source):
    """Lines of a test that read a clock, or bound a wait by a time."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            bounds = [keyword.value for keyword in node.keywords if keyword.arg == "timeout"]
            bounded = any(not isinstance(b, ast.Name) or b.id != "LONGEST_S" for b in bounds)
            named = node.func.attr if isinstance(node.func, ast.Attribute) else ""
            given = [a for a in node.args if isinstance(a, ast.Constant)]
            number = any(isinstance(a.value, (int, float)) for a in given)
            if bounded or (named in ("join", "wait") and number and not _is(node.func, "stop")):
                yield node.lineno
        elif isinstance(node, ast.Attribute) and node.attr in CLOCKS and _is(node, "time"):
            yield node.lineno


def _is(attribute, name):
    """Whether it is an attribute of that name; who waits for ``stop`` waits for the next round."""
    return isinstance(attribute.value, ast.Name) and attribute.value.id == name


@pytest.mark.parametrize(
    ("line", "limits"),
    [
        ("process.communicate(timeout=20)", 1),
        ("session.get(key, timeout=LONGEST_S)", 0),
        ("thread.join(20.0)", 1),
        ("begun = time.monotonic()", 1),
        ("done.wait(5)", 1),
        ("stop.wait(0.02)", 0),
        ("', '.join(names)", 0),
        ("time.sleep(0.1)", 0),
    ],
)
def test_a_time_limit_is_found(line, limits):
    assert len(list(limits_of(line))) == limits


@pytest.mark.parametrize(
    "path",
    [path for path in sorted(TESTS.rglob("*.py")) if path.name not in EXEMPT],
    ids=lambda path: path.name,
)
def test_no_test_limits_the_time_that_something_takes(path):
    found = list(limits_of(path.read_text()))
    assert not found, f"lines {found}: wait with helpers_waiting, for progress"
