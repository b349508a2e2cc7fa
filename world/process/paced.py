"""The world's rounds by the clock: a thread stamps what arrives, this one keeps the deadlines.

It waits for messages until a tick's deadline, takes what has come by then, lets the core end the
tick, and sends the observations of the next. How well it kept its deadlines is measured
(``encircle.world.coordinator.deadlines``) and told with the result, whatever the reason was.
"""

import threading
import time
from collections.abc import Callable
from math import ceil

from encircle.protocol.connections import Link
from encircle.protocol.errors import LinkClosed
from encircle.protocol.mailbox import Mailbox, now_us
from encircle.world.coordinator.deadlines import Punctuality, next_slot
from encircle.world.coordinator.failure_detector import Attendance
from encircle.world.coordinator.paced_core import PacedCore
from encircle.world.coordinator.world_core import Outgoing

Act = Callable[[Callable[[], Outgoing]], None]


def run_by_clock(
    core: PacedCore, attendance: Attendance, link: Link, act: Act, answer_s_max: float
) -> Punctuality:
    """Run the hunt until it ends or the link is closed; returns how punctual it was.

    ``act`` does something with the core and sends what comes of it. A robot of which nothing has
    come for ``answer_s_max`` is lost.
    """
    link.never_wait()
    mail, punctuality = Mailbox(), Punctuality()
    threading.Thread(target=_read, args=(link, mail), name="mail", daemon=True).start()
    tick_s = core.arena.scenario.tick_s
    silent_ticks_max = ceil(answer_s_max / tick_s)

    def begin() -> Outgoing:
        core.at(now_us())
        return attendance.begin()

    def lose_the_silent() -> Outgoing:
        return attendance.owing(core.silent(silent_ticks_max), answer_s_max)

    core.clock = now_us
    act(begin)
    start_s, slot = time.monotonic(), 0
    try:
        while core.ended is None:
            following = next_slot(slot, time.monotonic() - start_s, tick_s)
            punctuality.went_on(following - slot)
            slot = following
            deadline_s = start_s + slot * tick_s
            _take_until(deadline_s, mail, core, attendance, act)
            punctuality.woke(time.monotonic() - deadline_s)
            _take(mail.take(0.0), core, attendance, act)
            act(lambda: core.end_tick(now_us()))
            act(lose_the_silent)
    except LinkClosed:
        pass
    core.refused_for_room(mail.dropped)
    return punctuality


def _take_until(
    deadline_s: float, mail: Mailbox, core: PacedCore, attendance: Attendance, act: Act
) -> None:
    while (left_s := deadline_s - time.monotonic()) > 0.0:
        _take(mail.take(left_s), core, attendance, act)


def _take(
    came: list[tuple[int, str, bytes]], core: PacedCore, attendance: Attendance, act: Act
) -> None:
    for came_us, key, payload in came:

        def change(came_us: int = came_us, key: str = key, payload: bytes = payload) -> Outgoing:
            return [*core.take(key, payload, came_us), *attendance.heard(key, payload)]

        act(change)


def _read(link: Link, mail: Mailbox) -> None:
    try:
        while True:
            mail.put(*link.receive())
    except LinkClosed:
        mail.close()
