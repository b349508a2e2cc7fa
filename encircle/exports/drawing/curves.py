"""The numbers of a frame that are plotted over time, by group and name.

What is unknown at a tick is left out, so that a plot has a gap there: an age before the first
packet, the share delivered before any fate was decided, the slack where it is not defined.
"""

from encircle.scene.frame import Frame
from encircle.scene.stage import Stage

VALUES = ("gap_rad", "slack_rad", "age_ticks_mean", "conflicts", "delivery_share")
"""Names of the team's numbers: largest angular gap around the target, slack of the occupied angles,
mean age of what robots have of each other, pairs of robots with one goal, share of packets that
was delivered lately."""


def values(frame: Frame) -> dict[str, float]:
    """Those of ``VALUES`` that are known."""
    v = frame.values
    found = (v.gap_rad, v.slack_rad, v.age_ticks_mean, v.conflicts, v.delivery)
    named = zip(VALUES, found, strict=True)
    return {name: float(value) for name, value in named if value is not None}


def distances_m(stage: Stage, frame: Frame) -> dict[str, float]:
    """Each robot's distance from the target in m."""
    return dict(zip(stage.robots, map(float, frame.values.distances_m), strict=True))


def ages_ticks(stage: Stage, frame: Frame, receiver: int) -> dict[str, int]:
    """How old what a robot has of each of its peers is, in ticks."""
    row = zip(stage.robots, frame.ages[receiver], strict=True)
    return {sender: age for k, (sender, age) in enumerate(row) if k != receiver and age >= 0}
