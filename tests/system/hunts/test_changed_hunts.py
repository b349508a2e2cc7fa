"""Hunts over Zenoh that are changed while they go on, by the program that started them alone."""

import json

import pytest

import encircle
from encircle.protocol.codec import encode
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.messages import Intervention
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.replay.replaying import replay
from encircle.viewer.history import Position
from encircle.viewer.hunt_show import HuntShow
from encircle.viewer.showing import ShowOptions, WatchEnd
from encircle.world.recording.recording import read_recording
from encircle.world.recording.resuming import digest_of

PLAN = [
    {"kind": "loss", "rate": 0.8, "tick": 15},
    {"kind": "partition", "groups": [["r1", "r2"], ["r3", "r4"]], "tick": 30, "ticks": 20},
    {"kind": "move-target", "position": [3.0, 1.0], "tick": 41},
    {"kind": "crash", "robot": "r2", "tick": 50, "ticks": 10},
    {"kind": "silence", "robot": "r9"},
]


def given(*events):
    interventions = encircle.Interventions()
    for event in events:
        interventions.give(event)
    return interventions


def test_given_before_the_start_it_is_the_run_in_memory_message_by_message(tmp_path):
    hunts, recordings = {}, {}
    for link in ("memory", "zenoh"):
        hunts[link] = encircle.run(
            "sim1", link=link, out=tmp_path / link, interventions=given(*PLAN)
        )
        name = hunts[link].run.encode()
        recordings[link] = [
            (t, k, p.replace(name, b"")) for t, k, p in read_recording(tmp_path / link).messages
        ]
    assert hunts["zenoh"].result == hunts["memory"].result
    assert len(hunts["zenoh"].result.interventions) == 4
    assert recordings["zenoh"] == recordings["memory"]
    summary = json.loads((tmp_path / "zenoh" / "summary.json").read_text())
    assert summary["interventions"] == PLAN[:4]
    assert summary["scenario"]["events"] == []


def test_a_changed_run_that_was_cut_off_goes_on_as_processes_to_the_same_digest(tmp_path):
    hunt = encircle.run(
        "sim1",
        link="memory",
        out=tmp_path / "run",
        overrides=["target.step_m_max=0.6", "ticks_max=100"],
        interventions=given(*PLAN),
    )
    recording = tmp_path / "run" / "recording.mcap"
    whole = recording.read_bytes()
    recording.write_bytes(whole[: len(whole) * 6 // 10])
    resumed = encircle.resume(tmp_path / "run")
    assert resumed.digest == hunt.digest
    assert resumed.result.interventions == hunt.result.interventions


def test_given_while_it_goes_on_it_replays_to_the_same_digest(tmp_path):
    interventions, reports = encircle.Interventions(), []

    def follow(report):
        reports.append(report)
        ticks = [r["tick"] for r in reports if "tick" in r]
        if ticks == [report.get("tick")]:
            # The first tick that is heard of; the world is further by now.
            interventions.give({"kind": "loss", "rate": 1.0})
            interventions.give({"kind": "loss", "rate": 1.5})

    hunt = encircle.run(
        "sim1",
        out=tmp_path / "run",
        overrides=["ticks_max=3000", "target.step_m_max=0.6"],
        interventions=interventions,
        progress=follow,
    )
    (event,) = hunt.result.interventions
    (taken,) = [report["intervention"] for report in reports if "intervention" in report]
    assert taken == {"given": event["tick"] - 1, "event": event}
    (refused,) = [r["refused_intervention"] for r in reports if "refused_intervention" in r]
    assert refused == "intervention.rate = 1.5: must be at most 1.0"
    recording = read_recording(tmp_path / "run")
    assert replay(recording).same
    assert digest_of(recording) == hunt.digest
    assert hunt.result.packets_lost == {"loss": 12 * (hunt.result.ticks - event["tick"])}


def test_who_looks_on_over_zenoh_sees_what_was_given_by_hand(tmp_path):
    interventions = given({"kind": "loss", "rate": 0.8, "tick": 5}, {"kind": "heal", "tick": 7})
    show = HuntShow(ShowOptions(browser=False, end=WatchEnd.RUN), False, interventions)
    try:
        encircle.run(
            "sim1",
            interventions=interventions,
            onlooker=show,
            overrides=["ticks_max=12"],
            pace=20.0,
        )
        message, _ = show.show.history.next_message(Position(), {})
    finally:
        show.stop()
    shown = {f["t"]: [text for _, text, _ in f["ev"]] for f in json.loads(message)["frames"]}
    assert "by hand: every link loses 80 % of packets" in shown[5]
    assert "by hand: silences, outages and partitions are over" in shown[7]


def test_nobody_else_can_change_a_run_by_any_key(tmp_path):
    expected = encircle.run("sim1", link="memory").digest
    connections, reports = [], []

    def intrude(report):
        reports.append(report)
        if "started" not in report:
            return
        run = report["run"]
        stranger = ZenohConnection(Endpoints(connect=(report["endpoint"],)), "encircle/nothing")
        connections.append(stranger)
        payload = encode(Intervention(0, {"kind": "loss", "tick": 1, "rate": 1.0}), run)
        for key in (
            world_key(run, "intervention"),
            robot_key(run, "r1", "intervention"),
            world_key(run, "state"),
        ):
            stranger.send(key, payload)

    hunt = encircle.run(
        "sim1", out=tmp_path / "run", progress=intrude, interventions=encircle.Interventions()
    )
    for connection in connections:
        connection.close()
    assert connections
    assert hunt.digest == expected
    assert hunt.result.interventions == ()
    assert not any("intervention" in topic for _, topic, _ in read_recording(hunt.out).messages)


@pytest.mark.realtime
@pytest.mark.parametrize("radio", ["world", "direct"])
def test_by_the_clock_what_is_given_counts_from_the_next_tick_on(tmp_path, radio):
    interventions, ticks = encircle.Interventions(), []

    def follow(report):
        if "tick" in report and not ticks:
            ticks.append(report["tick"])
            interventions.give({"kind": "loss", "rate": 1.0})

    hunt = encircle.run(
        "sim1",
        out=tmp_path / "run",
        overrides=[
            "clock=wall",
            f"radio={radio}",
            "ticks_max=40",
            "tick_s=0.05",
            "target.step_m_max=0.6",
        ],
        interventions=interventions,
        progress=follow,
    )
    (event,) = hunt.result.interventions
    assert event["tick"] > ticks[0]
    recording = read_recording(tmp_path / "run")
    assert recording.scenario.events[0].tick == event["tick"]
    assert replay(recording).differences == ()
    lost = hunt.result.packets_lost["loss"]
    assert 0 < lost <= 12 * (40 - event["tick"])
