"""Colours and shapes of everything that is seen of a hunt, on the page and in videos alike.

The hues are those of Okabe and Ito, which readers with a colour vision deficiency can tell apart.
Colour never stands alone: a packet's fate also has a shape of its own, and a robot its label.
Fates have four groups of loss, each with one colour: by chance, by the signal, by a radio or
network that is cut off, by too many packets. Nothing here draws.
"""

from dataclasses import dataclass
from types import MappingProxyType

ROBOTS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Colours of robots, by robot order; a seventh robot begins again."""

LIGHT = MappingProxyType(
    {
        "background": "#FFFFFF",
        "panel": "#F4F5F7",
        "ink": "#1B1F24",
        "muted": "#5B636E",
        "grid": "#E3E6EA",
        "line": "#B4BAC2",
        "obstacle": "#C4C8CE",
        "target": "#1B1F24",
        "ring": "#5B636E",
        "arrived": "#0072B2",
        "late": "#E69F00",
        "chance": "#D55E00",
        "signal": "#B4508A",
        "cut": "#7A818B",
        "crowd": "#1B1F24",
    }
)
DARK = MappingProxyType(
    {
        "background": "#12161C",
        "panel": "#1B2129",
        "ink": "#F1F3F5",
        "muted": "#A3ABB6",
        "grid": "#252C36",
        "line": "#4A5461",
        "obstacle": "#3C4550",
        "target": "#F1F3F5",
        "ring": "#A3ABB6",
        "arrived": "#56B4E9",
        "late": "#E69F00",
        "chance": "#F0742A",
        "signal": "#CC79A7",
        "cut": "#8B94A0",
        "crowd": "#F1F3F5",
    }
)
THEMES = MappingProxyType({"light": LIGHT, "dark": DARK})
"""Colours by theme and role. The roles from ``arrived`` on are those of packets."""


@dataclass(frozen=True, slots=True)
class PacketStyle:
    """How a packet of one fate looks: role of its colour, shape, and where its flight ends.

    ``shape``: ``disc`` and ``diamond`` arrive; ``x``, ``plus``, ``star`` (six arms), ``bar``,
    ``ring-x`` and ``box-x`` (an x in a circle or square) mark where a packet was lost.
    ``reach``: the share of the way from sender to receiver at which the flight ends.
    """

    role: str
    shape: str
    reach: float = 1.0


ARRIVED = PacketStyle("arrived", "disc")
LATE = PacketStyle("late", "diamond")
LOST = MappingProxyType(
    {
        "loss": PacketStyle("chance", "x", 0.5),
        "burst-loss": PacketStyle("chance", "star", 0.5),
        "trace-loss": PacketStyle("chance", "plus", 0.5),
        "distance-loss": PacketStyle("signal", "x", 0.7),
        "weak-signal": PacketStyle("signal", "star", 0.7),
        "out-of-range": PacketStyle("signal", "plus", 0.7),
        "sender-silent": PacketStyle("cut", "ring-x", 0.15),
        "receiver-silent": PacketStyle("cut", "box-x", 0.85),
        "outage": PacketStyle("cut", "x", 0.5),
        "partition": PacketStyle("cut", "bar", 0.5),
        "queue-full": PacketStyle("crowd", "box-x", 0.15),
        "contention": PacketStyle("crowd", "star", 0.5),
    }
)
"""By the name of the cause of loss."""
UNKNOWN_LOSS = PacketStyle("chance", "x", 0.5)
"""Of a cause that a later version has named."""


def robot_colour(robot: int) -> str:
    """The colour of the robot with this place in the robot order, as ``#RRGGBB``."""
    return ROBOTS[robot % len(ROBOTS)]


def css_variables(theme: str) -> str:
    """The colours of a theme as declarations of CSS variables: ``--ink: #1B1F24;`` and so on.

    Robots are ``--robot-0`` to ``--robot-5``.
    """
    named = {**THEMES[theme], **{f"robot-{k}": colour for k, colour in enumerate(ROBOTS)}}
    return " ".join(f"--{name}: {colour};" for name, colour in named.items())
