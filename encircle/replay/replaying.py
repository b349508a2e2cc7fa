"""Replay: read a recording back, and check that fresh brains decide the same on it.

The check feeds each robot's recorded setup and observations, byte for byte, to a new robot core and
compares the poses and commands that it sends with those recorded. It needs no world and no
connection, so a difference is a different decision.
"""

from collections import Counter
from dataclasses import replace
from pathlib import Path

from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import decode
from encircle.protocol.keys import channel_of
from encircle.protocol.messages import Command, CommandMode, Radio
from encircle.replay.real_time_replay import replay_real_time
from encircle.replay.replay_check import ReplayCheck, raise_failure, steered_text
from encircle.world.recording.recording import Recording, decoded, read_recording


def replay(source: str | Path | Recording) -> ReplayCheck:
    """Feed a recording's observations to fresh brains and compare what they decide.

    ``PluginFailed`` if a policy fails on them, as it may have done in the run.
    """
    recording = source if isinstance(source, Recording) else read_recording(source)
    run = recording.run
    if recording.scenario.clock == "wall":
        return replay_real_time(recording)
    cores = {robot: RobotCore(robot, run) for robot in recording.scenario.ids}
    decided: dict[tuple[int, str, str], bytes] = {}
    differences: list[tuple[int, str, str]] = []
    received = set()
    steered = _steered_ticks(recording)
    compared = 0
    for tick, topic, payload in recording.messages:
        *_, robot, channel = topic.split("/")
        if channel in ("setup", "observation", "pose", "command") and robot not in cores:
            differences.append((tick, robot, channel))
        elif channel in ("setup", "observation"):
            received.add((tick, robot, channel))
            for key, answer in cores[robot].receive(f"encircle/{run}/{topic}", payload):
                decided[tick, robot, channel_of(key)] = answer
            raise_failure(cores[robot])
        elif channel in ("pose", "command"):
            decision = decided.pop((tick, robot, channel), None)
            if (tick, robot) in steered:
                continue
            compared += 1
            if not _same(decision, payload, channel, recording, tick):
                differences.append((tick, robot, channel))
    # What was decided but not recorded was left out, unless the recording ends before it: answers
    # are recorded when a round is complete, and a cut may go through the last round.
    last = max((tick for tick, _, _ in recording.messages), default=0)
    answered = max((tick for tick, _, _ in recording.of_channel("command")), default=-1)
    whole = answered if recording.complete else answered - 1
    spoke = _published_ticks(recording)
    for tick, robot, channel in decided:
        # One that was lost before it had answered in full is not asked next, or is set up first.
        asked_next = (tick + 1, robot, "observation") in received
        lost = not asked_next or (tick + 1, robot, "setup") in received
        unanswered = (tick, robot, "command") in decided and (tick, robot) not in spoke
        if tick <= whole and not (lost and unanswered):
            differences.append((tick, robot, channel))
    return ReplayCheck(
        last,
        len(cores),
        compared,
        tuple(differences),
        recording.complete,
        tuple(
            [
                steered_text(robot, ticks)
                for robot, ticks in sorted(Counter(robot for _, robot in steered).items())
            ]
        ),
    )


def _steered_ticks(recording: Recording) -> set[tuple[int, str]]:
    """The ticks at which somebody outside has decided for a robot."""
    return {
        (tick, topic.split("/")[-2])
        for tick, topic, payload in recording.messages
        if topic.endswith("/command")
        and CommandMode.STEERED.encode() in payload  # few are: the others need not be decoded
        and decoded(Command, recording, tick, payload).mode == CommandMode.STEERED
    }


def _published_ticks(recording: Recording) -> set[tuple[int, str]]:
    """The ticks at which robots had a packet on the radio, whatever became of it."""
    return {
        (tick, robot)
        for tick, _, payload in recording.of_channel("radio")
        for robot, fates in zip(
            recording.scenario.ids, decoded(Radio, recording, tick, payload).fates, strict=False
        )
        if any(fates)
    }


def _same(
    decision: bytes | None, recorded: bytes, channel: str, recording: Recording, tick: int
) -> bool:
    """Whether a decision is the recorded one; how many messages a robot refused is no decision."""
    if decision is None or decision == recorded or channel != "command":
        return decision == recorded
    mine = decode(Command, decision, recording.run)
    theirs = decoded(Command, recording, tick, recorded)
    return replace(mine, refused={}) == replace(theirs, refused={})
