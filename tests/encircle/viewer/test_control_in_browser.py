"""The radio in the reader's hand, in a real browser: what a page sends, and a hunt it changes."""

import threading
from functools import cache

import numpy as np
import pytest
from helpers_feed import feed
from helpers_scene import hunted
from helpers_waiting import taken

import encircle
from encircle.replay.replaying import replay
from encircle.scene.as_json import frame_json, stage_json
from encircle.scene.builder import scene_of_recording
from encircle.viewer.hunt_show import HuntShow
from encircle.viewer.showing import ShowOptions, WatchEnd
from encircle.world.recording.recording import read_recording
from encircle.world.recording.resuming import digest_of

pytestmark = pytest.mark.browser

OWN = {"rate": 0.4, "delay_s": 0.0, "range_m": None}
NONE = {"rate": None, "delay_s": None, "range_m": None}


@cache
def shown():
    scene = scene_of_recording(hunted("sim1", ["ticks_max=12"])[0])
    return stage_json(scene.stage), [frame_json(frame) for frame in scene.frames]


@pytest.fixture
def served():
    with feed() as made:
        yield made


@pytest.fixture
def seen(served, new_page):
    """A page that may change the radio, and has asked what is in force."""
    stage, frames = shown()
    made = new_page()
    made.page.goto(served.address)
    assert taken(served.heard) == {"resume": {"run": None, "from": 0}}
    served.send(stage=stage, frames=frames, status={"state": "running", "control": True})
    made.until("encircle.state().ready")
    made.page.wait_for_selector("#control-loss")
    assert taken(served.heard) == {"radio": True}
    served.send(control={"radio": {"own": OWN, "now": NONE, "tick_s": 0.1}})
    made.page.wait_for_selector("text=40 % (scenario)")
    return made


def given(served):
    """The event that the page sends next."""
    return taken(served.heard)["intervene"]


def says(seen, text):
    """Wait until the panel says something."""
    return seen.page.wait_for_selector(f"#control-said:has-text('{text}')")


def test_sliders_send_numbers_in_the_units_of_events_and_back_the_scenarios_own(seen, served):
    for name, value, event in (
        ("loss", "70", {"kind": "loss", "rate": 0.7}),
        ("delay", "0.25", {"kind": "delay", "delay_s": 0.25}),
        ("range", "8.5", {"kind": "range", "range_m": 8.5}),
    ):
        seen.page.locator(f"#control-{name}").fill(value)
        assert given(served) == event
        served.send(control={"taken": {"given": 4, "event": event | {"tick": 5}}})
        says(seen, "Taken at tick 4; in force from tick 5 on: ")
        assert seen.page.locator(f"#control-{name}").input_value() == value
    assert seen.text("output[for=control-delay]") == "0.25 s (3 ticks)"
    seen.page.click("#control-loss-own")
    assert given(served) == {"kind": "loss"}
    served.send(control={"taken": {"given": 6, "event": {"kind": "loss", "tick": 7}}})
    says(seen, "loss as the scenario has it")
    assert seen.text("output[for=control-loss]") == "40 % (scenario)"
    assert seen.page.locator("#control-loss-own").is_disabled()
    assert seen.complaints == []


def test_what_is_in_force_is_asked_anew_when_the_scenario_changes_the_radio(seen, served):
    _, frames = shown()
    served.send(frames=[frames[5] | {"ev": [["contact", "r1 and r2 touch", ["r1", "r2"]]]}])
    served.send(frames=[frames[6] | {"ev": [["loss", "every link loses 70 % of packets", []]]}])
    seen.until("encircle.state().events === 3")
    seen.page.click("#control-heal")
    said = [taken(served.heard), taken(served.heard)]
    assert said == [{"radio": True}, {"intervene": {"kind": "heal"}}]
    served.send(control={"radio": {"own": OWN, "now": NONE | {"rate": 0.7}, "tick_s": 0.1}})
    seen.until("document.querySelector('output[for=control-loss]').value === '70 %'")
    assert seen.complaints == []


def test_a_slider_moves_by_keys_and_a_refused_value_goes_back(seen, served):
    seen.page.locator("#control-loss").focus()
    seen.press("ArrowRight")
    assert given(served) == {"kind": "loss", "rate": 0.41}
    served.send(control={"refused": "intervention: the run is over"})
    says(seen, "the run is over")
    assert seen.text("output[for=control-loss]") == "40 % (scenario)"
    seen.press("ArrowRight")
    assert given(served) == {"kind": "loss", "rate": 0.41}, "it may be tried again"


def test_buttons_cut_heal_and_silence(seen, served):
    seen.page.click("#control-cut")
    assert given(served) == {"kind": "partition", "groups": [["r1", "r2"], ["r3", "r4"]]}
    for robot in ("r2", "r4"):
        seen.page.click(f".sides button:has-text('{robot}')")
    seen.page.click("#control-cut")
    assert given(served) == {"kind": "partition", "groups": [["r1", "r4"], ["r2", "r3"]]}
    for robot in ("r1", "r4"):
        seen.page.click(f".sides button:has-text('{robot}')")
    seen.page.click("#control-cut")
    says(seen, "Both sides of a cut need a robot")
    seen.page.click("#control-heal")
    assert given(served) == {"kind": "heal"}, "of the cut nothing was sent"
    seen.page.select_option("#control-silence", "r3")
    seen.page.fill("#control-ticks", "12")
    seen.page.click("#control-hush")
    assert given(served) == {"kind": "silence", "robot": "r3", "ticks": 12}


def test_a_press_in_the_arena_moves_the_target_there_and_picks_nobody(seen, served):
    box = seen.page.locator("#arena").bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def pressed(right_px, down_px):
        seen.page.click("#control-move")
        seen.page.mouse.click(middle[0] + right_px, middle[1] + down_px)
        event = given(served)
        assert event["kind"] == "move-target"
        served.send(control={"taken": {"given": 4, "event": event | {"tick": 5}}})
        says(seen, "Taken at tick 4; at tick 5: target to (")
        return np.array(event["position"])

    # The middle of the view is the middle of the hunt, more or less, and every metre is as long;
    # the view may still be moving a little.
    centre, right, down = pressed(0, 0), pressed(100, 0), pressed(0, 100)
    frame = shown()[1][seen.state()["tick"]]
    everyone = np.array([*frame["r"], frame["g"]])
    assert (everyone.min(axis=0) < centre).all()
    assert (centre < everyone.max(axis=0)).all()
    length_m = right[0] - centre[0]
    assert length_m > 0.1
    assert right == pytest.approx(centre + np.array([length_m, 0.0]), abs=0.15)
    assert down == pytest.approx(centre - np.array([0.0, length_m]), abs=0.15)
    assert seen.drawn().state()["selected"] is None
    seen.page.click("#control-move")
    seen.press("Escape")
    assert seen.page.get_attribute("#control-move", "aria-pressed") == "false"
    seen.page.mouse.click(box["x"] + 5, box["y"] + 5)
    seen.page.click("#control-heal")
    assert given(served) == {"kind": "heal"}, "the press after Escape moved nothing"


def test_when_the_run_is_over_nothing_can_be_pressed_and_the_page_says_why(seen, served):
    controls = seen.page.locator("#control button, #control input, #control select")
    assert controls.count() > 10
    assert not seen.page.locator("#control-over").is_visible()
    seen.page.click("#control-move")
    seen.page.locator("#control-delay").focus()
    served.send(status={"state": "ended"})
    seen.page.wait_for_selector("#control-over:has-text('The run is over')")
    assert controls.evaluate_all("all => all.every((one) => one.matches(':disabled'))")
    assert seen.page.get_attribute("#control-move", "aria-pressed") == "false"
    assert seen.press("Home").state()["tick"] == 0, "keys are for the page again"
    box = seen.page.locator("#arena").bounding_box()
    seen.page.mouse.click(box["x"] + 5, box["y"] + 5)
    assert seen.complaints == []
    stage, frames = shown()
    served.send(stage=stage | {"run": "another"}, frames=frames, status={"state": "running"})
    seen.page.wait_for_selector("#control-over", state="hidden")
    seen.page.click("#control-heal")
    while "intervene" not in (heard := taken(served.heard)):
        assert heard == {"radio": True}
    assert heard["intervene"] == {"kind": "heal"}, "before it nothing was sent"


def test_after_a_lost_connection_it_asks_again_what_is_in_force(seen, served):
    stage, frames = shown()
    served.answer = [{"stage": stage, "frames": frames, "status": {"control": True}}]
    served.drop(accepts=True)
    assert "resume" in taken(served.heard)
    assert taken(served.heard) == {"radio": True}


def test_a_page_that_may_not_has_no_controls(served, new_page):
    stage, frames = shown()
    page = new_page()
    page.page.goto(served.address)
    taken(served.heard)
    served.send(stage=stage, frames=frames, status={"state": "running", "control": False})
    page.until("encircle.state().ready").drawn()
    assert page.page.locator("#control").is_hidden()
    assert page.page.locator("#control-loss").count() == 0


class Gate:
    """Holds a hunt in memory until the test lets it go, when there is something to be seen."""

    def __init__(self):
        self.reached, self.opened = threading.Event(), threading.Event()

    def __call__(self, report):
        if report.get("tick", 0) > 0 and not self.reached.is_set():
            self.reached.set()
            self.opened.wait()


def test_a_slider_that_is_moved_in_a_running_hunt_makes_losses_and_the_digest_replays(
    new_page, tmp_path
):
    interventions, gate, hunts = encircle.Interventions(), Gate(), []
    show = HuntShow(ShowOptions(browser=False, end=WatchEnd.RUN), True, interventions)

    def progress(report):
        show.on_report(report)
        gate(report)

    def hunt():
        hunts.append(
            encircle.run(
                "sim1",
                link="memory",
                out=tmp_path / "run",
                overrides=["ticks_max=80", "target.step_m_max=0.6"],
                interventions=interventions,
                onlooker=show,
                progress=progress,
                pace=4.0,
            )
        )

    thread = threading.Thread(target=hunt)
    thread.start()
    try:
        gate.reached.wait()
        starter, other = new_page(), new_page()
        starter.open(show.show.server.address)
        other.open(show.show.server.address.partition("?")[0])
        starter.page.locator("#control-loss").fill("100")
        while not interventions._waiting:
            starter.drawn()
        gate.opened.set()
        starter.until("encircle.state().fates.loss > 0")
        starter.page.wait_for_selector(
            "#events :text('by hand: every link loses 100 % of packets')"
        )
        assert other.page.locator("#control").is_hidden()
    finally:
        gate.opened.set()
        thread.join()
        show.stop()
    (done,) = hunts
    (event,) = done.result.interventions
    assert (event["kind"], event["rate"]) == ("loss", 1.0)
    assert done.result.packets_lost == {"loss": 12 * (80 - event["tick"])}
    recording = read_recording(tmp_path / "run")
    assert replay(recording).same
    assert digest_of(recording) == done.digest
    assert starter.complaints == []
