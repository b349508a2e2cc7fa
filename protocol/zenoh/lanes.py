"""Lanes: how messages share a connection, so that nobody who only looks on holds up a round.

Zenoh keeps a queue for each priority of each connection. When a reader is frozen, or slower than
what it subscribed to, the queue to it fills. A message that is sent to block then waits for room,
and with it whoever sent it, at the node that the others connect to: the *gate*. So a gate does not
take the sender's word. On the way out of it, whatever finds no room is dropped, and that holds for
the healthy too; but their queues have room for all that a round can bring, as messages are packed
there by bytes and not one by one. What is lost all the same is asked for again.

An answer to a query goes as the query came: a gate marks each that comes in, so that nobody waits
for one who asks much and reads nothing.

What is asked for again goes by the *sure* lane, as does what is sent once: a queue of its own,
which blocks. So little takes it that it does not fill to one that is frozen before its connection
ends; if it does, the gate closes that connection.

Settings are a mapping from names in Zenoh's configuration to values, as in
``encircle.protocol.zenoh.access_control``.
"""

from typing import Any

ROUND, SURE, VIEWERS = "data_high", "interactive_low", "data_low"
"""Priorities: of observations and answers; of what must come; of what only viewers read. Whoever
knows nothing of lanes sends by Zenoh's default, ``data``, and cannot crowd out a round."""
SENT_ONCE = ("/setup", "/end")
"""Messages that are not sent again, and so are never dropped."""
FOR_VIEWERS = ("/state", "/radio", "/intervention")
BATCHES_MAX = 16
"""What may wait to be sent on each lane of a connection, in Zenoh's batches of 64 KiB; with Zenoh's
own 2, a busy processor is enough to fill it."""
CLOSE_AFTER_US = 1_000_000
"""How long a gate waits for room on the sure lane before it closes the connection."""

Settings = dict[str, Any]

_DROP_WHEN_FULL = {
    "id": "what finds no room is dropped",
    "messages": ["put", "delete", "query"],
    "flows": ["egress"],
    "overwrite": {"congestion_control": "drop", "express": False},
}
_BLOCK_WHEN_FULL = {
    "id": "but not on the sure lane",
    "messages": ["put"],
    "flows": ["egress"],
    "key_exprs": ["encircle/*/robots/*/*"],
    "qos": {"priority": SURE},
    "overwrite": {"congestion_control": "block"},
}
_DROP_ANSWERS = {
    "id": "nor is who asks waited for",
    "messages": ["query"],
    "flows": ["ingress"],
    "overwrite": {"congestion_control": "drop"},
}
QUEUE_SETTINGS: Settings = {
    f"transport/link/tx/queue/size/{priority}": BATCHES_MAX for priority in (ROUND, SURE, "data")
}
"""Of every node."""
GATE_SETTINGS: Settings = {
    "qos/network": [_DROP_WHEN_FULL, _BLOCK_WHEN_FULL, _DROP_ANSWERS],
    "transport/link/tx/queue/congestion_control/block/wait_before_close": CLOSE_AFTER_US,
}
"""Of every node that listens, beside ``QUEUE_SETTINGS``."""


def message_priority(key: str, again: bool) -> str:
    """The priority of a message; ``again``: this was sent before, for it may have been lost."""
    if again or key.endswith(SENT_ONCE):
        return SURE
    return VIEWERS if key.endswith(FOR_VIEWERS) else ROUND
