"""What the network does to each link, worked out from the ledger of a run by the clock.

Two things are kept apart. *Injected* is what the channel model did, as the scenario asks: fates, by
cause. *Actual* is what the network under it did: loss, from gaps in numbering, and one-way delay.

Links. The world sends observations to a robot, which sends commands and packets to the world. Where
packets go from robot to robot, each directed pair is a link too, known from its receiver's
receipts. What a robot has received is known up to the newest observation for which the world has a
receipt, however many commands were lost before. ``encircle.world.network.transits`` says which
packets count.

Delay. A one-way delay compares two clocks, so it is as good as what is known of their difference
(``encircle.protocol.clocks``); every figure stands with that bound. It is refused where the bound
is larger than half a tick: a delay matters to a hunt in whole ticks, and beyond that the wrong one
could be taken. It is refused too where a clock was set anew in mid-run.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from statistics import median
from typing import Any

import numpy as np

from encircle.protocol.clocks import Offset, Offsets
from encircle.world.network.message_ledger import MessageLedger
from encircle.world.network.transits import (
    Transit,
    known_observations,
    offsets_of,
    packet_numbers,
    transit_between,
    transits_of,
)

ERROR_TICKS_MAX = 0.5
WORLD = "world"
NO_OFFSET = Offset(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class LinkReport:
    """What the network did to one kind of message from one node to another.

    ``unknown``: how many more were sent of which it is not known whether they arrived, as far as
    that can be counted: observations after the newest one with a receipt. Delays in s; they are
    None if ``delay_refused`` gives a reason. ``delay_s_error``: the bound on the error of a delay,
    as the median over the messages.
    """

    sender: str
    receiver: str
    carries: str
    sent: int
    lost: int
    delay_s_median: float | None
    delay_s_p99: float | None
    delay_s_error: float | None
    delay_refused: str | None
    unknown: int = 0


def report(ledger: MessageLedger) -> dict[str, Any]:
    """All links, actual and injected, and the clocks, for summaries."""
    offsets = {robot: offsets_of(ledger, robot) for robot in ledger.robots}
    return {
        "tick_s": ledger.tick_s,
        "links": [asdict(link) for link in links_of(ledger)],
        "injected": injected(ledger),
        "clocks": [clock(robot, offsets[robot]) for robot in ledger.robots],
        "incomplete_from_tick": ledger.full_tick,
    }


def links_of(ledger: MessageLedger) -> list[LinkReport]:
    """What the network did to each link, those to and from the world first."""
    offsets = {robot: offsets_of(ledger, robot) for robot in ledger.robots}
    links: list[LinkReport] = []
    for robot in ledger.robots:
        if ledger.participations[robot]:
            links += _links_to_world(ledger, robot, offsets[robot])
    for sender in ledger.robots:
        for receiver in ledger.robots:
            if sender != receiver and ledger.direct:
                transits = transits_of(ledger, sender, receiver, offsets)
                clock_problem = unsteady(sender, offsets) or unsteady(receiver, offsets)
                links.append(_link((sender, receiver, "pose"), transits, ledger, clock_problem))
    return links


def injected(ledger: MessageLedger) -> list[dict[str, Any]]:
    """What the channel model did to each link."""
    links = []
    for (sender, receiver), link in sorted(ledger.injected.items()):
        arrived = sum(link.ticks.values())
        ticks = sum(delay_ticks * packets for delay_ticks, packets in link.ticks.items())
        links.append(
            {
                "sender": sender,
                "receiver": receiver,
                "sent": link.sent,
                "copied": link.copied,
                "lost": dict(sorted(link.lost.items())),
                "delay_s_mean": ticks * ledger.tick_s / arrived if arrived else None,
                "delay_s_max": max(link.ticks, default=0) * ledger.tick_s if arrived else None,
            }
        )
    return links


def clock(robot: str, offsets: Offsets) -> dict[str, Any]:
    """A robot's clock against the world's, at its last answer."""
    last = offsets.last
    trips = [x.round_trip_us for x in offsets.exchanges]
    return {
        "robot": robot,
        "offset_s": None if last is None else last.offset_us / 1e6,
        "error_s": None if last is None else last.error_us / 1e6,
        "round_trip_s_median": median(trips) / 1e6 if trips else None,
        "steady": offsets.is_steady,
    }


def _links_to_world(ledger: MessageLedger, robot: str, offsets: Offsets) -> list[LinkReport]:
    """Observations to a robot, commands and packets from it."""
    down, up, packets = [], [], []
    given = got = unknown = 0
    for participation in ledger.participations[robot]:
        asked = known_observations(participation)
        unknown += len(participation.asked_us) - len(asked)
        for tick, asked_us in asked:
            received_us = participation.arrived_us.get(tick)
            if received_us is None:
                down.append(Transit(0, True, None, 0.0))
            else:
                down.append(
                    transit_between(
                        0, received_us - asked_us, (NO_OFFSET, offsets.of_remote(received_us))
                    )
                )
        answered = max(0, participation.last_tick - participation.first_tick + 1)
        given, got = (
            given + answered - participation.missed - participation.passed_over,
            got + participation.commands,
        )
        for exchange in participation.exchanges:
            offset = offsets.at(exchange.arrival_us)
            up.append(
                transit_between(0, exchange.arrival_us - exchange.answered_us, (offset, NO_OFFSET))
            )
        for number in packet_numbers(participation, ()):
            if number not in participation.packets:
                packets.append(Transit(number, True, None, 0.0))
                continue
            _, sent_us, arrival_us = participation.packets[number]
            offset = offsets.at(arrival_us)
            packets.append(transit_between(number, arrival_us - sent_us, (offset, NO_OFFSET)))
    clock_problem = unsteady(robot, {robot: offsets})
    observations = _link((WORLD, robot, "observation"), down, ledger, clock_problem)
    commands = _link((robot, WORLD, "command"), up, ledger, clock_problem)
    return [
        replace(observations, unknown=unknown),
        replace(commands, sent=given, lost=max(0, given - got)),
        _link((robot, WORLD, "pose"), packets, ledger, clock_problem),
    ]


def _link(
    name: tuple[str, str, str],
    transits: Sequence[Transit],
    ledger: MessageLedger,
    clock_problem: str | None,
) -> LinkReport:
    sent, lost = len(transits), sum(transit.lost for transit in transits)
    known = [transit for transit in transits if transit.delay_us is not None]
    error_us = median([transit.error_us for transit in known]) if known else None
    refused = clock_problem or delay_refusal(error_us, ledger.tick_s)
    if transits and all(transit.lost for transit in transits):
        refused = "nothing has arrived"
    error_s = None if error_us is None else error_us / 1e6
    if refused:
        return LinkReport(*name, sent, lost, None, None, error_s, refused)
    delays_s = np.array([transit.delay_us for transit in known], float) / 1e6
    p50, p99 = np.quantile(delays_s, (0.5, 0.99)).tolist()
    return LinkReport(*name, sent, lost, p50, p99, error_s, None)


def delay_refusal(error_us: float | None, tick_s: float) -> str | None:
    """Why delays with this error are not given, None if they are."""
    if error_us is None:
        return "no exchange of times"
    limit_us = ERROR_TICKS_MAX * tick_s * 1e6
    if error_us > limit_us:
        return f"the clocks are not known to within half a tick ({limit_us / 1e3:.2f} ms)"
    return None


def unsteady(robot: str, offsets: dict[str, Offsets]) -> str | None:
    """Why a robot's clock is not to be relied on, None if it is."""
    return None if offsets[robot].is_steady else f"the clock of {robot} was set anew in mid-run"
