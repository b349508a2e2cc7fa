"""The options of ``encircle ros2``: show a run to ROS 2, or have it steer one of the robots."""

import asyncio
import contextlib
from argparse import Namespace
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from encircle.protocol.process.interrupts import signals_to
from encircle.protocol.process.log import LineKind, bounded_log, say_error
from encircle.protocol.programs.option_values import name_of, one_of, seconds, whole_number_in
from encircle.protocol.programs.options import Options, endpoints_of
from encircle.ros2.releases import DEFAULT_RELEASE, RELEASES

if TYPE_CHECKING:
    from encircle.protocol.zenoh.endpoints import Endpoints

DOMAIN_MAX = 232
"""The highest ROS_DOMAIN_ID."""
TIMES = ("sim", "wall")


def main(arguments: Sequence[str], program: str) -> int:
    """Show a run to ROS 2, or let ROS 2 steer one of its robots; returns the exit status."""
    options = _options(program)
    settings = options.parse(arguments)
    # Imported late: a mistyped command need not wait for Zenoh.
    from encircle.live.over_zenoh import NothingToSee
    from encircle.protocol.zenoh.endpoints import (
        CONNECT_S_MAX,
        ConfigurationError,
        ConnectionFailed,
    )

    _check(settings, options)
    try:
        hunt_side = endpoints_of(
            settings, settings.join_timeout or CONNECT_S_MAX, name=settings.robot
        )
        ros_side = _ros_side(settings, hunt_side)
        if settings.robot:
            return _steer(settings, hunt_side, ros_side)
        return _look_on(settings, hunt_side, ros_side)
    except ConfigurationError as error:
        options.error(str(error))
    except (ConnectionFailed, NothingToSee) as error:
        say_error(f"ros2: {error}")
    return 1


def _check(settings: Namespace, options: Options) -> None:
    """What does not go together."""
    if settings.listen:
        options.error(f"--listen {settings.listen[0]}: it only connects, to what --connect names")
    if not (settings.connect or settings.zenoh_config):
        options.error(f"--run {settings.run}: where? Give --connect or --zenoh-config")
    if settings.certificates and not settings.ros_connect:
        options.error(
            "--certificates: no certificate lets ROS 2's messages through the run's gate;"
            " give ROS 2's own router with --ros-connect"
        )
    if settings.robot:
        if settings.time is not None:
            options.error("--time does not go with --robot: a robot knows its run's time")
        return
    for name in ("command_timeout", "command_wait"):
        if getattr(settings, name) is not None:
            options.error(f"--{name.replace('_', '-')} goes with --robot only")


def _ros_side(settings: Namespace, hunt_side: "Endpoints") -> "Endpoints":
    from encircle.protocol.zenoh.endpoints import Endpoints

    if settings.ros_connect is None:
        return hunt_side
    return Endpoints(connect=(settings.ros_connect,), connect_s_max=hunt_side.connect_s_max)


def _look_on(settings: Namespace, hunt_side: "Endpoints", ros_side: "Endpoints") -> int:
    from encircle.live.over_zenoh import ZenohFeed
    from encircle.protocol.zenoh.raw_session import RawSession
    from encircle.ros2.bridge import WORLD_S_MAX, Bridge, TimeSource, usual_time
    from encircle.ros2.message_types import MessageTypes
    from encircle.ros2.node import RosNode

    types = MessageTypes(RELEASES[settings.release])
    with contextlib.ExitStack() as closing:
        # Beliefs would take time, and are not shown.
        feed = ZenohFeed(hunt_side, settings.run, False, settings.join_timeout or WORLD_S_MAX)
        closing.callback(feed.close)
        time_source = TimeSource(settings.time) if settings.time else usual_time(feed.stage)
        hunt = closing.enter_context(RawSession(hunt_side))
        ros = hunt if ros_side is hunt_side else closing.enter_context(RawSession(ros_side))
        node = RosNode(ros, settings.domain, "encircle", settings.keyed_attachments)
        told = (settings.run, feed.stage, lambda: feed.take(0.0).frames)
        bridge = Bridge(hunt, *told, node, types, time_source, bounded_log())
        say_error(f"ros2: showing run {settings.run} in domain {settings.domain} at {ros_side}")
        with signals_to(bridge.interrupt):
            report = bridge.forward(settings.join_timeout or WORLD_S_MAX)
    say_error(
        f"ros2: {report.ended}; {report.sent} states sent, {report.passed_over} passed over,"
        f" {report.refused} refused; traffic of {report.traffic} ticks"
    )
    return int(report.failed)


def _steer(settings: Namespace, hunt_side: "Endpoints", ros_side: "Endpoints") -> int:
    from encircle.agents.process.robot import run_robot
    from encircle.agents.process.robot_life import JOIN_S_MAX, RobotOptions
    from encircle.protocol.zenoh.raw_session import RawSession
    from encircle.ros2.message_types import MessageTypes
    from encircle.ros2.node import RosNode
    from encircle.ros2.steered_robot import (
        COMMAND_S_MAX,
        WAIT_S_MAX,
        CommandMail,
        SteeredRobot,
        Steering,
    )
    from encircle.ros2.steering_node import SteeringNode

    robot, types, mail = settings.robot, MessageTypes(RELEASES[settings.release]), CommandMail()
    log = bounded_log()

    def say(line: str) -> None:
        log(f"ros2: robot {robot}: {line}")

    with RawSession(ros_side) as ros:
        node = RosNode(ros, settings.domain, f"encircle_{robot}", settings.keyed_attachments)
        # What is refused must not use up the lines for what happens.
        told = SteeringNode(node, types, robot, mail, bounded_log())
        command_s_max = settings.command_timeout or COMMAND_S_MAX
        wait_s_max = settings.command_wait or WAIT_S_MAX
        steering = Steering(mail, told.tell, command_s_max, wait_s_max, say)
        say_error(f"ros2: robot {robot} listens to ROS 2 in domain {settings.domain} at {ros_side}")
        options = RobotOptions(
            settings.join_timeout or JOIN_S_MAX, make_core=partial(SteeredRobot, steering)
        )
        status = asyncio.run(run_robot(robot, settings.run, hunt_side, options))
    line = f"ros2: {mail.newest().number} commands taken, {mail.refused} refused"
    say_error(line, kind=LineKind.EVENT)
    return status


def _options(program: str) -> Options:
    options = Options(program, "Show a running hunt to ROS 2, or let ROS 2 steer one robot.")
    options.add("--run", "name of the run", read=name_of("run"), required=True)
    options.add_endpoints()
    options.add(
        "--ros-connect",
        "ROS 2's Zenoh router; as the run's endpoints if left out",
        metavar="ENDPOINT",
    )
    options.add(
        "--domain",
        "the ROS_DOMAIN_ID of the others; 0 if left out",
        read=whole_number_in(0, DOMAIN_MAX),
        default=0,
        metavar="N",
    )
    options.add(
        "--release",
        f"their release of ROS 2: {', '.join(RELEASES)}; {DEFAULT_RELEASE} if left out",
        read=one_of(RELEASES),
        default=DEFAULT_RELEASE,
        metavar="NAME",
    )
    options.add_flag(
        "--keyed-attachments",
        "they have rmw_zenoh_cpp from before June 2025: 0.1.1 (humble), 0.2.3 (jazzy) or older",
    )
    options.add(
        "--time",
        "stamp by sim, the run's own time, told on /clock, or wall; as the run goes if left out",
        read=one_of(TIMES),
        metavar="CLOCK",
    )
    options.add(
        "--robot",
        "join as this robot, and do what ROS 2 says",
        read=name_of("robot"),
        metavar="ID",
    )
    options.add(
        "--command-timeout",
        "a velocity holds for so long, in s; 0.5 if left out",
        read=seconds,
        metavar="S",
    )
    options.add(
        "--command-wait",
        "in lock-step a tick waits so long for a command, in s; 1 if left out",
        read=seconds,
        metavar="S",
    )
    options.add("--join-timeout", "wait this long for the world, in s", read=seconds, metavar="S")
    return options
