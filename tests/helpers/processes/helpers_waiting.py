"""Waiting in tests: for as long as there is progress, however long that takes.

How long a thing takes says how busy a machine is, not whether anything is wrong. So nothing here
limits the time that something takes, only the time in which nothing moves: neither what a test
watches (ticks, bytes), nor processor time of the test and of the processes that it has started. Who
waits for a turn on a crowded machine gets one now and then, and so is not taken for one that hangs.

Some tests are about a limit of the product, and have to wait for it to be over. ``ample_s`` gives
them one that nothing healthy reaches, by what this machine does at this moment.
"""

import contextlib
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from math import ceil
from pathlib import Path
from typing import Any, TypeVar

from encircle import Timeouts

T = TypeVar("T")

STILL_S_MAX = 120.0
STEP_S = 0.02
STEP_S_MIN = 0.001
"""Of the first look again; what is soon there is not waited for much longer than it takes."""
LOOK_PERIOD_S = 1.0
"""How often it is looked whether something moves, and the most that counts as waiting from one
look to the next: the test itself may have been waiting for a turn."""
WORK_S = 5.0
"""Processor time that counts as progress. Who hangs and looks around now and then uses less in
``STILL_S_MAX``, and who gets a twentieth of a processor uses more."""
CLOCK_TICK_S = 0.01
"""Of processor times in /proc."""
LONGEST_S = 3600.0
"""For limits of the product that nothing in a test is to reach."""
TIMEOUTS = Timeouts(join_s_max=LONGEST_S, answer_s_max=LONGEST_S)


def until(happened: Callable[[], T], what: str, progress: Callable[[], object] = lambda: None) -> T:
    """Wait for something, and return it; fails the test once nothing has moved for too long.

    ``progress``: what changes as long as all is well, beside processor time.
    """
    waited_s, looked_s, seen, step_s = 0.0, time.monotonic(), None, STEP_S_MIN
    while not (found := happened()):
        now_s = time.monotonic()
        if now_s - looked_s >= LOOK_PERIOD_S:
            waited_s, looked_s = waited_s + LOOK_PERIOD_S, now_s
            if (now := (progress(), worked_s() // WORK_S)) != seen:
                waited_s, seen = 0.0, now
            assert waited_s < STILL_S_MAX, f"waited in vain for {what}"
        time.sleep(step_s)
        step_s = min(2.0 * step_s, STEP_S)
    return found


def worked_s() -> float:
    """Processor time in s that this process and all that come from it have used so far."""
    used = {}
    parents = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it has ended meanwhile
            fields = path.read_text().rsplit(")", 1)[1].split()
            pid = int(path.parent.name)
            parents[pid] = int(fields[1])
            used[pid] = sum(map(int, fields[11:13])) * CLOCK_TICK_S
    ours = {int(Path("/proc/self").readlink().name)}
    while more := {pid for pid, parent in parents.items() if parent in ours} - ours:
        ours |= more
    return sum(used[pid] for pid in ours)


def ended(process: "subprocess.Popen[Any]", progress: Callable[[], object] = lambda: None) -> int:
    """The exit status of a process, waited for."""
    until(lambda: process.poll() is not None, f"the end of {process.args}", progress)
    assert process.returncode is not None
    return process.returncode


def communicated(process: "subprocess.Popen[Any]") -> tuple[Any, Any]:
    """``communicate``: all that a process still says until its end."""

    def over() -> tuple[Any, Any] | None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.communicate(timeout=STEP_S)
        return None

    return until(over, f"the end of {process.args}")


def completed(command: Sequence[str], **options: Any) -> "subprocess.CompletedProcess[str]":
    """``subprocess.run`` of a command with its output as text, whatever its exit status."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True} | options
    with subprocess.Popen(command, **options) as process:
        try:
            out, err = communicated(process)
        finally:
            process.kill()
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def result_of(future: "Future[T]") -> T:
    """What comes of a future, or what it raises."""
    until(future.done, "what comes of a call")
    return future.result()


def joined(thread: threading.Thread) -> None:
    """Wait for a thread's end."""
    until(lambda: not thread.is_alive(), f"the end of {thread.name}")


def taken(inbox: "queue.Queue[T] | queue.SimpleQueue[T]") -> T:
    """The next thing in a queue."""
    until(lambda: not inbox.empty(), "a thing in a queue")
    return inbox.get_nowait()


def ample_s() -> float:
    """A limit in s that is ample now for what takes little work, such as a robot's answer.

    It is several times what this machine needs at this moment to start a small program, which is
    some twenty times the work of an answer.
    """
    begun = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import numpy"], check=True)
    return float(ceil(max(1.0, 4.0 * (time.perf_counter() - begun))))
