"""The log for strangers' messages ends, and says so."""

import json
import subprocess
import sys
import threading
from types import SimpleNamespace

import pytest

from encircle.protocol.process.log import (
    KINDS_VARIABLE,
    LINES_MAX,
    LineKind,
    bounded_log,
    kind_and_text,
    say,
    say_error,
)


def lines_logged(capsys, log, count):
    for number in range(count):
        log(f"line {number}")
    captured = capsys.readouterr()
    assert captured.out == "", "standard output belongs to results"
    return captured.err.splitlines()


@pytest.mark.parametrize("limit", [1, 3, LINES_MAX])
def test_as_many_lines_as_allowed_are_shown_then_one_that_says_so_then_none(capsys, limit):
    shown = lines_logged(capsys, bounded_log(limit), 4 * limit)
    assert shown[:limit] == [f"line {number}" for number in range(limit)]
    assert len(shown) == limit + 1
    assert "not shown" in shown[-1]


def test_below_the_limit_nothing_is_said_about_it(capsys):
    assert lines_logged(capsys, bounded_log(5), 4) == [f"line {number}" for number in range(4)]


def test_the_default_limit_is_the_named_one(capsys):
    assert len(lines_logged(capsys, bounded_log(), LINES_MAX + 10)) == LINES_MAX + 1


def test_logs_count_for_themselves(capsys):
    first, second = bounded_log(1), bounded_log(1)
    lines_logged(capsys, first, 3)
    assert lines_logged(capsys, second, 1)[0] == "line 0"


@pytest.mark.parametrize("kind", LineKind)
def test_a_starter_that_asks_for_it_is_told_what_kind_a_line_is(kind, capsys, monkeypatch):
    say_error("a\tb", kind=kind)
    assert capsys.readouterr().err == "a\\tb\n"
    monkeypatch.setenv(KINDS_VARIABLE, "yes")
    say_error("a\tb", kind=kind)
    assert kind_and_text(capsys.readouterr().err.rstrip("\n")) == (kind, "a\\tb")


@pytest.mark.parametrize("line", ["Traceback: x", "", "event", "refusals\tx", "\tx"])
def test_a_line_without_a_kind_is_a_problem(line):
    assert kind_and_text(line) == (LineKind.PROBLEM, line)


@pytest.mark.parametrize(("name", "tell"), [("stdout", say), ("stderr", say_error)])
def test_a_line_is_one_write_so_that_lines_of_several_threads_stay_whole(monkeypatch, name, tell):
    writes = []
    stream = SimpleNamespace(write=writes.append, flush=lambda: None)
    monkeypatch.setattr(sys, name, stream)
    tell("one", "two")
    assert writes == ["one\n", "two\n"]


def test_who_does_not_read_one_stream_does_not_keep_what_is_said_on_the_other(monkeypatch):
    said = []

    def write(_line):
        # As long as nobody reads this one, another thread has something to say on the other one.
        thread = threading.Thread(target=say_error, args=("told",), daemon=True)
        thread.start()
        thread.join()

    unread = SimpleNamespace(write=write, flush=lambda: None)
    monkeypatch.setattr(sys, "stdout", unread)
    monkeypatch.setattr(sys, "stderr", SimpleNamespace(write=said.append, flush=lambda: None))
    say("unread")
    assert said == ["told\n"]


def test_reports_that_several_threads_print_at_once_stay_whole():
    program = """
import sys, threading
from encircle.world.process.reports import json_reports
sys.setswitchinterval(1e-6)
with json_reports() as report:
    work = lambda: [report({"tick": n}) for n in range(2000)]
    threads = [threading.Thread(target=work) for _ in range(4)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
"""
    out = subprocess.check_output([sys.executable, "-c", program], text=True)
    ticks = [json.loads(line)["tick"] for line in out.splitlines()]
    assert sorted(ticks) == sorted([*range(2000)] * 4)
