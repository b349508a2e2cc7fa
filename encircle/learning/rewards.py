"""The reward: capture, and a potential that shows the way to it.

All robots get the same. At every step,

    r = capture [captured] - tick + discount Phi(s') - Phi(s),
    Phi(s) = -near n(s) - around a(s),   Phi(captured) = 0.

n is by how much the robots that a capture takes, the nearest ones, are farther away than the stop
distance, in the mean and in sensing ranges. a is the largest gap between two neighbours' bearings
as seen from the target, less that of an even ring, over what it can be at most: from 0 to 1. Robots
that are lost count for neither. Both are of the truth, which the learner gets to know through its
reward alone.

Shaping of this form changes no optimal policy, if the learner's discount is the same (Ng, Harada,
Russell, "Policy invariance under reward transformations", ICML 1999). Capture ends the episode, so
its potential is 0. At the time limit it is not: an episode that is truncated goes on as far as the
learner is concerned, who is to estimate the rest from the last observation.
"""

from dataclasses import dataclass, fields
from math import atan2, hypot, isfinite, pi

from encircle.world.arena.engine import Arena, ArenaState


@dataclass(frozen=True, slots=True)
class Reward:
    """The weights of the reward; ``ValueError`` for one that is none."""

    capture: float = 10.0
    """What a capture gives."""
    tick: float = 0.0
    """What each tick costs."""
    near: float = 1.0
    """Weight of the distances in the potential, per sensing range."""
    around: float = 1.0
    """Weight of the largest gap in the potential."""
    discount: float = 0.99
    """The learner's discount of a tick."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            high = 1.0 if field.name == "discount" else float("inf")
            if type(value) not in (int, float) or not (isfinite(value) and 0.0 <= value <= high):
                limit = "from 0 to 1" if high == 1.0 else "a number that is not negative"
                raise ValueError(f"reward.{field.name} = {value!r}: must be {limit}")

    def potential(self, arena: Arena, state: ArenaState) -> float:
        """Phi of a state."""
        if state.captured:
            return 0.0
        near, around = measures_of(arena, state)
        return -self.near * near - self.around * around

    def of_step(self, captured: bool, before: float, after: float) -> dict[str, float]:
        """The parts of a step's reward: of the capture, the tick and the shaping.

        ``before``, ``after``: the potentials.
        """
        return {
            "capture": self.capture if captured else 0.0,
            "tick": 0.0 - self.tick,
            "shaping": self.discount * after - before,
        }


def measures_of(arena: Arena, state: ArenaState) -> tuple[float, float]:
    """The two parts of the potential, n and a; both are 1 if no robot is there."""
    scenario, count = arena.scenario, len(arena.ids)
    rays = state.positions[:count] - state.positions[count]
    if state.away is not None:
        rays = rays[state.away == 0]
    if not len(rays):
        return 1.0, 1.0
    pairs = rays.tolist()
    nearest = sorted([hypot(x, y) for x, y in pairs])[: scenario.capture_count]
    stop_m = scenario.capture.stop_distance_m
    beyond_m = sum([max(0.0, distance - stop_m) for distance in nearest]) / len(nearest)
    bearings = sorted([atan2(y, x) for x, y in pairs])
    following = [*bearings[1:], bearings[0] + 2.0 * pi]
    widest = max([after - before for before, after in zip(bearings, following, strict=True)])
    even = 2.0 * pi / len(pairs)
    around = (widest - even) / (2.0 * pi - even) if len(pairs) > 1 else 1.0
    return beyond_m / scenario.team.sensing_range_m, around
