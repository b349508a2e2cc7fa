"""How far long work is, on standard error: a bar on a terminal, elsewhere a line now and then.

In a notebook the bar is an output of the cell.

The bar goes when the work ends; what stays is one line that says what was done, and nothing if it
was left: then an error says why.
"""

import secrets
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from html import escape
from math import inf
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar

from encircle.protocol.process.log import printable

Tell = Callable[[int, int], None]
PERIOD_S, DRAWN_S = 5.0, 0.1
"""How often a line is said, and a bar drawn."""


def no_progress(_done: int, _all: int) -> None:
    """Tell nobody."""


class Progress:
    """Progress of one piece of work; a context manager. Called with how much is done, and of what.

    ``unit``: what is counted. ``clock_s`` and ``console`` are for tests.
    """

    def __init__(
        self,
        name: str,
        unit: str = "runs",
        console: Console | None = None,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._name, self._unit = name, unit
        self._console = console or Console(stderr=True)
        self._clock_s = clock_s
        self._begun_s = self._reported_s = clock_s()
        self._period_s = DRAWN_S if self._console.is_terminal else PERIOD_S
        self._first: int | None = None
        self._all = 0
        self._bar = Bar(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=20),
            TextColumn("{task.fields[far]}"),
            console=self._console,
            transient=True,
            # Without a thread that draws: what is measured meanwhile is not to share its time.
            auto_refresh=False,
        )
        self._task = self._bar.add_task(printable(name), total=None, far="")

    def __enter__(self) -> "Progress":
        if self._console.is_terminal:
            self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        # Where it was never started, it would print an empty line.
        if self._console.is_terminal:
            self._bar.stop()
        if kind is None:
            count = f"{self._all} {self._unit}, " if self._all else ""
            self._say(f"{self._name}: {count}{_clock(self._clock_s() - self._begun_s)}")

    def __call__(self, done: int, of: int) -> None:
        """Show it, if it was not shown a moment ago."""
        self._all = of
        if self._first is None:
            self._first = done
        now_s = self._clock_s()
        if self._first != done and now_s - self._reported_s < self._period_s:
            return
        self._reported_s = now_s
        far = f"{done} of {of} {self._unit}, {self._times(done, of, now_s - self._begun_s)}"
        if self._console.is_terminal:
            self._bar.update(self._task, completed=done, total=of, far=far, refresh=True)
        elif self._first != done:
            self._say(f"{self._name}: {far}")

    def _times(self, done: int, of: int, passed_s: float) -> str:
        """How long it has taken so far, and will take if it goes on like that."""
        new = done - (self._first or 0)
        left = f", about {_clock(passed_s / new * (of - done))} left" if new > 0 else ""
        return _clock(passed_s) + left

    def _say(self, line: str) -> None:
        # Whole lines, however wide the terminal is: they are read by programs, too.
        self._console.print(printable(line), highlight=False, markup=False, soft_wrap=True)


def _clock(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))


@contextmanager
def notebook_progress(name: str, unit: str) -> Iterator[Tell]:
    """What shows progress as a bar below a notebook's cell; nothing is shown elsewhere.

    ``unit``: what is counted. Work that ends before it is told about leaves nothing.
    """
    if not in_notebook():
        yield no_progress
        return
    bar = NotebookBar(name, unit)
    yield bar
    bar.end()


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    # Who has not imported IPython is none.
    interactive: Any = sys.modules.get("IPython")
    shell = interactive.get_ipython() if interactive is not None else None
    return getattr(shell, "kernel", None) is not None


class NotebookBar:
    """A bar in the output of a notebook's cell; called with how much is done, and of what.

    ``clock_s`` and ``show`` are for tests; ``show`` displays HTML under the display's id.
    """

    def __init__(
        self,
        name: str,
        unit: str,
        clock_s: Callable[[], float] = time.monotonic,
        show: Callable[[str, bool], None] | None = None,
    ) -> None:
        self._name, self._unit, self._clock_s = name, unit, clock_s
        self._show = show or _displayed(f"encircle-{secrets.token_hex(8)}")
        self._begun_s, self._drawn_s = clock_s(), -inf
        self._is_drawn = False
        self._done = self._all = 0

    def __call__(self, done: int, of: int) -> None:
        """Show it, if it was not shown a moment ago."""
        self._done, self._all = done, of
        now_s = self._clock_s()
        # Of what is done at once, or was done before, nobody needs a bar.
        is_seen = self._is_drawn or done < of
        if is_seen and now_s - self._drawn_s >= DRAWN_S:
            self._drawn_s = now_s
            bar = f'<progress value="{done}" max="{max(of, 1)}"></progress> '
            self._draw(f"{bar}{escape(self._line(f'{done} of {of}'))}")

    def end(self) -> None:
        """Leave one line that says what was done, if there was a bar."""
        if self._is_drawn:
            self._draw(escape(self._line(f"{self._done}")))

    def _line(self, count: str) -> str:
        passed = _clock(self._clock_s() - self._begun_s)
        return f"{self._name}: {count} {self._unit}, {passed}"

    def _draw(self, html: str) -> None:
        self._show(f'<div style="opacity:0.75">{html}</div>', self._is_drawn)
        self._is_drawn = True


def _displayed(display_id: str) -> Callable[[str, bool], None]:
    """What displays HTML in the cell that runs; again in place of itself."""
    from IPython import display as displays

    display: Any = displays.display

    def show(html: str, is_update: bool) -> None:
        # A notebook that is made without them finds them by this.
        display(
            {"text/html": html, "text/plain": ""},
            metadata={"encircle": "progress"},
            raw=True,
            display_id=display_id,
            update=is_update,
        )

    return show
