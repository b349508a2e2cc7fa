"""The file for Foxglove, read by another reader than the one that wrote it, against the truth."""

from math import atan2, pi

import pytest
from helpers_exports import lossy_hunt, radios_of, states_of
from helpers_protobuf import decoded_messages
from mcap.reader import make_reader

from encircle.exports.foxglove_file import export
from encircle.scene.builder import scene_of_recording
from encircle.world.channel.loss_causes import CAUSES


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    path = tmp_path_factory.mktemp("foxglove") / "hunt.mcap"
    export(lossy_hunt(), path)
    return path


@pytest.fixture(scope="module")
def messages(exported):
    return decoded_messages(exported)


def of_topic(messages, topic):
    return [(time_ns, value) for found, time_ns, _, value in messages if found == topic]


def xy(vector):
    return (vector["x"], vector["y"])


def heading_rad(quaternion):
    return 2.0 * atan2(quaternion["z"], quaternion["w"])


def same_angle(one, other):
    return (one - other + pi) % (2.0 * pi) == pytest.approx(pi, abs=1e-9)


def test_poses_are_where_the_world_says(messages):
    recording = lossy_hunt()
    tick_ns = round(recording.scenario.tick_s * 1e9)
    for (time_ns, message), state in zip(
        of_topic(messages, "/poses"), states_of(recording), strict=True
    ):
        assert time_ns == state.tick * tick_ns
        assert message["frame_id"] == "map"
        stamp = message["timestamp"]
        assert stamp["seconds"] * 10**9 + stamp["nanos"] == time_ns
        assert [xy(pose["position"]) for pose in message["poses"]] == list(state.robots)
        for pose, heading in zip(message["poses"], state.headings_rad, strict=True):
            assert same_angle(heading_rad(pose["orientation"]), heading)


def test_each_body_has_a_pose_and_a_frame_of_its_own(messages):
    recording = lossy_hunt()
    names = [*recording.scenario.ids, "target"]
    transforms = of_topic(messages, "/tf")
    for (_, message), state in zip(transforms, states_of(recording), strict=True):
        frames = message["transforms"]
        assert [frame["child_frame_id"] for frame in frames] == names
        assert {frame["parent_frame_id"] for frame in frames} == {"map"}
        assert [xy(frame["translation"]) for frame in frames] == [*state.robots, state.target]
    targets = [xy(m["pose"]["position"]) for _, m in of_topic(messages, "/pose/target")]
    assert targets == [state.target for state in states_of(recording)]


def test_bodies_are_drawn_where_they_are_and_as_large_as_they_are(messages):
    scenario = lossy_hunt().scenario
    drawn = of_topic(messages, "/scene/bodies")
    for (_, message), state in zip(drawn, states_of(lossy_hunt()), strict=True):
        discs = {e["id"]: e["cylinders"][0] for e in message["entities"]}
        places = {name: xy(disc["pose"]["position"]) for name, disc in discs.items()}
        assert places == dict(
            zip([*scenario.ids, "target"], [*state.robots, state.target], strict=True)
        )
        assert discs["r1"]["size"]["x"] == pytest.approx(2.0 * scenario.team.radius_m)
        assert [d["type"] for d in message["deletions"]] == [1], "nothing stays of the tick before"
    (_, arena), *_ = of_topic(messages, "/scene/arena")
    obstacles = [xy(e["cylinders"][0]["pose"]["position"]) for e in arena["entities"]]
    assert obstacles == [o.position for o in scenario.obstacles]


def test_packets_have_the_fates_that_the_radio_gave_them(messages):
    robots = lossy_hunt().scenario.ids
    told = of_topic(messages, "/packets")
    kinds = set()
    for (_, message), radio in zip(told, radios_of(lossy_hunt()), strict=False):
        expected = {
            (robots[s], robots[r]): due
            for s, row in enumerate(radio.fates)
            for r, due in enumerate(row)
            if due
        }
        found = {(p["sender"], p["receiver"]): p for p in message["packets"]}
        assert found.keys() == expected.keys()
        for link, due in expected.items():
            packet = found[link]
            assert packet.get("due_tick", 0) == max(due, 0)
            on_time = "arrived" if due == radio.tick + 1 else "late"
            assert packet["fate"] == (CAUSES[-due] if due < 0 else on_time)
            kinds.add(packet["fate"])
        assert message["lost"] == sum(due < 0 for due in expected.values())
        assert message["sent"] == message["arrived"] + message["late"] + message["lost"]
    assert kinds >= {"arrived", "late", "loss"}


def test_numbers_are_plain_json_with_a_schema_that_names_them(exported, messages):
    frames = scene_of_recording(lossy_hunt()).frames
    for (_, values), frame in zip(of_topic(messages, "/values"), frames, strict=True):
        known = frame.values
        assert values["gap_rad"] == known.gap_rad
        assert values.get("age_ticks_mean") == known.age_ticks_mean
        assert values.get("delivery_share") == known.delivery
    ages = [ages for _, ages in of_topic(messages, "/ages_ticks/r1")]
    assert ages[0] == {}, "nothing has been received at the first tick"
    assert all(set(row) <= {"r2", "r3"} for row in ages)
    assert [row.get("r3", -1) for row in ages] == [frame.ages[0][2] for frame in frames]
    with open(exported, "rb") as file:
        summary = make_reader(file).get_summary()
    by_name = {schema.name: schema for schema in summary.schemas.values()}
    assert by_name["encircle/values"].encoding == "jsonschema"
    assert b'"gap_rad": {"type": "number"}' in by_name["encircle/values"].data


def test_a_belief_shows_peers_where_the_robot_takes_them_to_be(messages):
    scene = scene_of_recording(lossy_hunt())
    shown = of_topic(messages, "/scene/beliefs/r3")
    ghosts = 0
    for (_, message), frame in zip(shown, scene.frames, strict=True):
        belief = frame.beliefs[2]
        labels = {e["id"]: e["texts"] for e in message["entities"]}
        if belief is None:
            assert not labels
            continue
        for peer in belief.peers:
            (label,) = labels[scene.stage.robots[peer.robot]]
            assert label["text"].split(", ")[1].split()[0] == str(peer.age_ticks)
            assert label["pose"]["position"]["x"] == peer.x
            ghosts += 1
    assert ghosts > 0


def test_events_are_logged_when_they_happen(messages):
    logged = {
        (time_ns // 10**8, log["message"], log["level"])
        for time_ns, log in of_topic(messages, "/events")
    }
    assert (3, "r1's radio is off", 3) in logged
    assert (6, "r2 is lost", 3) in logged
    assert (13, "r2 is back", 2) in logged


def test_without_beliefs_the_topics_are_there_and_show_nothing(tmp_path):
    export(lossy_hunt(), tmp_path / "hunt.mcap", beliefs=False)
    shown = of_topic(decoded_messages(tmp_path / "hunt.mcap"), "/scene/beliefs/r1")
    assert len(shown) == len(states_of(lossy_hunt()))
    assert not any(message["entities"] for _, message in shown)


def test_the_same_recording_gives_the_same_bytes(exported, tmp_path):
    export(lossy_hunt(), tmp_path / "again.mcap")
    assert (tmp_path / "again.mcap").read_bytes() == exported.read_bytes()
