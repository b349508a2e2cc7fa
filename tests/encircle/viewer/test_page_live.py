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


def drawn_lines(seen):
    """The columns that each chart draws as lines and as dots, by its place; None for a gap."""
    seen.until("document.querySelectorAll('#charts .bk-Figure').length === 6")
    return seen.page.evaluate(
        """() => Bokeh.documents.map((document) => {
          const [lines, dots] = document.roots()[0].renderers.map(({ data_source }) => data_source);
          const columns = ({ data }) => Object.fromEntries(["s", "v0"].map((name) =>
            [name, [...data[name]].map((value) => (Number.isFinite(value) ? value : null))]));
          return { lines: columns(lines), dots: columns(dots) };
        })"""
    )


def test_curves_have_gaps_where_ticks_were_missed_and_dots_between_two(seen, served):
    stage, frames = shown()
    parts = [
        [frame for frame in frames if frame["t"] in ticks]
        for ticks in ((4, 5, 8), (10, 11), (12, 16), range(17, 25))
    ]
    served.send(stage=stage, frames=parts[0], status=RUNNING)
    for part in parts[1:]:
        served.send(frames=part)
    seen.until("encircle.state().last_tick === 24")
    seen.until(
        "Bokeh.documents.length === 6 && Bokeh.documents.every((document) =>"
        " document.roots()[0].renderers[0].data_source.data.s.length === 18)"
    )
    drawn = drawn_lines(seen)
    ticks = [4, 5, 6, 8, 9, 10, 11, 12, 13, *range(16, 25)]
    known = [t for t in ticks if t not in (6, 9, 13)]
    for chart, column in ((0, lambda val: val["d"][0]), (3, lambda val: val["age"])):
        lines, dots = drawn[chart]["lines"], drawn[chart]["dots"]
        assert lines["s"] == pytest.approx([0.1 * t for t in ticks])
        assert [t for t, v in zip(ticks, lines["v0"], strict=True) if v is not None] == known
        assert dots == {"s": [pytest.approx(0.8)], "v0": [pytest.approx(column(frames[8]["val"]))]}
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
