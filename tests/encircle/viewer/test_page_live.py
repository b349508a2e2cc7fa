"""The page on a feed: before the run, along with it, when the connection breaks, another run."""

from functools import cache

import pytest
from helpers_feed import feed
from helpers_scene import hunted
from helpers_waiting import taken

from encircle.scene.as_json import frame_json, stage_json
from encircle.scene.builder import scene_of_recording

pytestmark = pytest.mark.browser

LOSSY = ('channel.loss={model="bernoulli", rate=0.4}', "ticks_max=30")
RUNNING = {"state": "running", "text": "", "complete": True, "control": False}


@cache
def shown(seed=2):
    scene = scene_of_recording(hunted("sim1", LOSSY, seed)[0])
    return stage_json(scene.stage) | {"run": f"run-{seed}"}, [frame_json(f) for f in scene.frames]


@pytest.fixture
def served():
    with feed() as made:
        yield made


@pytest.fixture
def seen(served, new_page):
    """A page that has connected to the feed."""
    made = new_page()
    made.page.goto(served.address)
    assert taken(served.heard) == {"resume": {"run": None, "from": 0}}
    return made.until("encircle.state().connection === 'open'")


def test_before_the_run_it_says_that_there_is_nothing_yet(seen, served):
    assert "No data yet" in seen.text("#notice")
    served.send(status={"state": "waiting", "text": "r3 has not joined yet"})
    seen.until("encircle.state().notice === 'r3 has not joined yet'")
    assert seen.complaints == []


def test_it_follows_a_run_and_can_be_held(seen, served):
    stage, frames = shown()
    served.send(stage=stage, frames=frames[:4], status=RUNNING)
    seen.until("encircle.state().following && encircle.state().time === 3")
    served.send(frames=frames[4:9])
    seen.until("encircle.state().time === 8")
    assert seen.page.locator("#follow").is_visible()
    seen.do("seek(2)")
    served.send(frames=frames[9:12])
    seen.until("encircle.state().last_tick === 11")
    assert seen.state()["tick"] == 2
    seen.press("l").until("encircle.state().time === 11")
    served.send(frames=frames[12:], status={"state": "ended"})
    last = len(frames) - 1
    seen.until(f"encircle.state().time === {last} && !encircle.state().following")
    assert not seen.page.locator("#follow").is_visible()
    assert seen.complaints == []
    assert {url.split("/")[2] for url in seen.requests if "://" in url} == {
        served.address.split("/")[2]
    }


def test_a_lost_connection_is_told_and_what_was_missed_comes_after(seen, served):
    stage, frames = shown()
    served.send(stage=stage, frames=frames[:6], status=RUNNING)
    seen.until("encircle.state().last_tick === 5")
    served.drop()
    seen.until("encircle.state().connection === 'lost'")
    assert "Connection lost" in seen.text("#notice")
    assert "What came so far stays" in seen.text("#notice")
    assert seen.do("seek(3)").state()["tick"] == 3, "what is there can be looked at"
    served.answer = [{"stage": stage, "frames": frames[6:10], "status": RUNNING}]
    served.accepts = True
    assert taken(served.heard) == {"resume": {"run": "run-2", "from": 6}}
    state = seen.until("encircle.state().last_tick === 9").state()
    assert (state["connection"], state["notice"], state["tick"]) == ("open", None, 3)


def test_the_same_frames_again_change_nothing(seen, served):
    stage, frames = shown()
    served.send(stage=stage, frames=frames, status={"state": "ended"})
    before = seen.until(f"encircle.state().last_tick === {len(frames) - 1}").do("seek(20)").state()
    served.send(stage=stage, frames=frames)
    served.send(status={"text": "again"})
    after = seen.until("encircle.state().notice === 'again'").state()
    changed = {key for key in before if before[key] != after[key]}
    assert changed == {"notice"}


def test_another_run_begins_the_page_anew(seen, served):
    stage, frames = shown()
    served.send(stage=stage, frames=frames[:12], status=RUNNING)
    seen.until("encircle.state().last_tick === 11").do("select('r2')")
    other, others = shown(seed=3)
    served.send(stage=other, frames=others[:3], status=RUNNING)
    state = seen.until("encircle.state().last_tick === 2").state()
    assert (state["run"], state["selected"], state["following"]) == ("run-3", None, True)


def test_a_replay_from_a_server_waits_at_its_start(seen, served):
    stage, frames = shown()
    served.send(stage=stage, frames=frames, status={"state": "ended", "complete": False})
    seen.until("encircle.state().ready")
    state = seen.drawn().state()
    assert (state["tick"], state["playing"], state["following"]) == (0, False, False)
    assert "cut off" in state["notice"]


def test_a_recording_that_is_still_being_read_says_nothing_of_its_end(seen, served):
    stage, frames = shown()
    served.send(stage=stage, frames=frames[:6], status={"state": "waiting"})
    seen.until("encircle.state().last_tick === 5")
    assert seen.state()["outcome"] == "reading the recording"
    seen.do("play()").until("encircle.state().time === 5")
    assert seen.state()["playing"], "it waits for what is read next"
    served.send(frames=frames[6:])
    served.send(status={"state": "ended", "complete": True})
    last = len(frames) - 1
    seen.until(f"encircle.state().time === {last} && !encircle.state().playing")
    assert seen.state()["outcome"] != "reading the recording"
    assert seen.complaints == []


def test_who_comes_late_sees_what_is_left_and_that_something_is_not(seen, served):
    stage, frames = shown()
    served.send(stage=stage, frames=frames[10:20], status=RUNNING)
    seen.until("encircle.state().time === 19")
    assert "since tick 10" in seen.text("#notice")
    assert seen.do("seek(3)").state()["tick"] == 10
    assert seen.page.get_attribute("#slider", "min") == "10"
    sent = sum(len(frame["pk"]) for frame in frames[10:15])
    assert sum(seen.do("seek(15)").state()["fates"].values()) == sent
    assert seen.complaints == []


def test_ticks_that_were_missed_on_the_way_are_told_and_passed_over(seen, served):
    stage, frames = shown()
    some = [frame for frame in frames if frame["t"] not in (7, 8, 12)]
    served.send(stage=stage, frames=some, status={**RUNNING, "missed_ticks": 3})
    seen.until(f"encircle.state().last_tick === {len(frames) - 1}")
    assert "too slow for 3 ticks" in seen.text("#notice")
    for tick in (6, 7, 8, 9, 12, 13):
        assert seen.do(f"seek({tick})").state()["tick"] == tick
    seen.do("select('r1')").do("play()").until("encircle.state().tick >= 15")
    assert seen.complaints == []


def test_why_a_belief_is_not_known_is_told(seen, served):
    stage, frames = shown()
    doubt = ["unsure", "what r2 believes is not known: its policy is not here", ["r2"]]
    unsure = [
        frame
        | {"bel": [None if k == 1 else b for k, b in enumerate(frame["bel"])], "unsure": ["r2"]}
        | {"ev": [doubt] if frame["t"] == 0 else []}
        for frame in frames
    ]
    served.send(stage=stage, frames=unsure, status=RUNNING)
    seen.until("encircle.state().ready").do("seek(5)").do("select('r2')")
    assert "What r2 believes is not known: its policy is not here" in seen.text("#belief")
    assert seen.do("select('r1')").state()["belief"] is not None
