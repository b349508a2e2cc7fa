"""What a policy reads from outside while it decides: clock, random numbers, files, environment.

The interpreter tells a profiler of each call, so it does not matter by which name a function was
imported. numpy's global generator is compiled and tells nobody: its state is compared instead.
"""

import builtins
import datetime
import gc
import os
import random
import socket
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

import numpy as np

from encircle.agents.policies.interface import View
from encircle.check_results import CheckResult
from encircle.conformance.purity import Parts
from encircle.conformance.subject import Subject

CLOCKS = (
    *("time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns"),
    *("process_time", "process_time_ns", "thread_time", "thread_time_ns", "sleep"),
    *("localtime", "gmtime", "ctime", "strftime"),
)
NOW = ("now", "utcnow", "today")
CLOCK_ADVICE = "time is view.tick * view.tick_s"
RANDOM_ADVICE = (
    "draw from a generator made at each decision, such as"
    " numpy.random.default_rng([view.tick, view.own])"
)
FILE_ADVICE = "read files when the module is imported, and set the rest by own parameters"
_PYTHON_GENERATOR: Any = random.random.__self__  # type: ignore[attr-defined]  # a method of it
_CODES = {
    random.Random.seed.__code__: ("seeds a generator from outside", RANDOM_ADVICE),
    type(os.environ).__getitem__.__code__: ("reads the environment", FILE_ADVICE),
    socket.socket.__init__.__code__: ("opens a socket", "what peers are to hear is Decision.say"),
}


@dataclass
class _Calls:
    """A profiler that keeps the first call to the outside, and where in the policy it was."""

    subject: Subject
    seen: tuple[str, str] | None = None
    _builtins: dict[int, tuple[str, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in CLOCKS:
            self._builtins[id(getattr(time, name))] = f"calls time.{name}", CLOCK_ADVICE
        self._builtins[id(os.urandom)] = "draws from os.urandom", RANDOM_ADVICE
        self._builtins[id(os.getpid)] = "asks for the process's number", RANDOM_ADVICE
        self._builtins[id(builtins.open)] = "opens a file", FILE_ADVICE

    def __call__(self, frame: FrameType, event: str, function: Any) -> None:
        if self.seen is not None:
            return
        what = None
        if event == "c_call":
            what = self._builtins.get(id(function)) or _of_method(function)
        elif event == "call":
            what = _CODES.get(frame.f_code)
            if frame.f_code is random.Random.seed.__code__ and frame.f_locals["a"] is not None:
                what = None
        if what is not None:
            self.seen = f"{what[0]}{self.subject.place_of(frame)}", what[1]


def _of_method(function: Any) -> tuple[str, str] | None:
    """What a call of a built-in method reads from outside, if it does."""
    of, name = getattr(function, "__self__", None), getattr(function, "__name__", "")
    if of is _PYTHON_GENERATOR:
        return "draws from Python's global generator", RANDOM_ADVICE
    if name in NOW and isinstance(of, type) and issubclass(of, datetime.date):
        return f"calls {of.__name__}.{name}", CLOCK_ADVICE
    return None


def check_outside(subject: Subject, parts: Parts) -> CheckResult:
    """No clock, random numbers, files or environment while it decides."""
    # What is imported at the first use reads files.
    np.random.get_state()
    policy = subject.ask
    for part in parts:
        memory: Any = None
        for view in part.views:
            state = _numpy_state()
            calls = _Calls(subject)
            answer = _profiled(policy, memory, view, calls)
            seen = calls.seen
            if seen is None and _numpy_state() != state:
                place = _line_that_draws(subject, memory, view)
                seen = f"draws from numpy's global generator{place}", RANDOM_ADVICE
            if seen is not None:
                return CheckResult("outside", "wrong", f"a decision {seen[0]}", seen[1])
            memory = answer[0]
    return CheckResult("outside", "ok", "no clock, random numbers, files or environment")


def _profiled(policy: Callable[..., Any], memory: Any, view: View, calls: _Calls) -> Any:
    # Collecting garbage calls what other libraries have asked to be called.
    collects = gc.isenabled()
    gc.disable()
    sys.setprofile(calls)
    try:
        return policy(memory, view)
    finally:
        sys.setprofile(None)
        if collects:
            gc.enable()


def _numpy_state() -> tuple[Any, ...]:
    state: dict[str, Any] = np.random.get_state(legacy=False)
    return state["state"]["key"].tobytes(), state["state"]["pos"], state["gauss"]


def _line_that_draws(subject: Subject, memory: Any, view: View) -> str:
    """The line of the policy after which numpy's global generator has another state."""
    state, places, last = _numpy_state(), [""], [""]

    def trace(frame: FrameType, event: str, _argument: Any) -> Any:
        if places == [""] and _numpy_state() != state:
            places[0] = last[0]
        # An event comes before its line is run.
        last[0] = subject.place_of(frame) if event == "line" else last[0]
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        subject.ask(memory, view)
    finally:
        sys.settrace(before)
    return places[0] or last[0]
