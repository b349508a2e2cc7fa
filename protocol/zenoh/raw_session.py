"""A Zenoh session for other people's keys: what is put on them, and who is told to be there.

A ``ZenohConnection`` speaks this project's protocol. What speaks another one, over the same session
or one of its own, needs less and something else: keys as they are, attachments, tokens. What it
publishes waits for nobody: a message that finds no room is dropped.
"""

import contextlib
from collections.abc import Callable
from typing import Any

import zenoh

from encircle.protocol.errors import ConnectionClosed
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.liveliness import subscribe_alive
from encircle.protocol.zenoh.session import close_session, open_session

Take = Callable[[str, bytes], None]


class RawSession:
    """A session that puts bytes on any keys. Raises ``ConnectionFailed``. Use as a context."""

    def __init__(self, endpoints: Endpoints) -> None:
        self._session = open_session(endpoints)
        self._kept: list[Any] = []

    def __enter__(self) -> "RawSession":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def id(self) -> str:
        """The session's id, as Zenoh writes it."""
        return str(self._session.info.zid())

    def publisher(self, key: str) -> Callable[[bytes, bytes], None]:
        """A function that puts ``(payload, attachment)`` on a key.

        It raises ``ConnectionClosed`` once the session is closed.
        """
        declared = self._session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.DROP
        )
        self._kept.append(declared)

        def put(payload: bytes, attachment: bytes) -> None:
            try:
                declared.put(payload, attachment=attachment)
            except zenoh.ZError as error:
                raise ConnectionClosed(str(error)) from None

        return put

    def subscribe(self, expression: str, take: Take) -> None:
        """Have ``take(key, payload)`` called on one of Zenoh's threads for others' messages."""

        def take_sample(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                take(str(sample.key_expr), sample.payload.to_bytes())

        callback = zenoh.handlers.Callback(take_sample, indirect=False)
        self._kept.append(
            self._session.declare_subscriber(
                expression, callback, allowed_origin=zenoh.Locality.REMOTE
            )
        )

    def declare_token(self, key: str) -> None:
        """A liveliness token, which is there as long as the session is."""
        self._kept.append(self._session.liveliness().declare_token(key))

    def watch(self, expression: str, tell: Callable[[str, bool], None]) -> None:
        """As ``encircle.protocol.zenoh.liveliness.subscribe_alive``, as long as the session is."""
        self._kept.append(subscribe_alive(self._session, expression, tell))

    def close(self) -> None:
        """Close the session, its tokens first, so that they do not outlive it. Raises nothing."""
        for declared in self._kept:
            with contextlib.suppress(zenoh.ZError):
                declared.undeclare()
        self._kept.clear()
        close_session(self._session)
