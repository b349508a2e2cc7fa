"""What came of a run."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Result:
    """What came of a run. ``lost`` counts packets by cause; distances in m, robot order."""

    captured: bool
    capture_tick: int | None
    ticks: int
    ended: str
    distances_m: tuple[float, ...]
    packets_sent: int
    packets_lost: dict[str, int]
    packets_delivered: int
    packets_in_flight: int
    contacts: int
    refused: dict[str, int]
    digest: str
