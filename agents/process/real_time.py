"""The robot's rounds in real time: a thread stamps what arrives, this one answers the newest of it.

There are two threads, because arrival times are to be noted also while the robot decides. The queue
between them is bounded, as is every wait. When no observation arrives for ``silence_ticks_max``
ticks, even if other messages do, the robot commands a stop and sends nothing more until one
arrives.
"""

import queue
import threading
import time

from encircle.agents.brain.real_time_core import RealTimeRobotCore
from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.process.slow_decisions import SlowDecisions
from encircle.protocol.codec import decode
from encircle.protocol.connections import Connection
from encircle.protocol.errors import ConnectionClosed, ProtocolError
from encircle.protocol.keys import channel_of, robot_key
from encircle.protocol.mailbox import Mailbox, now_us
from encircle.protocol.messages import Observation, PoseCarrier

_ONE_AT_A_TIME = threading.Lock()
"""Robots that share a process decide one after the other: a policy is not asked to be safe in
threads, nor are imports that wait for their first use."""


def is_timed(core: RobotCore, key: str, payload: bytes) -> bool | None:
    """Whether a world goes by the clock, by its observation; None if this is no observation."""
    if core.setup is None or key != robot_key(core.run, core.robot, "observation"):
        return None
    try:
        observation = decode(Observation, payload, core.run)
        core.check(observation)
    except ProtocolError:
        return None
    return observation.sent_us is not None


def answer(
    core: RobotCore, connection: Connection, first: tuple[str, bytes], slow: SlowDecisions
) -> None:
    """Answer until the run ends or the connection is closed. ``first``: the first observation."""
    connection.drop_when_congested()
    robot = RealTimeRobotCore(core)
    mail = Mailbox()
    mail.put(*first)
    continues: queue.SimpleQueue[bool] = queue.SimpleQueue()
    reader = threading.Thread(
        target=_read, args=(connection, mail, continues), name="mail", daemon=True
    )
    reader.start()
    unsubscribe = None
    if core.setup is not None and core.setup.radio == PoseCarrier.DIRECT:
        unsubscribe = connection.subscribe(robot_key(core.run, "*", "pose"), mail.put)
    stop_s = time.monotonic() + robot.observation_timeout_s
    try:
        while core.ended is None:
            arrivals = mail.take(stop_s - time.monotonic())
            for time_us, key, payload in arrivals:
                robot.take(time_us, key, payload)
                if channel_of(key) == "end":
                    continues.put(core.ended is None)
            dropped, mail.dropped = mail.dropped, 0
            robot.count_dropped(dropped)
            action = None
            if core.ended is None:
                with _ONE_AT_A_TIME:
                    action = slow.timed(robot.decide, core.setup.tick_s if core.setup else None)
            if action is not None:
                _send(connection, robot.messages(action, now_us()))
            elif time.monotonic() >= stop_s and core.ended is None:
                _send(connection, robot.stop(now_us()))
            else:
                continue
            stop_s = time.monotonic() + robot.observation_timeout_s
    finally:
        if unsubscribe is not None:
            unsubscribe()


def _read(connection: Connection, mail: Mailbox, continues: "queue.SimpleQueue[bool]") -> None:
    """Stamp what arrives, until the run has ended: what arrives then is for the next run."""
    try:
        while True:
            key, payload = connection.receive()
            ends = channel_of(key) == "end"
            # There is one such message; a robot that dropped it would wait for ever.
            mail.put(key, payload, keep=ends)
            if ends and not continues.get():
                return
    except ConnectionClosed:
        mail.close()


def _send(connection: Connection, messages: list[tuple[str, bytes]]) -> None:
    for key, payload in messages:
        connection.send(key, payload)
