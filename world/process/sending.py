"""How the world hands its messages over to a link, so that none finds the way to its robot full.

Those of a round are one or two to each robot, for which there is room. A robot that a resumed run
takes in hears at once all that was observed before; whoever it is connected to drops what there is
no room for (``encircle.protocol.zenoh.lanes``). So it is told in lots, each after the one before
has arrived.
"""

from collections.abc import Iterator

from encircle.protocol.connections import Connection
from encircle.protocol.keys import parse_key, robot_key
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.world.coordinator.world_core import Outgoing

BATCH_BYTES_MAX = 256 * 1024
BATCH_S_MAX = 10.0


def send(connection: Connection, messages: Outgoing) -> None:
    """Hand messages over to a link, in their order."""
    for key, payload in messages:
        connection.send(key, payload)


def send_in_batches(connection: ZenohConnection, messages: Outgoing) -> None:
    """As ``send``, waiting between lots until they have arrived.

    One who does not say so, as one that is frozen, is told the rest without waiting.
    """
    arrives = True
    for number, batch in enumerate(batches(messages)):
        if number > 0 and arrives:
            run, robot, _ = parse_key(batch[0][0])
            arrives = connection.flush(robot_key(run, robot or "", "about"), BATCH_S_MAX)
        send(connection, batch)


def batches(messages: Outgoing) -> Iterator[Outgoing]:
    """The messages in their order, cut where one follows on the same key and a lot is full."""
    batch: Outgoing = []
    length, before = 0, ""
    for key, payload in messages:
        if key == before and length + len(payload) > BATCH_BYTES_MAX:
            yield batch
            batch, length = [], 0
        batch.append((key, payload))
        length, before = length + len(payload), key
    if batch:
        yield batch
