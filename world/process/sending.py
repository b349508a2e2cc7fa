"""How the world sends its messages, so that no queue on the way to a robot overflows.

A round has one or two messages for each robot, for which there is room. A robot that joins a
resumed run gets all earlier observations at once, and the node that it is connected to drops those
for which there is no room (``encircle.protocol.zenoh.lanes``). So they are sent in batches, each
after the one before has arrived.
"""

from collections.abc import Iterator

from encircle.protocol.connections import Connection
from encircle.protocol.keys import parse_key, robot_key
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.world.coordinator.outgoing import Outgoing

BATCH_BYTES_MAX = 256 * 1024
BATCH_S_MAX = 10.0


def send(connection: Connection, messages: Outgoing) -> None:
    """Send messages by a connection, in their order."""
    for key, payload in messages:
        connection.send(key, payload)


def send_in_batches(connection: ZenohConnection, messages: Outgoing) -> None:
    """As ``send``, waiting between batches until they have arrived.

    A robot that does not confirm it, for instance a frozen one, gets the rest without waiting.
    """
    arrives = True
    for number, batch in enumerate(batches(messages)):
        if number > 0 and arrives:
            run, robot, _ = parse_key(batch[0][0])
            arrives = connection.flush(robot_key(run, robot or "", "about"), BATCH_S_MAX)
        send(connection, batch)


def batches(messages: Outgoing) -> Iterator[Outgoing]:
    """The messages in their order, cut where the key stays the same and a batch is full."""
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
