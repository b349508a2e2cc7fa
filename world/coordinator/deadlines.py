"""Deadlines by the clock, and what a robot does whose command has not come by then.

Deadline k is at ``start + k * tick_s``, never the last one plus a tick, so that errors do not add
up. A tick ends at the first deadline that is still to come when the one before it is done. So a
world that is late leaves out the deadlines that it has missed, which are counted; it does not
catch up by ticks in quick succession, which no robot could answer in time. Simulated time then
falls behind the clock by one tick for each.

A robot repeats the step of its newest command, by tick, for a bounded number of ticks, whether that
came in time or late; then it stands still.
"""

from math import floor
from typing import NamedTuple

from encircle.protocol.messages import Point

ZERO_STEP: Point = (0.0, 0.0)
COARSE_US = 100_000


def next_deadline(slot: int, elapsed_s: float, tick_s: float) -> int:
    """The first deadline's number after ``slot`` that is later than ``elapsed_s`` since start."""
    due = floor(elapsed_s / tick_s) + 1
    # The quotient may be rounded up to a deadline that is still to come.
    if (due - 1) * tick_s > elapsed_s:
        due -= 1
    return max(slot + 1, due)


class HeldCommand(NamedTuple):
    """A robot's newest command: its tick and its step in m."""

    tick: int
    step: Point


def step_at(held_command: HeldCommand | None, tick: int, hold_ticks_max: int) -> Point | None:
    """The step that is made at a tick, None if the robot has nothing to go by and stands still."""
    if held_command is None or tick - held_command.tick > hold_ticks_max:
        return None
    return held_command.step


class DeadlineStatistics:
    """How well a world has kept its deadlines: how late it woke, how often it was not done in time.

    Ticks are counted by how many us after its deadline each began, from ``COARSE_US`` on rounded up
    to whole ms, so that quantiles need no list of all ticks.
    """

    def __init__(self) -> None:
        self.ticks = 0
        self.overruns = 0
        self.skipped = 0
        self.late_us_max = 0
        self._late_us: dict[int, int] = {}

    def add_lateness(self, late_s: float) -> None:
        """The end of a tick has begun so long after its deadline."""
        late_us = max(0, round(late_s * 1e6))
        self.ticks += 1
        self.late_us_max = max(self.late_us_max, late_us)
        counted = late_us if late_us < COARSE_US else -(-late_us // 1000) * 1000
        self._late_us[counted] = self._late_us.get(counted, 0) + 1

    def add_advance(self, slots: int) -> None:
        """The next deadline is so many after the last: more than one is an overrun."""
        if slots > 1:
            self.overruns += 1
            self.skipped += slots - 1

    def late_us_quantile(self, share: float) -> int:
        """The smallest lateness that at least this share of ticks did not exceed, as counted."""
        below, wanted = 0, share * self.ticks
        for late_us, ticks in sorted(self._late_us.items()):
            below += ticks
            if below >= wanted:
                return min(late_us, self.late_us_max)
        return 0

    def as_dict(self) -> dict[str, float]:
        """For summaries; times in s."""
        return {
            "ticks": self.ticks,
            "overruns": self.overruns,
            "deadlines_skipped": self.skipped,
            "jitter_s_median": self.late_us_quantile(0.5) / 1e6,
            "jitter_s_p99": self.late_us_quantile(0.99) / 1e6,
            "jitter_s_max": self.late_us_max / 1e6,
        }
