"""Which moment of a run each picture of a video shows."""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import floor

HOLD_S = 1
"""How long the last picture stays, in s."""
PICTURES_MAX = 100_000


@dataclass(frozen=True, slots=True)
class Timeline:
    """A run of ticks as pictures. ``ticks``: of the run; ``fps``: pictures per second.

    ``ticks_per_picture``: how far the run goes from one picture to the next.
    """

    first_tick: int
    ticks: int
    fps: Fraction
    ticks_per_picture: Fraction

    @property
    def moving(self) -> int:
        """How many pictures show the run before its end."""
        return -floor(-Fraction(self.ticks) / self.ticks_per_picture)

    @property
    def count(self) -> int:
        """How many pictures there are: the run, then its end for ``HOLD_S``."""
        return self.moving + max(1, round(HOLD_S * self.fps))

    def moments(self) -> Iterator[float]:
        """The moment of each picture, in ticks."""
        for k in range(self.moving):
            yield self.first_tick + float(k * self.ticks_per_picture)
        for _ in range(self.count - self.moving):
            yield float(self.first_tick + self.ticks)

    def times_s(self) -> list[Fraction]:
        """When each picture is shown, and the end of the last, in s."""
        return [Fraction(k) / self.fps for k in range(self.count + 1)]


def timeline_of(
    first_tick: int, last_tick: int, tick_s: float, fps: float, speed: float
) -> Timeline:
    """The timeline of a run whose ticks are ``tick_s`` long, shown ``speed`` times as fast."""
    # Decimal numbers exactly: 0.1 s at 30 pictures per second is three pictures a tick.
    rate = Fraction(str(fps))
    step = Fraction(str(speed)) / (rate * Fraction(str(tick_s)))
    return Timeline(first_tick, last_tick - first_tick, rate, step)
