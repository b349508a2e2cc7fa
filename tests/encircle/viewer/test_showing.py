"""What pages are told of a recording while its frames are made, and when no more can be made."""

import json

import pytest
from helpers_scene import hunted

from encircle.live.in_memory import MemoryFeed
from encircle.scene.stage import stage_of
from encircle.viewer.history import Position
from encircle.viewer.showing import FRAMES_AT_ONCE, Show, ShowOptions
from encircle.world.loading.load import load
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


class FailingFeed:
    """One round of a run, and then an error of this program's own."""

    def __init__(self, scenario):
        self.feed = MemoryFeed(scenario, "failing")

    def take(self, wait_s):
        if wait_s and self.feed is None:
            raise RuntimeError("no \x1b such thing")
        self.feed, update = None, self.feed.take(0.0)
        return update


def test_pages_are_told_if_what_makes_their_frames_fails():
    scenario = load("sim1", list(HUNT))
    show = Show(stage_of(scenario, 1, "failing"), ShowOptions())
    with pytest.raises(RuntimeError, match="such thing"):
        show.feed(FailingFeed(scenario))
    text, _ = show.history.next_message(Position(has_stage=True), {})
    status = json.loads(text)["status"]
    assert (status["state"], status["complete"]) == ("ended", False)
    assert status["text"] == r"this page shows no more of the run: RuntimeError: no \x1b such thing"
