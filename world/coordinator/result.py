"""The result of a run."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

GO_ON, END = "go-on", "end"
WHEN_LOST = (GO_ON, END)
"""What a run may do when a robot is lost."""


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a run. ``packets_lost`` counts by cause; distances in m, robot order.

    ``departures``: (tick, robot, what) of robots that were lost, ``lost: `` and why, or came
    ``back``, as it happened. ``interventions``: the events that were given while it went on, as a
    scenario's file has them.

    A packet is one pose on one directed link. Sent and copied (by the radio) together are lost,
    delivered and in flight together.

    ``delay_s_mean``: of the packets that the radio delivers, the first copy of each, those in
    flight included; None if there are none, and where they go from robot to robot instead.
    ``delay_s_mean_asked``: what the scenario asks for, by its ``delay_model``, before delays become
    whole ticks.
    """

    captured: bool
    capture_tick: int | None
    ticks: int
    ended: str
    distances_m: tuple[float, ...]
    packets_sent: int
    packets_lost: dict[str, int]
    packets_copied: int
    packets_delivered: int
    packets_in_flight: int
    delay_model: str
    delay_s_mean_asked: float
    delay_s_mean: float | None
    contacts: int
    refused: dict[str, int]
    digest: str
    departures: tuple[tuple[int, str, str], ...] = ()
    interventions: tuple[Mapping[str, Any], ...] = ()
