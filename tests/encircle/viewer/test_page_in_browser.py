"""The page in a real browser: a replay in one file, from the disk, with the network off."""

from functools import cache
from math import hypot

import pytest
from helpers_browser import LAPTOP
from helpers_scene import hunted

from encircle.runner.hunts import run
from encircle.scene.builder import scene_of_recording
from encircle.viewer.html_export import page_html
from encircle.world.recording.recording import read_recording

pytestmark = pytest.mark.browser

LOSSY = (
    'channel.loss={model="bernoulli", rate=0.6}',
    'channel.delay={model="gamma", mean_s=0.15, std_s=0.1}',
    "sensing.noise_m_std=0.1",
)
MANY = (
    "team={robots=16}",
    'channel.loss={model="gilbert-elliott", good_to_bad=0.1, bad_to_good=0.3}',
    "ticks_max=60",
)
SILENCE = 'events=[{kind="silence", tick=5, ticks=4, robot="r2"}]'
ROUNDED_M = 0.002
"""Places are rounded to mm, both ends of a distance."""


@cache
def scene(scenario="sim1", changes=LOSSY):
    return scene_of_recording(hunted(scenario, changes)[0])


@pytest.fixture
def page_of(new_page, tmp_path):
    """Opens a scene's page from the disk, offline; holds at the end that it kept to that."""
    opened = []

    def open_page(shown, anchor="", **options):
        file = tmp_path / f"{len(opened)}.html"
        file.write_text(page_html(shown), encoding="utf-8")
        seen = new_page(offline=True, **options)
        opened.append(seen)
        return seen.open(file.as_uri() + (f"#{anchor}" if anchor else ""))

    yield open_page
    for seen in opened:
        assert seen.complaints == []
        assert seen.foreign_requests == []


def test_a_file_shows_the_run_without_a_network(page_of):
    shown = scene()
    seen = page_of(shown)
    state = seen.state()
    assert state["run"] == shown.stage.run
    assert (state["tick"], state["last_tick"]) == (0, shown.frames[-1].tick)
    assert (state["connection"], state["notice"]) == ("embedded", None)
    assert seen.text("#title") == "Simulation 1: four robots"
    assert seen.text("#seed") == f"seed {shown.stage.seed}"
    assert "loss 60 %" in seen.text("#channel")
    assert len(seen.page.query_selector_all("#charts figure")) == 6
    seen.until("document.querySelectorAll('#charts .bk-Figure').length === 6")


def test_it_is_ready_only_when_the_run_is_drawn(new_page, tmp_path):
    (tmp_path / "run.html").write_text(page_html(scene()), encoding="utf-8")
    seen = new_page(offline=True)
    seen.page.add_init_script(
        "const draw = requestAnimationFrame; const asked = [];"
        "window.requestAnimationFrame = (act) => asked.push(act);"
        "window.letDraw = () => { window.requestAnimationFrame = draw; asked.forEach(draw); };"
    )
    seen.page.goto((tmp_path / "run.html").as_uri())
    state = seen.state()
    assert (state["title"], state["ready"]) == ("Simulation 1: four robots", False)
    assert seen.text("#title") == "Encircle"
    seen.page.evaluate("letDraw()")
    assert seen.drawn().state()["ready"]
    assert seen.text("#title") == "Simulation 1: four robots"


def test_the_slider_reaches_the_capture(page_of):
    shown = scene()
    capture = shown.frames[-1]
    assert capture.captured
    seen = page_of(shown)
    assert seen.state()["captured"] is False
    slider = seen.page.locator("#slider")
    assert int(slider.get_attribute("max")) == capture.tick
    box = slider.bounding_box()
    seen.page.mouse.click(box["x"] + box["width"] - 2, box["y"] + box["height"] / 2)
    state = seen.drawn().state()
    assert (state["tick"], state["captured"]) == (capture.tick, True)
    assert f"captured at tick {capture.tick}" in seen.text("#outcome")
    assert f"tick {capture.tick} of" in slider.get_attribute("aria-valuetext")


def test_playing_moves_and_pausing_stops(page_of):
    seen = page_of(scene()).do("play()")
    seen.until("encircle.state().tick >= 3 && encircle.state().playing")
    stopped = seen.do("pause()").state()
    seen.drawn()
    assert seen.state()["time"] == stopped["time"]
    assert stopped["tick"] >= 3
    assert seen.page.get_attribute("#play", "aria-label") == "Play"


def test_playing_ends_at_the_end_and_begins_again(page_of):
    seen = page_of(scene(), "speed=10")
    last = seen.state()["last_tick"]
    seen.do(f"seek({last - 2})").do("play()").until("!encircle.state().playing")
    assert seen.state()["time"] == last
    seen.do("play()").until(f"encircle.state().tick < {last} && encircle.state().playing")


def test_a_robots_world_differs_from_the_truth_as_the_scene_says(page_of):
    shown = scene()
    seen = page_of(shown)
    errors = []
    for frame in shown.frames[5:-1:4]:
        seen.do(f"seek({frame.tick})")
        for k, robot in enumerate(shown.stage.robots):
            belief = seen.do(f"select('{robot}')").state()["belief"]
            expected = frame.beliefs[k]
            for (name, error_m), peer in zip(belief["peers"], expected.peers, strict=True):
                x, y = frame.robots[peer.robot]
                assert name == shown.stage.robots[peer.robot]
                assert error_m == pytest.approx(hypot(peer.x - x, peer.y - y), abs=ROUNDED_M)
                errors.append(error_m)
            if expected.estimate is None:
                assert belief["target"] is None
                continue
            x, y = frame.target
            off_m = hypot(expected.estimate[0] - x, expected.estimate[1] - y)
            assert belief["target"] == pytest.approx(off_m, abs=ROUNDED_M)
    assert max(errors) > 0.1
    assert "As r4 believes it" in seen.text("#belief")


def test_counts_of_fates_are_the_scenes(page_of):
    shown = scene()
    seen = page_of(shown)
    for tick in (0, 1, 7, shown.frames[-1].tick):
        counts = dict.fromkeys(["arrived", "late", *shown.stage.causes[1:]], 0)
        for frame in shown.frames[:tick]:
            for packet in frame.packets:
                late = packet.due > frame.tick + 1
                lost = shown.stage.causes[-packet.due] if packet.due < 0 else None
                counts[lost or ("late" if late else "arrived")] += 1
        assert seen.do(f"seek({tick})").state()["fates"] == counts
        for fate in ("arrived", "late", "loss"):
            assert seen.text(f"[data-fate={fate}] .count") == str(counts[fate])
    assert min(counts[fate] for fate in ("arrived", "late", "loss")) > 0


def test_copies_of_packets_count_as_in_the_runs_result(page_of, tmp_path):
    changes = [
        'channel.delay={model="uniform", low_s=0.0, high_s=0.5}',
        "channel.duplication.rate=0.3",
        "ticks_max=25",
    ]
    hunt = run("sim1", link="memory", overrides=changes, out=tmp_path / "run")
    shown = scene_of_recording(read_recording(tmp_path / "run"))
    fates = page_of(shown).do("seek(25)").state()["fates"]
    sent = [due for f in shown.frames for p in f.packets for due in (p.due, p.copy_due)]
    in_flight = sum(due > 25 for due in sent)
    assert fates["arrived"] + fates["late"] - in_flight == hunt.result.packets_delivered
    assert hunt.result.packets_copied > 0


def test_a_fate_can_be_switched_off(page_of):
    seen = page_of(scene(), "tick=8")
    drawn = seen.drawn().state()["packets_drawn"]
    seen.page.click("[data-fate=loss]")
    assert seen.drawn().state()["packets_drawn"] < drawn
    assert seen.page.get_attribute("[data-fate=loss]", "aria-pressed") == "false"
    assert seen.press("p").state()["packets_drawn"] == 0


def test_everything_is_done_by_key(page_of):
    seen = page_of(scene(changes=(*LOSSY, SILENCE)))
    last = seen.state()["last_tick"]

    def after(*keys):
        return seen.press(*keys).state()

    assert after("ArrowRight")["tick"] == 1
    assert after("Shift+ArrowRight")["tick"] == 11
    assert after("ArrowLeft")["tick"] == 10
    assert after("End")["tick"] == last
    assert after("b")["tick"] == 9, "the radio is on again"
    assert after("b")["tick"] == 5
    assert after("n", "n")["tick"] == last, "the capture"
    assert after("Home")["tick"] == 0
    assert after("2")["selected"] == "r2"
    assert after("]")["selected"] == "r3"
    assert after("[", "[")["selected"] == "r1"
    assert after("Escape")["selected"] is None
    for key, layer in (
        ("p", "packets"),
        ("o", "own"),
        ("t", "trails"),
        ("r", "rings"),
        ("g", "goals"),
    ):
        before = seen.state()["layers"][layer]
        assert after(key)["layers"][layer] is not before
    speed = seen.state()["speed"]
    assert after("+")["speed"] > speed
    assert after("-")["speed"] == speed
    assert after("z")["view"] == "close"
    assert after("x")["large_type"] is True
    assert after("Space")["playing"] is True
    assert after("Space")["playing"] is False
    seen.press("?")
    assert seen.page.locator("#help").is_visible()
    assert seen.page.locator("#keys tr").count() > 20
    seen.press("Escape")
    assert not seen.page.locator("#help").is_visible()


def test_keys_do_once_what_they_do_also_on_the_slider_and_a_button(page_of):
    seen = page_of(scene())
    seen.page.focus("#slider")
    assert seen.press("ArrowRight").state()["tick"] == 1
    seen.page.focus("#layer-trails")
    assert seen.press("Space").state()["layers"]["trails"] is False
    assert seen.state()["playing"] is False


@pytest.mark.parametrize("system", ["light", "dark"])
def test_dark_and_light_as_the_system_has_it_and_by_switch(page_of, system):
    def brightness():
        colour = seen.page.evaluate("getComputedStyle(document.body).backgroundColor")
        return sum(map(int, colour[colour.index("(") + 1 : -1].split(",")[:3]))

    seen = page_of(scene(), color_scheme=system)
    assert seen.state()["theme"] == system
    first = brightness()
    assert (first > 3 * 128) == (system == "light")
    seen.page.click("#theme")
    seen.drawn()
    assert seen.state()["theme"] != system
    assert (brightness() > 3 * 128) != (system == "light")


def test_a_click_picks_a_robot_a_time_an_event(page_of):
    shown = scene()
    seen = page_of(shown)
    box = seen.page.locator("#matrix").bounding_box()
    seen.page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.95 * box["height"])
    assert seen.drawn().state()["selected"] == "r4"
    seen.until("document.querySelectorAll('#charts .bk-Figure').length === 6")
    box = seen.page.locator("#chart-gap .plot").bounding_box()
    seen.page.mouse.click(box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"])
    assert 0.3 < seen.drawn().state()["tick"] / shown.frames[-1].tick < 0.8
    seen.page.locator("#events button").last.click()
    assert seen.drawn().state()["captured"] is True
    seen.page.select_option("#robot", label="r2")
    assert seen.drawn().state()["selected"] == "r2"


def test_an_address_says_what_to_show(page_of):
    state = page_of(scene(), "tick=7&robot=r3&theme=dark&type=large&view=close&speed=2").state()
    keys = ("tick", "selected", "theme", "large_type", "view", "speed")
    assert [state[key] for key in keys] == [7, "r3", "dark", True, "close", 2]


def test_an_address_that_is_changed_is_followed(page_of):
    seen = page_of(scene(), "tick=7")
    seen.page.evaluate("location.hash = 'tick=11&robot=r2'")
    state = seen.until("encircle.state().tick === 11").state()
    assert state["selected"] == "r2"


def test_the_view_from_close_by_is_where_it_belongs_while_the_hunt_is_paused(page_of):
    def picture(seen):
        return seen.page.evaluate("document.getElementById('arena').toDataURL()")

    shown = scene()
    end = shown.frames[-1].tick
    at_once = picture(page_of(shown, f"view=close&tick={end}"))
    assert picture(page_of(shown, "view=close").do(f"seek({end})")) == at_once
    assert picture(page_of(shown, f"tick={end}").press("z")) == at_once
    resized = page_of(shown, f"view=close&tick={end}", viewport={"width": 700, "height": 900})
    resized.page.set_viewport_size(LAPTOP)
    assert picture(resized.drawn()) == at_once


def test_after_a_change_the_radio_that_is_written_is_that_of_the_start(page_of):
    change = 'events=[{kind="loss", tick=5, rate=0.9}]'
    seen = page_of(scene("sim1", ("ticks_max=10", change)))
    assert seen.do("seek(4)").text("#channel").startswith("Radio: no loss")
    assert seen.do("seek(5)").text("#channel").startswith("Radio at the start")


def test_text_of_others_stays_text(page_of):
    hostile = "<img src=x onerror=alert(1)><b>bold</b>"
    changes = ("ticks_max=4", f'title="{hostile}"')
    seen = page_of(scene("sim1", changes))
    assert seen.text("#title") == hostile
    assert seen.page.locator("#title *").count() == 0
    assert hostile in seen.page.title()


def test_a_recording_that_was_cut_off_says_so(page_of):
    recording = hunted("sim1", LOSSY)[0]
    half = recording.messages[: len(recording.messages) // 2]
    cut = type(recording)(recording.path, recording.scenario, 2, recording.run, half, False)
    seen = page_of(scene_of_recording(cut))
    assert "cut off" in seen.text("#notice")
    assert "cut off" in seen.text("#outcome")


def test_a_recording_without_beliefs_says_so_when_one_is_asked_for(page_of):
    seen = page_of(scene_of_recording(hunted("sim1", LOSSY)[0], beliefs=False))
    assert seen.state()["notice"] is None
    seen.do("select('r1')")
    assert "no beliefs" in seen.text("#notice")
    assert seen.state()["belief"] is None


@pytest.mark.parametrize("robots", [3, 64])
def test_small_and_large_teams(page_of, robots):
    team = f"team={{robots={robots}, placement={{distance_m_max=40.0}}}}"
    seen = page_of(scene("sim1", (team, "ticks_max=3")))
    state = seen.do("seek(1)").do(f"select('r{robots}')").state()
    assert state["selected"] == f"r{robots}"
    assert state["fates"]["arrived"] == robots * (robots - 1)
    assert len(state["belief"]["peers"]) == robots - 1


def test_sixteen_robots_and_all_links_are_drawn(page_of, record_property):
    """How fast depends on the machine: figures are reported, measured in docs/viewer.md."""
    shown = scene("sim1", MANY)
    assert len(shown.frames[5].packets) == 16 * 15
    seen = page_of(shown)
    seen.do("play()").until("encircle.stats().frames > 60")
    stats = seen.page.evaluate("encircle.stats()")
    assert stats["packets_max"] >= 16 * 15
    for name, value in stats.items():
        record_property(name, value)
    print(stats)
