"""A session that only looks on at a run: it hears all that is said there, and says nothing.

It declares no token. What it does not read fast enough is dropped by the node that it is connected
to (``encircle.protocol.zenoh.lanes``), so that nobody waits for it. A certificate of a viewer is
enough (``encircle.protocol.zenoh.access_control``).
"""

import contextlib
from collections.abc import Callable
from typing import Any

import zenoh

from encircle.protocol.keys import parse_key, robot_key, world_key
from encircle.protocol.zenoh.access_control import SHOWN
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.liveliness import alive_keys, subscribe_alive
from encircle.protocol.zenoh.queries import query
from encircle.protocol.zenoh.scenario_query import CHANNEL, RunDescription, decode_description
from encircle.protocol.zenoh.session import close_session, open_session

Hear = Callable[[str, bytes], None]


class Onlooker:
    """Looks on at one run.

    ``hear(key, payload)`` is called for its messages and ``see(key, alive)`` for its liveliness
    tokens, on Zenoh's own threads. Raises ``ConnectionFailed``.
    """

    def __init__(
        self, endpoints: Endpoints, run: str, hear: Hear, see: Callable[[str, bool], None]
    ) -> None:
        self._session = open_session(endpoints)
        self._run = run

        def take(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                hear(str(sample.key_expr), sample.payload.to_bytes())

        callback = zenoh.handlers.Callback(take, indirect=False)
        shown = (world_key(run, channel) for channel in SHOWN)
        expressions = (*shown, robot_key(run, "*", "*"))
        self._kept: list[Any] = [
            self._session.declare_subscriber(expression, callback) for expression in expressions
        ]
        self._kept += [
            subscribe_alive(self._session, expression, see)
            for expression in (world_key(run, "alive"), robot_key(run, "*", "alive"))
        ]

    def description(self, s_max: float) -> RunDescription | None:
        """The run's scenario, seed and setups, as its world says; None if no world answers.

        It has then also taken note of this onlooker's subscriptions. Raises ``ProtocolError`` for
        an answer that cannot be understood.
        """
        with contextlib.suppress(zenoh.ZError):  # the session may be closed by now
            reply = query(self._session, world_key(self._run, CHANNEL), s_max)
            return None if reply is None else decode_description(reply.payload)
        return None

    def runs(self, s_max: float) -> list[str]:
        """The names of the runs whose worlds are there, as far as can be learned in ``s_max`` s."""
        with contextlib.suppress(zenoh.ZError):
            keys = alive_keys(self._session, world_key("*", "alive"), s_max)
            return sorted(parse_key(key).run for key in keys)
        return []

    def close(self) -> None:
        """Close the session; may be called twice."""
        close_session(self._session)
