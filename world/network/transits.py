"""The transit of each message of a run by the clock, worked out from its ledger.

A pair's packets are counted from the first that the receiver has received (a subscription takes a
moment). Not counted are packets that may still arrive: those without a receipt that were sent less
than ``SETTLE_S`` before the newest observation for which the world has a receipt, however many
commands were lost before.
"""

from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

from encircle.protocol.clocks import Offset, Offsets
from encircle.world.network.message_ledger import MessageLedger, Participation

SETTLE_S = 1.0


class Transit(NamedTuple):
    """One message's transit: ``delay_us`` is None if it was lost or one of its times is unknown.

    ``number``: the packet's, without meaning for other messages. ``error_us``: the bound on the
    error of the delay.
    """

    number: int
    lost: bool
    delay_us: float | None
    error_us: float


def offsets_of(ledger: MessageLedger, robot: str) -> Offsets:
    """How far a robot's clock is ahead of the world's, at any time."""
    return Offsets(
        [x for participation in ledger.participations[robot] for x in participation.exchanges]
    )


def transits_of(
    ledger: MessageLedger, sender: str, receiver: str, offsets: dict[str, Offsets]
) -> list[Transit]:
    """The transit of each packet that a robot has sent to another, in the order of sending.

    If packets go through the world, to the world and on with the next observation.
    """
    if not ledger.direct:
        return _transits_through_world(ledger, sender, receiver, offsets)
    transits: list[Transit] = []
    settle_ticks = round(SETTLE_S / ledger.tick_s)
    for sending in ledger.participations[sender]:
        for receiving in ledger.participations[receiver]:
            for number in _sent_during(sending, receiving, sender, settle_ticks, ledger):
                arrival_us = receiving.packet_arrivals_us.get(sender, {}).get(number)
                times = sending.packets.get(number)
                if arrival_us is None:
                    transits.append(Transit(number, True, None, 0.0))
                elif times is None:
                    transits.append(Transit(number, False, None, 0.0))
                else:
                    sender_offset = offsets[sender].of_remote(times.sent_us)
                    clocks = sender_offset, offsets[receiver].of_remote(arrival_us)
                    transits.append(transit_between(number, arrival_us - times.sent_us, clocks))
    return transits


def _transits_through_world(
    ledger: MessageLedger, sender: str, receiver: str, offsets: dict[str, Offsets]
) -> list[Transit]:
    """The transit of each packet to the world and that of the next observation, together."""
    observations = [
        (asked_us, tick, participation)
        for participation in ledger.participations[receiver]
        for tick, asked_us in known_observations(participation)
    ]
    times_us = [asked_us for asked_us, _, _ in observations]
    transits: list[Transit] = []
    for participation in ledger.participations[sender]:
        for number in packet_numbers(participation, ()):
            if number not in participation.packets:
                transits.append(Transit(number, True, None, 0.0))
                continue
            _, sent_us, arrival_us = participation.packets[number]
            index = bisect_right(times_us, arrival_us)
            if index == len(observations):
                # Whether the robot has received it is not known.
                continue
            asked_us, tick, receiving = observations[index]
            received_us = receiving.arrived_us.get(tick)
            if received_us is None:
                transits.append(Transit(number, True, None, 0.0))
                continue
            clocks = offsets[sender].at(arrival_us), offsets[receiver].of_remote(received_us)
            in_world_us = asked_us - arrival_us
            transits.append(transit_between(number, received_us - sent_us - in_world_us, clocks))
    return transits


def transit_between(
    number: int, apart_us: float, clocks: tuple[Offset | None, Offset | None]
) -> Transit:
    """A transit from the difference of its two times, by the clocks of sender and receiver."""
    sender, receiver = clocks
    if sender is None or receiver is None:
        return Transit(number, False, None, 0.0)
    delay_us = apart_us - receiver.offset_us + sender.offset_us
    return Transit(number, False, delay_us, sender.error_us + receiver.error_us)


def packet_numbers(participation: Participation, received: Sequence[int]) -> range:
    """The numbers of a participation's packets, as far as any node has received them."""
    last = max([*participation.packets, *received], default=participation.first_tick - 1)
    return range(participation.first_tick, last + 1)


def _sent_during(
    sending: Participation,
    receiving: Participation,
    sender: str,
    settle_ticks: int,
    ledger: MessageLedger,
) -> list[int]:
    """Numbers of the packets of one participation that count for one of the receiver's."""
    begins = [participation.first_tick for participation in ledger.participations[sender]]
    end = min((tick for tick in begins if tick > sending.first_tick), default=None)
    received = [
        number
        for number in receiving.packet_arrivals_us.get(sender, {})
        if number >= sending.first_tick and (end is None or number < end)
    ]
    if receiving.known_tick < 0:
        return []
    counted, first, last = [], min(received, default=-1), max(received, default=-1)
    for number, earliest_tick in _earliest_ticks(sending, received):
        settled = number <= last or earliest_tick <= receiving.known_tick - settle_ticks
        if number >= first and settled and earliest_tick >= receiving.first_tick:
            counted.append(number)
    return counted


def known_observations(participation: Participation) -> list[tuple[int, int]]:
    """Tick and time of each observation of which it is known whether it arrived."""
    return [
        (tick, asked_us)
        for tick, asked_us in participation.asked_us.items()
        if tick <= participation.known_tick
    ]


def _earliest_ticks(participation: Participation, received: Sequence[int]) -> list[tuple[int, int]]:
    """Each packet's number, and the tick at which it can have been sent at the earliest.

    The world knows the ticks of those that have reached it; the others are in between.
    """
    earliest, tick = [], participation.first_tick - 1
    for number in packet_numbers(participation, received):
        times = participation.packets.get(number)
        tick = times.tick if times is not None else tick + 1
        earliest.append((number, tick))
    return earliest
