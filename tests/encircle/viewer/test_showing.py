"""A recording on the page: what is told of it while its frames are still being made, and after."""

import json

import pytest
from helpers_scene import hunted

from encircle.scene.stage import stage_of
from encircle.viewer.history import Position
from encircle.viewer.showing import FRAMES_AT_ONCE, Show, ShowOptions
from encircle.world.recording.recording import Recording

TICKS = 2 * FRAMES_AT_ONCE + 10
HUNT = ("team.strategy='pursuit'", f"ticks_max={TICKS}")


@pytest.mark.parametrize("complete", [True, False])
def test_how_a_recording_ended_is_told_with_its_last_frame_and_not_before(complete):
    hunt, _ = hunted("sim1", HUNT)
    recording = Recording(hunt.path, hunt.scenario, hunt.seed, hunt.run, hunt.messages, complete)
    show = Show(stage_of(hunt.scenario, hunt.seed, hunt.run), ShowOptions())
    told, at = [], Position()

    def read():
        nonlocal at
        while (message := show.history.next_message(at, {})) is not None:
            text, at = message
            told.append((at.tick, json.loads(text).get("status", {}).get("state")))

    show.history.changed = read
    show.recording(recording, lambda: False)
    ended = [tick for tick, state in told if state == "ended"]
    assert ended == [TICKS + 1]
    assert {state for tick, state in told if FRAMES_AT_ONCE <= tick <= TICKS} <= {"waiting", None}
    text, _ = show.history.next_message(Position(TICKS + 1, has_stage=True), {})
    assert json.loads(text)["status"]["complete"] is complete
