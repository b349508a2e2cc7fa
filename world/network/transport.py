"""What the network does to each link, worked out from the ledger of a run by the clock.

Two things are kept apart. *Injected* is what the modelled radio was told to do: fates, by cause.
*Actual* is what the network under it did: loss, from gaps in numbering, and one-way delay.

Links. The world sends observations to a robot, which sends commands and packets to the world; where
robots hear each other, each directed pair is a link too, as its receiver tells of it. What a
robot has heard is known up to an observation of which it has told, however many commands were lost
before. A pair's packets are counted from the first that the receiver has heard (a subscription
takes a moment), but for those that may still come: sent less than ``SETTLE_S`` before that
observation, and not heard.

Delay. A one-way delay compares two clocks, so it is as good as what is known of their difference
(``encircle.protocol.clocks``); every figure stands with that bound. It is refused where the bound
is larger than half a tick: a delay matters to a hunt in whole ticks, and beyond that the wrong one
could be taken. It is refused too where a clock was set anew in mid-run.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from encircle.protocol.clocks import Offset, Offsets
from encircle.world.network.message_ledger import MessageLedger, Participation

SETTLE_S = 1.0
ERROR_TICKS_MAX = 0.5
WORLD = "world"
NO_OFFSET = Offset(0.0, 0.0)


class Transit(NamedTuple):
    """One message's way. ``delay_us`` is None if it was lost, or one of its times is not known.

    ``number`` is a packet's, and of no meaning for other messages.
    """

    number: int
    lost: bool
    delay_us: float | None
    error_us: float


@dataclass(frozen=True, slots=True)
class LinkReport:
    """What the network did to one sort of message from one party to another.

    ``unknown``: how many more were sent of which it is not known whether they came, as far as that
    can be counted: observations after the last of which a robot has told. Delays in s; with
    ``delay_refused``, the reason, they are None. ``delay_s_error``: the bound on the error of each,
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
    """What the network did to each link, legs to and from the world first."""
    offsets = {robot: offsets_of(ledger, robot) for robot in ledger.robots}
    found: list[LinkReport] = []
    for robot in ledger.robots:
        if ledger.participations[robot]:
            found += _legs(ledger, robot, offsets[robot])
    for sender in ledger.robots:
        for receiver in ledger.robots:
            if sender != receiver and ledger.direct:
                transits = transits_of(ledger, sender, receiver, offsets)
                clock_problem = unsteady(sender, offsets) or unsteady(receiver, offsets)
                found.append(_link((sender, receiver, "pose"), transits, ledger, clock_problem))
    return found


def offsets_of(ledger: MessageLedger, robot: str) -> Offsets:
    """How far a robot's clock is ahead of the world's, at any time."""
    return Offsets(
        [x for participation in ledger.participations[robot] for x in participation.exchanges]
    )


def transits_of(
    ledger: MessageLedger, sender: str, receiver: str, offsets: dict[str, Offsets]
) -> list[Transit]:
    """The way of each packet that a robot has sent to another, in the order of sending.

    Where robots do not hear each other, through the world: there and on with the next observation.
    """
    if not ledger.direct:
        return _transits_through_world(ledger, sender, receiver, offsets)
    transits: list[Transit] = []
    settle_ticks = round(SETTLE_S / ledger.tick_s)
    for there in ledger.participations[sender]:
        for here in ledger.participations[receiver]:
            for number in _sent_during(there, here, sender, settle_ticks, ledger):
                heard = here.heard.get(sender, {}).get(number)
                sent = there.packets.get(number)
                if heard is None:
                    transits.append(Transit(number, True, None, 0.0))
                elif sent is None:
                    transits.append(Transit(number, False, None, 0.0))
                else:
                    at = offsets[sender].of_remote(sent[1]), offsets[receiver].of_remote(heard)
                    transits.append(_transit(number, heard - sent[1], at))
    return transits


def _transits_through_world(
    ledger: MessageLedger, sender: str, receiver: str, offsets: dict[str, Offsets]
) -> list[Transit]:
    """The legs of each packet to the world and of the next observation, together."""
    asked = [
        (us, tick, participation)
        for participation in ledger.participations[receiver]
        for tick, us in _known(participation)
    ]
    asked_us = [us for us, _, _ in asked]
    transits: list[Transit] = []
    for participation in ledger.participations[sender]:
        for number in _numbers(participation, ()):
            if number not in participation.packets:
                transits.append(Transit(number, True, None, 0.0))
                continue
            _, sent_us, arrival_us = participation.packets[number]
            index = bisect_right(asked_us, arrival_us)
            if index == len(asked):
                # Whether the robot was told of it is not known.
                continue
            on_us, tick, here = asked[index]
            received_us = here.arrived_us.get(tick)
            if received_us is None:
                transits.append(Transit(number, True, None, 0.0))
                continue
            at = offsets[sender].at(arrival_us), offsets[receiver].of_remote(received_us)
            transits.append(_transit(number, received_us - sent_us - (on_us - arrival_us), at))
    return transits


def injected(ledger: MessageLedger) -> list[dict[str, Any]]:
    """What the modelled radio did to each directed link."""
    found = []
    for (sender, receiver), link in sorted(ledger.injected.items()):
        arrived = sum(link.ticks.values())
        ticks = sum(n * k for n, k in link.ticks.items())
        found.append(
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
    return found


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


def _legs(ledger: MessageLedger, robot: str, offsets: Offsets) -> list[LinkReport]:
    """Observations to a robot, commands and packets from it."""
    down, up, packets = [], [], []
    given = got = unknown = 0
    for participation in ledger.participations[robot]:
        asked = _known(participation)
        unknown += len(participation.asked_us) - len(asked)
        for tick, asked_us in asked:
            received_us = participation.arrived_us.get(tick)
            if received_us is None:
                down.append(Transit(0, True, None, 0.0))
            else:
                down.append(
                    _transit(0, received_us - asked_us, (NO_OFFSET, offsets.of_remote(received_us)))
                )
        answered = max(0, participation.last_tick - participation.first_tick + 1)
        given, got = (
            given + answered - participation.missed - participation.passed_over,
            got + participation.commands,
        )
        for exchange in participation.exchanges:
            offset = offsets.at(exchange.arrival_us)
            up.append(_transit(0, exchange.arrival_us - exchange.answered_us, (offset, NO_OFFSET)))
        for number in _numbers(participation, ()):
            if number not in participation.packets:
                packets.append(Transit(number, True, None, 0.0))
                continue
            _, sent_us, arrival_us = participation.packets[number]
            offset = offsets.at(arrival_us)
            packets.append(_transit(number, arrival_us - sent_us, (offset, NO_OFFSET)))
    clock_problem = unsteady(robot, {robot: offsets})
    observations = _link((WORLD, robot, "observation"), down, ledger, clock_problem)
    commands = _link((robot, WORLD, "command"), up, ledger, clock_problem)
    return [
        replace(observations, unknown=unknown),
        replace(commands, sent=given, lost=max(0, given - got)),
        _link((robot, WORLD, "pose"), packets, ledger, clock_problem),
    ]


def _transit(number: int, apart_us: float, clocks: tuple[Offset | None, Offset | None]) -> Transit:
    """A way from the difference of its two times, by the clocks of sender and receiver."""
    sender, receiver = clocks
    if sender is None or receiver is None:
        return Transit(number, False, None, 0.0)
    delay_us = apart_us - receiver.offset_us + sender.offset_us
    return Transit(number, False, delay_us, sender.error_us + receiver.error_us)


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
    """Why delays with this error are not told, None if they are."""
    if error_us is None:
        return "no exchange of times"
    limit_us = ERROR_TICKS_MAX * tick_s * 1e6
    if error_us > limit_us:
        return f"the clocks are not known to within half a tick ({limit_us / 1e3:.2f} ms)"
    return None


def unsteady(robot: str, offsets: dict[str, Offsets]) -> str | None:
    """Why nothing that a robot's clock says is to be relied on, None if it is."""
    return None if offsets[robot].is_steady else f"the clock of {robot} was set anew in mid-run"


def _numbers(participation: Participation, heard: Sequence[int]) -> range:
    """The numbers of a stay's packets, as far as anyone has seen them."""
    last = max([*participation.packets, *heard], default=participation.first_tick - 1)
    return range(participation.first_tick, last + 1)


def _sent_during(
    there: Participation, here: Participation, sender: str, settle_ticks: int, ledger: MessageLedger
) -> list[int]:
    """Numbers of the packets from ``there`` that count for a receiver's stay."""
    later = [s.first_tick for s in ledger.participations[sender] if s.first_tick > there.first_tick]
    end = min(later, default=None)
    heard = [
        number
        for number in here.heard.get(sender, {})
        if number >= there.first_tick and (end is None or number < end)
    ]
    if here.known_tick < 0:
        return []
    found, first, last = [], min(heard, default=-1), max(heard, default=-1)
    for number, earliest in _earliest_ticks(there, heard):
        settled = number <= last or earliest <= here.known_tick - settle_ticks
        if number >= first and settled and earliest >= here.first_tick:
            found.append(number)
    return found


def _known(participation: Participation) -> list[tuple[int, int]]:
    """Tick and time of each observation of which it is known whether it came."""
    return [
        (tick, us)
        for tick, us in participation.asked_us.items()
        if tick <= participation.known_tick
    ]


def _earliest_ticks(participation: Participation, heard: Sequence[int]) -> list[tuple[int, int]]:
    """Each packet's number, and the tick at which it can have been sent at the earliest.

    The world knows the ticks of those that have reached it; the others are in between.
    """
    found, tick = [], participation.first_tick - 1
    for number in _numbers(participation, heard):
        tick = participation.packets[number][0] if number in participation.packets else tick + 1
        found.append((number, tick))
    return found
