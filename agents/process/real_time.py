"""The robot's rounds in real time: a thread stamps what arrives, this one answers the newest of it.

Two threads, because what came and when must be known also while the robot thinks. The queue between
them is bounded, as is every wait; when no observation comes for ``silence_ticks_max`` ticks,
whatever else does, the robot commands a stop and says nothing more until one comes.
"""

import queue
import threading
import time

from encircle.agents.brain.real_time_core import RealTimeRobotCore
from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import decode
from encircle.protocol.connections import Connection
from encircle.protocol.errors import ConnectionClosed, ProtocolError
from encircle.protocol.keys import robot_key
from encircle.protocol.mailbox import Mailbox, now_us
from encircle.protocol.messages import Observation, PoseCarrier


def is_timed(core: RobotCore, key: str, payload: bytes) -> bool | None:
    """Whether an observation is from a world that goes by the clock; None if it is none at all."""
    if core.setup is None or key != robot_key(core.run, core.robot, "observation"):
        return None
    try:
        observation = decode(Observation, payload, core.run)
        core.check(observation)
    except ProtocolError:
        return None
    return observation.sent_us is not None


def answer(core: RobotCore, connection: Connection, first: tuple[str, bytes]) -> None:
    """Answer until the run ends or the link is closed. ``first``: the first observation."""
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
                if key.endswith("/end"):
                    continues.put(core.ended is None)
            dropped, mail.dropped = mail.dropped, 0
            robot.count_dropped(dropped)
            action = robot.decide() if core.ended is None else None
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
    """Stamp what comes, until the run has ended: what comes then is for the next one."""
    try:
        while True:
            key, payload = connection.receive()
            ends = key.endswith("/end")
            # Of these there is one at a time, and who drops it would wait for ever.
            mail.put(key, payload, keep=ends)
            if ends and not continues.get():
                return
    except ConnectionClosed:
        mail.close()


def _send(connection: Connection, messages: list[tuple[str, bytes]]) -> None:
    for key, payload in messages:
        connection.send(key, payload)
