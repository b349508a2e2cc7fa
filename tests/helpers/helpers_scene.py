"""Hunts in memory with their messages, as a recording holds them, and frames made of these."""

from pathlib import Path

from encircle.runlog.runlog import RunLog, RunLogCollector
from encircle.runner.memory import run_in_memory
from encircle.scene.builder import SceneBuilder
from encircle.scene.frame import Frame
from encircle.world.arena.engine import build
from encircle.world.loading.load import load
from encircle.world.recording.recording import Recording
from encircle.world.scenario.model import Scenario

RUN = "seen"


def hunted(scenario: str | Scenario, changes=(), seed: int = 2) -> tuple[Recording, RunLog]:
    """The recording of a hunt in memory, and the log that was collected in it."""
    loaded = scenario if isinstance(scenario, Scenario) else load(scenario, list(changes))
    messages, collector = [], RunLogCollector()

    def record(tick: int, key: str, payload: bytes) -> None:
        messages.append((tick, key.removeprefix(f"encircle/{RUN}/"), payload))

    run_in_memory(build(loaded, seed), RUN, lambda _line: None, record, observer=collector)
    recording = Recording(Path("nowhere"), loaded, seed, RUN, tuple(messages), True)
    return recording, collector.log()


def frames_of(recording: Recording, messages=None) -> list[Frame]:
    """The frames of a recording's messages, or of some of them, one by one."""
    written, run = recording.scenario_as_written, recording.run
    builder, frames = SceneBuilder(written, recording.seed, run), []
    for tick, topic, payload in recording.messages if messages is None else messages:
        frames += builder.take(tick, topic, payload)
    return frames + builder.finish()
