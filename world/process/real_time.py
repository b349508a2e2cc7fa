"""The world's rounds by the clock: a thread stamps what arrives, this one keeps the deadlines.

It waits for messages until a tick's deadline, takes what has arrived by then, lets the core end the
tick, and sends the observations of the next. How well it kept its deadlines is measured
(``encircle.world.coordinator.deadlines``) and is part of the result.
"""

import threading
import time
from collections.abc import Callable
from math import ceil

from encircle.protocol.connections import Connection
from encircle.protocol.errors import ConnectionClosed
from encircle.protocol.mailbox import Mailbox, now_us
from encircle.world.coordinator.deadlines import DeadlineStatistics, next_deadline
from encircle.world.coordinator.failure_detector import FailureDetector
from encircle.world.coordinator.outgoing import Outgoing
from encircle.world.coordinator.real_time_core import RealTimeWorldCore

Act = Callable[[Callable[[], Outgoing]], None]


def run_real_time(
    core: RealTimeWorldCore,
    failure_detector: FailureDetector,
    connection: Connection,
    act: Act,
    answer_s_max: float,
    on_begun: Callable[[], None] = lambda: None,
) -> DeadlineStatistics:
    """Run the hunt until it ends or the connection is closed; returns how punctual it was.

    ``act`` makes a change to the core and sends the messages that result. A robot from which
    nothing arrives for ``answer_s_max`` is lost. ``on_begun`` is called once the first round is
    open.
    """
    connection.drop_when_congested()
    mail, punctuality = Mailbox(), DeadlineStatistics()
    threading.Thread(target=_read, args=(connection, mail), name="mail", daemon=True).start()
    tick_s = core.arena.scenario.tick_s
    silent_ticks_max = ceil(answer_s_max / tick_s)

    def begin() -> Outgoing:
        core.now_us = now_us()
        return failure_detector.begin()

    def lose_the_silent() -> Outgoing:
        return failure_detector.suspect(core.silent(silent_ticks_max), answer_s_max)

    core.clock = now_us
    act(begin)
    on_begun()
    start_s, slot = time.monotonic(), 0
    try:
        while core.ended is None:
            following = next_deadline(slot, time.monotonic() - start_s, tick_s)
            punctuality.add_advance(following - slot)
            slot = following
            deadline_s = start_s + slot * tick_s
            _take_until(deadline_s, mail, core, failure_detector, act)
            punctuality.add_lateness(time.monotonic() - deadline_s)
            _take(mail.take(0.0), core, failure_detector, act)
            act(lambda: core.end_tick(now_us()))
            act(lose_the_silent)
    except ConnectionClosed:
        pass
    core.rounds.refusals.add_dropped(mail.dropped)
    return punctuality


def _take_until(
    deadline_s: float,
    mail: Mailbox,
    core: RealTimeWorldCore,
    failure_detector: FailureDetector,
    act: Act,
) -> None:
    while (left_s := deadline_s - time.monotonic()) > 0.0:
        _take(mail.take(left_s), core, failure_detector, act)


def _take(
    arrivals: list[tuple[int, str, bytes]],
    core: RealTimeWorldCore,
    failure_detector: FailureDetector,
    act: Act,
) -> None:
    for arrival_us, key, payload in arrivals:

        def change(
            arrival_us: int = arrival_us, key: str = key, payload: bytes = payload
        ) -> Outgoing:
            return [
                *core.take(key, payload, arrival_us),
                *failure_detector.sign_of_life(key, payload),
            ]

        act(change)


def _read(connection: Connection, mail: Mailbox) -> None:
    try:
        while True:
            mail.put(*connection.receive())
    except ConnectionClosed:
        mail.close()
