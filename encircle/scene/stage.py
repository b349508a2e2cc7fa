"""What stays the same in a run: who takes part, how large bodies are, what the radio does."""

from dataclasses import dataclass

from encircle.protocol.process.log import printable
from encircle.scene.channel_text import channel_sentences
from encircle.world.channel.loss_causes import CAUSES
from encircle.world.scenario.model import Scenario

NO_CAUSE = "none"


@dataclass(frozen=True, slots=True)
class Stage:
    """The constants of a run; robots in robot order.

    ``clock``: ``lockstep`` or ``wall``; ``policies``: name of each robot's; ``obstacles``: x, y and
    radius in m; ``sensing_ranges_m``: of each robot; ``capture_count``: robots that a capture
    takes; ``behaviour``: the target's; ``channel``: what the radio does, in short sentences;
    ``causes``: names of the causes of loss, that of code k at index k.
    """

    run: str
    title: str
    seed: int
    tick_s: float
    ticks_max: int
    clock: str
    robots: tuple[str, ...]
    policies: tuple[str, ...]
    radius_m: float
    target_radius_m: float
    obstacles: tuple[tuple[float, float, float], ...]
    sensing_ranges_m: tuple[float, ...]
    stop_distance_m: float
    capture_count: int
    behaviour: str
    channel: tuple[str, ...]
    causes: tuple[str, ...]


def stage_of(scenario: Scenario, seed: int, run: str) -> Stage:
    """The stage of a run of a scenario with a seed; texts of others as visible characters."""
    robots = scenario.ids
    return Stage(
        run=run,
        title=printable(scenario.title),
        seed=seed,
        tick_s=scenario.tick_s,
        ticks_max=scenario.ticks_max,
        clock=scenario.clock,
        robots=robots,
        policies=tuple([printable(scenario.strategy_of(robot)) for robot in robots]),
        radius_m=scenario.team.radius_m,
        target_radius_m=scenario.target.radius_m,
        obstacles=tuple([(*o.position, o.radius_m) for o in scenario.obstacles]),
        sensing_ranges_m=tuple([scenario.parameters_of(r)["sensing_range_m"] for r in robots]),
        stop_distance_m=scenario.capture.stop_distance_m,
        capture_count=scenario.capture_count,
        behaviour=printable(scenario.target.behaviour),
        channel=tuple(map(printable, channel_sentences(scenario))),
        causes=tuple([CAUSES.get(code, NO_CAUSE) for code in range(max(CAUSES) + 1)]),
    )
