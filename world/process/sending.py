"""How the world hands its messages over to a link, so that none finds the way to its robot full.

Those of a round are one or two to each robot, for which there is room. A robot that a resumed run
takes in hears at once all that was observed before; whoever it is connected to drops what there is
no room for (``encircle.protocol.zenoh.lanes``). So it is told in lots, each after the one before
has arrived.
"""

from collections.abc import Iterator

from encircle.protocol.connections import Link
from encircle.protocol.keys import parse_key, robot_key
from encircle.protocol.zenoh.connection import ZenohLink
from encircle.world.coordinator.world_core import Outgoing

LOT_BYTES_MAX = 256 * 1024
ARRIVES_S_MAX = 10.0


def send(link: Link, messages: Outgoing) -> None:
    """Hand messages over to a link, in their order."""
    for key, payload in messages:
        link.send(key, payload)


def tell(link: ZenohLink, messages: Outgoing) -> None:
    """As ``send``, waiting between lots until they have arrived.

    One who does not say so, as one that is frozen, is told the rest without waiting.
    """
    arrives = True
    for number, lot in enumerate(lots(messages)):
        if number > 0 and arrives:
            run, robot, _ = parse_key(lot[0][0])
            arrives = link.flush(robot_key(run, robot or "", "about"), ARRIVES_S_MAX)
        send(link, lot)


def lots(messages: Outgoing) -> Iterator[Outgoing]:
    """The messages in their order, cut where one follows on the same key and a lot is full."""
    lot: Outgoing = []
    length, before = 0, ""
    for key, payload in messages:
        if key == before and length + len(payload) > LOT_BYTES_MAX:
            yield lot
            lot, length = [], 0
        lot.append((key, payload))
        length, before = length + len(payload), key
    if lot:
        yield lot
