"""One node per name: a second robot of one id, or a second world of one run, does not start.

A liveliness token shows that a node is there, not which process declared it. So a node looks for a
token of its own name before it declares one. The token of a process that was killed goes at once,
that of a host that vanished only when Zenoh gives it up; a node that is started anew waits a moment
for that.

Two that start within the same instant may both find no token. That harms nothing: both get the same
observations and decide the same, and the messages of the later one are refused, and counted.
"""

import time
from typing import Any

from encircle.protocol.zenoh.endpoints import ConnectionFailed
from encircle.protocol.zenoh.liveliness import is_alive

FREE_S_MAX = 2.0
LOOK_S_MAX = 5.0
PERIOD_S = 0.1


class NameInUse(ConnectionFailed):
    """A node of that name is there; the message says which."""


def check_name_free(session: Any, token: str, who: str, s_max: float = FREE_S_MAX) -> None:
    """Raise ``NameInUse`` if a token is there, and still so after ``s_max`` seconds.

    ``session``: a Zenoh session without subscriptions. ``who``: the name of the node for people.
    """
    deadline_s = time.monotonic() + s_max
    while is_alive(session, token, LOOK_S_MAX):
        if time.monotonic() >= deadline_s:
            raise NameInUse(f"there is a {who} already")
        time.sleep(PERIOD_S)
