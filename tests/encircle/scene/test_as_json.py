"""The JSON of scenes: the format of docs/scene.md, key by key, and nothing that is not JSON."""

import json
import re
from dataclasses import fields
from math import isclose

import pytest
from helpers_paths import ROOT
from helpers_scene import hunted

from encircle.scene.as_json import VERSION, frame_json, stage_json
from encircle.scene.builder import scene_of_recording
from encircle.scene.stage import Stage

PAGE = (ROOT / "docs" / "scene.md").read_text()
LOSSY = [
    "channel.loss={model='bernoulli', rate=0.4}",
    "channel.duplication.rate=0.2",
    "obstacles=[{position=[9.0, 9.0], radius_m=0.5}]",
    "events=[{kind='crash', tick=3, ticks=4, robot='r2'}]",
]


@pytest.fixture(scope="module")
def scene():
    return scene_of_recording(hunted("sim1", LOSSY)[0])


def keys_of(heading):
    """The keys in the first column of the page's table after a line."""
    table = PAGE.split(heading)[1].split("\n\n")[1]
    first = [row.split("|")[1] for row in table.splitlines()[2:]]
    return [key for cell in first for key in re.findall(r"`(\w+)`", cell)]


def test_the_page_names_every_key_and_no_other(scene):
    assert keys_of("The stage:") == list(stage_json(scene.stage))
    assert keys_of("A frame:") == list(frame_json(scene.frames[5]))
    values = re.findall(r"`(\w+)`", PAGE.split("Values: ")[1].split("\n\n")[0])
    assert values == list(frame_json(scene.frames[5])["val"])
    belief = re.findall(r"`(\w+)`", PAGE.split("A belief: ")[1].split("\n\n")[0])
    assert belief == list(frame_json(scene.frames[5])["bel"][0])
    assert stage_json(scene.stage)["v"] == VERSION == 1
    assert f"## JSON, version {VERSION}" in PAGE


def test_a_stage_has_all_fields(scene):
    made = json.loads(json.dumps(stage_json(scene.stage), allow_nan=False))
    for field in fields(Stage):
        value = getattr(scene.stage, field.name)
        assert made[field.name] == json.loads(json.dumps(value))


def test_numbers_are_those_of_the_frame_to_the_last_digit_kept(scene):
    for frame in scene.frames:
        made = json.loads(json.dumps(frame_json(frame), allow_nan=False))
        assert made["t"] == frame.tick
        for shown, true in zip(made["r"] + [made["g"]], [*frame.robots, frame.target], strict=True):
            assert all(isclose(a, b, abs_tol=5e-4) for a, b in zip(shown, true, strict=True))
        assert [tuple(packet) for packet in made["pk"]] == [tuple(p) for p in frame.packets]
        assert [tuple(row) for row in made["age"]] == list(frame.ages)
        assert [bool(so) for so in made["lost"]] == list(frame.lost)
        assert made["mode"] == list(frame.modes)
        assert made["val"]["gap"] == pytest.approx(frame.values.gap_rad, abs=5e-4)
        for shown, belief in zip(made["bel"], frame.beliefs, strict=True):
            assert (shown is None) == (belief is None)
            if belief is not None:
                assert [n[0] for n in shown["n"]] == [peer.robot for peer in belief.peers]
                assert [n[3] for n in shown["n"]] == [peer.age_ticks for peer in belief.peers]
                assert len(shown["f"]) == len(belief.prediction)
        assert [event[0] for event in made["ev"]] == [event.kind for event in frame.events]


def test_a_frame_is_compact(scene):
    text = json.dumps(frame_json(scene.frames[5]), separators=(",", ":"))
    # Four robots: of each pair a packet and a belief, and little else.
    assert len(text) < 2500
    assert ".0," not in text
