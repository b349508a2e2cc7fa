"""What is kept for pages: in order, each once, in bounded messages, and not without end."""

import json
from dataclasses import replace
from functools import cache

from helpers_scene import hunted

from encircle.scene.builder import scene_of_recording
from encircle.viewer.history import MESSAGE_BYTES_MAX, History, Position, as_text


@cache
def scene():
    return scene_of_recording(hunted("sim1", ("ticks_max=5",))[0])


def frames(count, first=0):
    return [replace(scene().frames[2], tick=tick) for tick in range(first, first + count)]


def read(history, at=None, extra=None):
    """All messages from a position on."""
    found, at = [], at or Position()
    while (message := history.next_message(at, extra or {})) is not None:
        text, at = message
        found.append((len(text), json.loads(text)))
    return found


def test_a_page_gets_stage_frames_and_status_in_bounded_messages_and_the_status_last():
    history = History(scene().stage)
    history.add(frames(1000), {"state": "ended"})
    found = read(history, extra={"control": True})
    size = len(as_text(found[0][1]["frames"][0])) + len(as_text(found[0][1]["stage"]))
    assert max(length for length, _ in found) < MESSAGE_BYTES_MAX + size + 1000
    assert len(found) > 2
    ticks = [frame["t"] for _, message in found for frame in message.get("frames", [])]
    assert ticks == list(range(1000))
    assert ["stage" in message for _, message in found] == [True, *[False] * (len(found) - 1)]
    assert ["status" in message for _, message in found] == [*[False] * (len(found) - 1), True]
    assert found[-1][1]["status"] == {
        "state": "ended",
        "text": "",
        "complete": True,
        "control": True,
    }


def test_a_frame_that_came_already_and_a_status_that_is_the_same_are_no_news():
    history, told = History(scene().stage), []
    history.changed = lambda: told.append(1)
    history.add(frames(10), {"state": "running"})
    history.add(frames(5, first=3), {"state": "running"})
    found = read(history)
    assert [frame["t"] for frame in found[0][1]["frames"]] == list(range(10))
    at = Position(10, 1, has_stage=True)
    assert read(history, at) == []
    history.add([], {"text": "3 ticks missed"})
    assert read(history, at)[0][1]["status"]["text"] == "3 ticks missed"
    history.add([], {"text": "3 ticks missed"})
    assert len(told) <= 3


def test_when_there_is_too_much_the_oldest_frames_go():
    size = len(as_text(json.loads(as_text(read_one()))))
    history = History(scene().stage, kept_bytes_max=10 * size)
    for first in range(0, 100, 5):
        history.add(frames(5, first))
    ticks = [frame["t"] for _, m in read(history) for frame in m.get("frames", [])]
    assert ticks == list(range(100 - len(ticks), 100))
    assert 8 <= len(ticks) <= 10


def read_one():
    history = History(scene().stage)
    history.add(frames(1, first=50))
    return read(history)[0][1]["frames"][0]
