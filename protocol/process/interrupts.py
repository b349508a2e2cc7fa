"""Ctrl-C and SIGTERM from a process's first line on: one line, status 1, and nothing left behind.

Python turns Ctrl-C into an exception that strikes anywhere: in an import, in a record that is being
written, in what cleans up after another Ctrl-C. Here a signal never raises anything by itself. It
ends the process at once, as long as there is nothing to put in order (``exit_on_signal``); or a
function is told (``signals_to``); or it is kept until the work can be left (``signals_held`` and
``check``).

A terminal sends Ctrl-C to all processes of a command. Those that another one ends in order are
shielded from it.

This module imports little, because it is the first that a process imports.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

from encircle.protocol.process.log import printable

NUMBERS = (signal.SIGINT, signal.SIGTERM)
STATUS = 1


class Interrupted(KeyboardInterrupt):
    """The work was left because of a signal; the message says which and where."""


HELD_S_MAX = 2.0
"""After how long in s a signal that is kept is taken to be kept in vain when another one comes."""


class _State:
    """What has come.

    ``name``: of a signal that is kept, since ``held_s``; ``ending``: whether one has ever come.
    ``who``: how the process calls itself if it ends at once.

    ``before``, ``after``: what a process that ends at once says more; ``to_parent``: Ctrl-C is not
    for this process; ``at_work``: a library has threads of its own.
    """

    name = who = ""
    held_s = 0.0
    ending = False
    before = after = ""
    to_parent = False
    at_work = False


def exit_on_signal(who: str) -> None:
    """From now on SIGINT and SIGTERM end this process at once, with a line of ``who``."""
    _State.who = who

    def end(name: str) -> None:
        if not _State.ending:
            with suppress(OSError):
                # A terminal has put ^C there.
                start = "\r" if os.isatty(2) else ""
                line = f"{who}: {_State.before}stopped by {name}{_State.after}"
                os.write(2, f"{start}{printable(line)}\n".encode())
            os._exit(STATUS)

    for number in NUMBERS:
        signal.signal(number, _handler(end))


@contextmanager
def exit_message(after: str, before: str = "") -> Iterator[None]:
    """While this lasts, a process that ends at once says this after the signal, and before it."""
    kept = _State.before, _State.after
    _State.before, _State.after = before, after
    try:
        yield
    finally:
        _State.before, _State.after = kept


def exit_process(status: int) -> NoReturn:
    """End the process; what comes now changes nothing any more."""
    for number in NUMBERS:
        signal.signal(number, signal.SIG_IGN)
    if _State.at_work or _other_threads():
        # A thread that comes back from there while Python is taken down brings the process down;
        # one that other people's code has started and that never ends would keep it.
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, AttributeError):
                stream.flush()
        os._exit(status)
    sys.exit(status)


def _other_threads() -> bool:
    main = threading.main_thread()
    return any(t is not main and not t.daemon for t in threading.enumerate())


def end_is_known() -> None:
    """Have ``exit_on_signal`` ignore what comes now: this process has said how it ends."""
    _State.ending = True


def expect_library_threads() -> None:
    """A library has threads of its own that call Python: ``exit_process`` must not take it down."""
    _State.at_work = True


@contextmanager
def signals_to(take: Callable[[str], None]) -> Iterator[None]:
    """While this lasts, signals call ``take`` with their name, and leave it to it to end the work.

    It is called in the main thread, between any two instructions. In another thread than the main
    one nothing changes.
    """
    if threading.current_thread() is not threading.main_thread() or _State.to_parent:
        yield
        return

    def note(name: str) -> None:
        _State.ending = True
        take(name)

    before = {number: signal.signal(number, _handler(note)) for number in NUMBERS}
    try:
        if name := _take_held():
            take(name)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def signals_held() -> Iterator[None]:
    """While this lasts, signals are kept for ``check`` or the end of this context, which raise."""
    with signals_to(_hold):
        try:
            yield
        except Interrupted:
            # A second one, while the work was being left.
            _take_held()
            raise
        finally:
            check()


def check(where: str = "") -> None:
    """Raise ``Interrupted`` if a signal is kept; ``where``: how far the work is."""
    if _State.name and threading.current_thread() is threading.main_thread():
        raise Interrupted(f"stopped by {_take_held()}{where}")


def is_signal_held() -> bool:
    """Whether a signal waits for ``check``; other threads may look, too."""
    return bool(_State.name)


def leave_sigint_to_parent() -> None:
    """Ctrl-C is not for this process: its parent ends it in order."""
    _State.to_parent = True
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def sigint_blocked() -> Iterator[None]:
    """Processes that are started meanwhile do not hear Ctrl-C, not even while they start."""
    # What is blocked is inherited; a handler would be there only after the first imports.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _hold(name: str) -> None:
    if not _State.name:
        _State.name, _State.held_s = name, time.monotonic()
    elif _State.who and time.monotonic() - _State.held_s > HELD_S_MAX:
        # As in a policy that never answers.
        line = f"{_State.who}: stopped by {name}, in the middle of what it was doing"
        with suppress(OSError):
            os.write(2, f"{printable(line)}\n".encode())
        os._exit(STATUS)


def _take_held() -> str:
    name, _State.name = _State.name, ""
    return name


def _handler(take: Callable[[str], None]) -> Callable[[int, Any], None]:
    return lambda number, _frame: take(signal.Signals(number).name)
