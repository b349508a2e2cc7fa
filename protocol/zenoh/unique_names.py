"""One party per name: a second robot of one id, or a second world of one run, does not start.

A liveliness token says that a party is there, not who put it up; so a party looks for a token of
its own name before it puts one up. One of a process that was killed is gone at once, one of a host
that vanished only when Zenoh gives it up, and a party that is started anew waits a moment for that.

Two that start within the same instant may both find nothing. That harms nothing either: both are
told the same and decide the same, and what the later one of them says is refused, and counted.
"""

import time
from typing import Any

from encircle.protocol.zenoh.connection import is_alive
from encircle.protocol.zenoh.endpoints import ConnectionFailed

FREE_S_MAX = 2.0
LOOK_S_MAX = 5.0
PERIOD_S = 0.1


class NameInUse(ConnectionFailed):
    """Somebody of that name is there; the message says who."""


def check_name_free(session: Any, token: str, who: str, s_max: float = FREE_S_MAX) -> None:
    """Raise ``NameInUse`` if a token is there, and still so after ``s_max`` seconds.

    ``session``: of ``encircle.protocol.zenoh.connection``, which nothing is subscribed to yet.
    ``who``: as people call whom the token stands for.
    """
    deadline_s = time.monotonic() + s_max
    while is_alive(session, token, LOOK_S_MAX):
        if time.monotonic() >= deadline_s:
            raise NameInUse(f"there is a {who} already")
        time.sleep(PERIOD_S)
