"""Scenarios: those that are shipped, overrides, files that are none, and what follows."""

import json
from contextlib import suppress
from math import dist, pi, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.world.loading.files import shipped
from encircle.world.loading.load import load
from encircle.world.scenario.errors import ScenarioError

FOUR = {"team": {"robots": 4}}
FULL = {
    "team": {"positions": [[4.0, 0.0], [0.0, 4.0]]},
    "obstacles": [{"position": [9.0, 9.0], "radius_m": 1.0}],
    "events": [
        {"kind": "move-target", "tick": 3, "position": [1.0, 1.0]},
        {"kind": "silence", "tick": 3, "ticks": 2, "robot": "r1"},
        {"kind": "outage", "tick": 3, "ticks": 2, "sender": "r1"},
        {"kind": "partition", "tick": 3, "ticks": 2, "groups": [["r1"], ["r2"]]},
    ],
    "channel": {
        "links": [{"sender": "r1", "loss": {"model": "bernoulli", "rate": 0.5}}],
        "loss": {"model": "trace", "values": [0, 1], "mode": "shifted"},
        "delay": {"model": "trace", "values": [0.5, None]},
        "duplication": {"rate": 0.1},
        "rate_limit": {"packets_per_s": 3.5},
    },
}


def refusal(*overrides, tree=FOUR):
    with pytest.raises(ScenarioError) as caught:
        load(tree, overrides)
    return str(caught.value)


def test_the_papers_five_simulations_are_shipped():
    assert {"sim1", "sim2", "sim3", "sim4", "sim5"} <= set(shipped())


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_scenario_loads_by_name_and_by_path_with_the_papers_bodies(name):
    scenario = load(name)
    assert scenario == load(shipped()[name]) == load(str(shipped()[name]))
    assert scenario.title
    team = scenario.team
    assert (team.radius_m, team.step_m_max, team.sensing_range_m) == (0.5, 0.3, 6.0)
    assert scenario.capture.stop_distance_m == 1.3


@pytest.mark.parametrize("name", ["sim1", "sim3", "sim4", "sim5"])
def test_four_robots_of_which_only_r1_detects_the_target_at_the_start(name):
    scenario = load(name)
    ranges = [dist(p, scenario.target.position) for p in scenario.team.positions]
    assert [r <= 6.0 for r in ranges] == [True, False, False, False]


def test_the_simulations_differ_as_the_paper_says():
    assert len(load("sim2").ids) == 3
    assert load("sim2").obstacles
    assert [e.kind for e in load("sim3").events] == ["move-target"]
    assert load("sim4").target.step_m_max == pytest.approx(1.3 * load("sim4").team.step_m_max)
    one, five = load("sim1").team.positions, load("sim5").team.positions
    assert [a == b for a, b in zip(one, five, strict=True)] == [True, True, False, True]


def test_overrides_reach_nested_keys_and_create_tables():
    scenario = load("sim1", ["target.step_m_max=0.39", "robot.ring_radius_m=5", "seed=42"])
    assert scenario.target.step_m_max == 0.39
    assert scenario.parameters["ring_radius_m"] == 5
    assert scenario.seed == 42
    assert scenario.target.behaviour == "flee"


def test_overrides_reach_list_items_by_number():
    changes = ["obstacles.0.radius_m=2.5", "team.positions.1.0=7.0", "events.1.robot=r2"]
    scenario = load(FULL, changes)
    assert scenario.obstacles[0].radius_m == 2.5
    assert scenario.team.positions == ((4.0, 0.0), (7.0, 4.0))
    assert scenario.events[1].robot == "r2"


@pytest.mark.parametrize(
    ("override", "value"),
    [
        ("title='quoted = text'", "quoted = text"),
        ("title=plain text, with = in it", "plain text, with = in it"),
        ("title=", ""),
        ('title="tab\\t"', "tab\t"),
        ("title=sim-9", "sim-9"),
    ],
)
def test_an_override_is_toml_or_else_plain_text(override, value):
    assert load(FOUR, [override]).title == value


def test_overrides_take_tables_and_lists_and_the_last_one_counts():
    scenario = load(
        FOUR,
        [
            "channel.loss={model='bernoulli', rate=0.1}",
            "channel.loss.rate=0.2",
            "channel.loss.rate=0.3",
            "robot.xi_grid=[0.0, 0.5]",
        ],
    )
    assert (scenario.channel.loss.model, scenario.channel.loss.rate) == ("bernoulli", 0.3)
    assert scenario.parameters["xi_grid"] == [0.0, 0.5]


@pytest.mark.parametrize(
    "override", ["", "seed", "=3", "obstacles.7.radius_m=1", "obstacles.first.radius_m=1"]
)
def test_a_bad_override_is_refused_and_shown(override):
    assert repr(override) in refusal(override, tree=FULL)


def test_an_override_below_a_plain_value_is_refused():
    assert "team.strategy.name=x" in refusal("team.strategy=pursuit", "team.strategy.name=x")


def test_a_given_mapping_is_not_changed_by_overrides():
    before = json.dumps(FULL)
    load(FULL, ["obstacles.0.radius_m=2.5", "team.positions.1.0=7.0", "robot.xi_weight=1"])
    assert json.dumps(FULL) == before


@settings(deadline=None, derandomize=True, max_examples=100)
@given(text=st.text(max_size=20) | st.from_regex(r"(team|seed|title)[.=\w]{0,9}", fullmatch=True))
def test_any_override_is_taken_or_refused(text):
    with suppress(ScenarioError):
        assert load(FOUR, [text]).ids


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"[team\nrobots = 4", "line 1"),
        (b"[team]\nrobots = 4\nrobots = 5\n", "line 3"),
        (b"title = 'caf\xe9'\n[team]\nrobots = 4\n", "utf-8"),
        (b"\x00\x01\x02", "parsed"),
        (b"", "team"),
    ],
)
def test_a_file_that_is_no_toml_is_refused_with_its_name(tmp_path, content, said):
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    message = refusal(tree=path)
    assert "broken.toml" in message
    assert said in message


@pytest.mark.parametrize("name", ["no-such-scenario", "folder", "", "nul\0byte"])
def test_a_missing_file_or_a_directory_is_refused(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    message = refusal(tree=name)
    assert repr(name) in message
    if "\0" not in name:
        assert all(known in message for known in shipped())


def test_a_scenario_survives_being_written_out_and_read_back(tmp_path):
    scenario = load(FULL, ["robot.xi_grid=[0.0, 2.0]", "seed=9"])
    for unset in (True, False):
        path = tmp_path / f"written-{unset}.json"
        path.write_text(scenario.model_dump_json(exclude_unset=unset), encoding="utf-8")
        assert load(path) == scenario


@pytest.mark.parametrize("stop", [1.0, 1.3, 1.7, 3.0, 8.0])
@pytest.mark.parametrize("radius", [0.2, 0.5])
def test_all_robots_capture_up_to_what_fits_around_the_target(stop, radius):
    # Neighbours n to the circle are 2 D sin(pi / n) apart; a body and a half is 3 r.
    fits = max(n for n in range(2, 300) if 2 * stop * sin(pi / n) >= 3 * radius - 1e-12)
    base = [f"capture.stop_distance_m={stop}", f"team.radius_m={radius}"]
    for robots in (2, 5, 60):
        scenario = load(FOUR, [*base, f"team.robots={robots}"])
        assert scenario.capture_count == min(robots, fits)
    assert load(FOUR, [*base, "capture.count=3"]).capture_count == 3


def test_robots_are_told_what_bodies_they_have():
    changes = ["team.radius_m=0.4", "target.radius_m=0.6", "team.step_m_max=0.2"]
    changes += ["team.sensing_range_m=7.0", "capture.stop_distance_m=1.5", "robot.xi_weight=0.1"]
    scenario = load(FOUR, changes)
    assert scenario.parameters == {
        "radius_m": 0.4,
        "target_radius_m": 0.6,
        "step_m_max": 0.2,
        "sensing_range_m": 7.0,
        "stop_distance_m": 1.5,
        "xi_weight": 0.1,
    }
    assert scenario.ids == ("r1", "r2", "r3", "r4")
