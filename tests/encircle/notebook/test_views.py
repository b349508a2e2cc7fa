"""Hunts, scenarios and studies as HTML: well formed, escaped, and drawn to scale."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

import encircle
from encircle.notebook.hunt_view import NOT_KNOWN, positions_of, trails_svg
from encircle.runlog.ground_truth import ground_truth_of
from encircle.world.recording.recording import read_recording

SVG = "{http://www.w3.org/2000/svg}"
EVIL = '<script>alert("x")</script> & more'
LOSSY = ['channel.loss={model="bernoulli", rate=0.5}', "ticks_max=20"]


def parsed(html):
    """The HTML as a tree: it is well formed, so that no text can end an element."""
    return ElementTree.fromstring(html)


def words_of(tree):
    return " ".join(" ".join(tree.itertext()).split())


@pytest.fixture(scope="module")
def hunt():
    return encircle.run("sim1", link="memory", overrides=LOSSY)


def test_a_hunt_says_what_came_of_it(hunt):
    tree = parsed(hunt._repr_html_())
    words = words_of(tree)
    assert "Simulation 1: four robots" in words
    assert "loss 50 % (bernoulli); no delay" in words
    lost = hunt.result.packets_lost["loss"]
    assert f"{hunt.result.packets_sent} sent, {lost} lost ({lost} by loss)" in words
    assert hunt.digest in words
    assert f"r3 {hunt.result.distances_m[2]:.2f} m" in words


def test_trails_are_drawn_to_the_scale_of_the_bar(hunt):
    """Positions are those of the run; pixels per metre are read off the drawing's own bar."""
    tree = parsed(trails_svg(hunt.scenario, hunt.positions))
    [bar] = [e for e in tree.iter(f"{SVG}path") if "v8M8" in e.get("d", "")]
    end = float(re.search(r"H([\d.]+)m0", bar.get("d"))[1])
    length_m = float(next(t.text for t in tree.iter(f"{SVG}text") if t.text.endswith(" m"))[:-2])
    pixels_per_m = (end - 8.0) / length_m
    trails = [
        np.array([point.split(",") for point in line.get("points").split()], float)
        for line in tree.iter(f"{SVG}polyline")
    ]
    assert len(trails) == 5
    for body, trail in enumerate(trails):
        moved_m = hunt.positions[:, body] - hunt.positions[0, body]
        drawn_m = (trail - trail[0]) * (1.0, -1.0) / pixels_per_m
        np.testing.assert_allclose(drawn_m, moved_m, atol=0.01)
    between_m = hunt.positions[0, 2] - hunt.positions[0, 0]
    drawn_m = (trails[2][0] - trails[0][0]) * (1.0, -1.0) / pixels_per_m
    np.testing.assert_allclose(drawn_m, between_m, atol=0.01)
    width, height = (float(tree.get(side)) for side in ("width", "height"))
    assert all((trail >= 0).all() and (trail <= (width, height)).all() for trail in trails)


def test_no_trail_leads_to_where_the_target_was_moved_by_whomever():
    event = {"kind": "move-target", "tick": 12, "position": [15.0, 15.0]}
    changes = ["team.strategy='pursuit'", "ticks_max=30"]
    by_hand = encircle.Interventions()
    by_hand.give(event)
    moved = [
        encircle.run("sim1", link="memory", overrides=changes, interventions=by_hand),
        encircle.run(
            "sim1",
            link="memory",
            overrides=[*changes, "events=[{kind='move-target', tick=12, position=[15.0, 15.0]}]"],
        ),
    ]
    drawings = [trails_svg(hunt.scenario, hunt.positions) for hunt in moved]
    assert drawings[0] == drawings[1]
    assert drawings[0].count("<polyline") == 4 + 2


def test_positions_of_a_hunt_in_memory_are_those_that_it_records(tmp_path):
    hunt = encircle.run("sim2", link="memory", overrides=LOSSY, out=tmp_path / "run")
    truth = ground_truth_of(read_recording(tmp_path / "run")).positions
    np.testing.assert_array_equal(hunt.positions, truth)
    assert hunt.positions.shape == (21, 4, 2)


def test_of_a_hunt_whose_positions_are_not_known_the_recording_tells(tmp_path):
    hunt = encircle.run("sim1", link="memory", overrides=LOSSY, out=tmp_path / "run")
    unknown = replace(hunt, positions=None)
    np.testing.assert_array_equal(positions_of(unknown), hunt.positions)
    (tmp_path / "run" / "recording.mcap").unlink()
    assert NOT_KNOWN in words_of(parsed(unknown._repr_html_()))


def test_a_long_trail_has_few_points_and_its_true_ends(hunt):
    steps = np.random.default_rng(1).uniform(-0.1, 0.1, (5000, 5, 2))
    tree = parsed(trails_svg(hunt.scenario, np.cumsum(steps, axis=0)))
    counts = [len(line.get("points").split()) for line in tree.iter(f"{SVG}polyline")]
    assert max(counts) <= 401


def test_a_target_that_is_moved_by_hand_has_two_trails():
    hunt = encircle.run("sim3", link="memory", overrides=["ticks_max=60"])
    tree = parsed(trails_svg(hunt.scenario, hunt.positions))
    own = [line for line in tree.iter(f"{SVG}polyline") if line.get("stroke") == "currentColor"]
    assert len(own) == 1 + len(hunt.scenario.events)


@pytest.mark.parametrize("name", ["sim1", "sim2", "sim3", "sim4", "sim5"])
def test_a_scenario_shows_itself(name):
    scenario = encircle.load(name)
    tree = parsed(scenario._repr_html_())
    assert scenario.title in words_of(tree)
    discs = [c for c in tree.iter(f"{SVG}circle") if c.get("fill", "").startswith("#")]
    assert len(discs) == len(scenario.ids)
    names = [t.text for t in tree.iter(f"{SVG}text")]
    assert set(scenario.ids) <= set(names)


def test_every_text_is_escaped(tmp_path):
    changes = [f"title='{EVIL}'", f"description='{EVIL}'", "ticks_max=2"]
    scenario = encircle.load("sim1", changes)
    hunt = encircle.run(scenario, link="memory", out=tmp_path / "a<b>&")
    study = encircle.study(
        {"scenario": "sim1", "title": EVIL, "seeds": 1, "name": "x"}, out=tmp_path / "<i>"
    )
    for thing in (scenario, hunt, study):
        html = thing._repr_html_()
        assert "<script" not in html
        assert EVIL in words_of(parsed(html))


def test_a_mixed_team_and_a_busy_scenario_are_told():
    scenario = encircle.load(
        {
            "team": {"robots": {"r1": {"strategy": "pursuit"}, "count": 3}},
            "sensing": {"noise_m_std": 0.1},
            "events": [
                {"kind": "silence", "tick": tick, "ticks": 2, "robot": "r2"}
                for tick in range(1, 40, 4)
            ],
        }
    )
    words = words_of(parsed(scenario._repr_html_()))
    assert "3 robots, 1 pursuit, 2 xi-star" in words
    assert "and 2 more events" in words
    assert "0.1 m per axis" in words


def test_sixteen_robots_have_their_names():
    scenario = encircle.load({"team": {"robots": 16}})
    tree = parsed(scenario._repr_html_())
    assert {f"r{k + 1}" for k in range(16)} <= {t.text for t in tree.iter(f"{SVG}text")}
