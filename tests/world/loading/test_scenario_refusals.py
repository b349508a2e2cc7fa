"""Scenarios that are refused: every problem is named with its key and value, all at once."""

from contextlib import suppress
from dataclasses import fields

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.parameters import Parameters
from encircle.world.loading.load import load
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario

FOUR = {"team": {"robots": 4}}
FULL = {
    "team": {"positions": [[4.0, 0.0], [0.0, 4.0]]},
    "obstacles": [{"position": [9.0, 9.0], "radius_m": 1.0}],
    "events": [
        {"kind": "move-target", "tick": 3, "position": [1.0, 1.0]},
        {"kind": "silence", "tick": 3, "ticks": 2, "robot": "r1"},
        {"kind": "outage", "tick": 3, "ticks": 2},
        {"kind": "partition", "tick": 3, "ticks": 2, "groups": [["r1"], ["r2"]]},
    ],
    "channel": {"links": [{"sender": "r1", "loss": {"model": "bernoulli", "rate": 0.5}}]},
}


def refusal(*overrides, tree=FOUR):
    with pytest.raises(ScenarioError) as caught:
        load(tree, overrides)
    return str(caught.value)


OUT_OF_RANGE = [
    ("seed", "-1"),
    ("seed", "9223372036854775808"),
    ("seed", "1.5"),
    ("tick_s", "0.0"),
    ("tick_s", "61.0"),
    ("tick_s", "nan"),
    ("ticks_max", "0"),
    ("ticks_max", "1000001"),
    ("title", "5"),
    ("team.robots", "0"),
    ("team.robots", "257"),
    ("team.radius_m", "0.0"),
    ("team.radius_m", "inf"),
    ("team.radius_m", "'wide'"),
    ("team.step_m_max", "-0.3"),
    ("team.sensing_range_m", "nan"),
    ("team.motion", "'sideways'"),
    ("team.turn_rad_max", "0.0"),
    ("team.turn_rad_max", "3.2"),
    ("team.placement.distance_m_min", "0"),
    ("target.heading_rad", "nan"),
    ("target.heading_rad", "6.3"),
    ("target.step_m_max", "-1"),
    ("target.radius_m", "0.0"),
    ("sensing.noise_m_std", "-0.1"),
    ("sensing.noise_m_std", "nan"),
    ("sensing.rays", "7"),
    ("sensing.rays", "361"),
    ("channel.loss.model", "'sometimes'"),
    ("channel.loss.rate", "1.1"),
    ("channel.loss.rate", "nan"),
    ("channel.loss.good_to_bad", "-0.1"),
    ("channel.delay.model", "'late'"),
    ("channel.delay.mean_s", "-0.1"),
    ("channel.delay.mean_s", "601"),
    ("channel.delay.std_s", "inf"),
    ("channel.order", "'lost'"),
    ("capture.count", "1"),
    ("capture.stop_distance_m", "-1.3"),
]


@pytest.mark.parametrize(("key", "text"), OUT_OF_RANGE)
def test_a_value_out_of_range_is_refused_with_its_key_and_value(key, text):
    said = refusal(f"{key}={text}")
    assert "one problem" in said
    assert f"\n  {key} = {text}" in said


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("obstacles.0.radius_m", "-2"),
        ("obstacles.0.position.1", "nan"),
        ("team.positions.1.0", "100001"),
        ("events.0.tick", "0"),
        ("events.1.ticks", "0"),
        ("events.2.ticks", "0"),
        ("events.3.tick", "-1"),
        ("channel.links.0.loss.rate", "-0.25"),
    ],
)
def test_a_bad_value_in_a_list_is_named_by_its_place(key, text):
    assert f"\n  {key} = {text}" in refusal(f"{key}={text}", tree=FULL)


@pytest.mark.parametrize(
    "table",
    [
        "",
        "team.",
        "team.placement.",
        "target.",
        "sensing.",
        "capture.",
        "channel.",
        "channel.loss.",
        "channel.delay.",
        "channel.links.0.",
        "channel.links.0.loss.",
        "obstacles.0.",
        "events.0.",
        "events.1.",
        "events.2.",
        "events.3.",
    ],
)
def test_an_unknown_key_is_refused_with_its_value(table):
    assert f"\n  {table}colour = 987: unknown key" in refusal(f"{table}colour=987", tree=FULL)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            "channel.loss=0.6",
            "must be a table, as in channel.loss = {...}, or set one of its keys, such as"
            " channel.loss.model, channel.loss.rate or channel.loss.good_to_bad",
        ),
        ("team.policy_parameters=3", "must be a table, as in team.policy_parameters = {...}"),
        ("obstacles.0=3", "must be a table with keys such as position or radius_m"),
    ],
)
def test_what_must_be_a_table_is_told_how_it_is_written(change, said):
    key, _, value = change.partition("=")
    assert f"\n  {key} = {value}: {said}\n" in refusal(change, tree=FULL) + "\n"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("target.parameters.range=3", "unknown key; known are: obstacle_range_m"),
        ("target.parameters.obstacle=3", "unknown key (did you mean 'obstacle_range_m'?); known"),
        ("team.policy_parameters.lead=3", "unknown key; there are none (team.strategy = "),
    ],
)
def test_an_unknown_own_parameter_is_told_which_there_are(change, said):
    key, _, value = change.partition("=")
    assert f"\n  {key} = {value}: {said}" in refusal(change)


@pytest.mark.parametrize(
    "wrong",
    [
        {"ticks_max": -1},
        {"events": [{"kind": "silence", "robot": "r9", "tick": -1, "ticks": 2}]},
        {"events": [{"kind": "silence", "robot": "r9", "tick": 1, "ticks": 2, "colour": 1}]},
        {"events": [{"kind": "outage", "sender": "r9", "tick": 1, "ticks": 2}, {"kind": "x"}]},
    ],
)
def test_an_unknown_robot_of_an_event_is_listed_with_all_else(wrong):
    event = {"kind": "silence", "robot": "r9", "tick": 1, "ticks": 2}
    said = refusal(tree={"team": {"robots": 4}, "events": [event], **wrong})
    assert "2 problems" in said
    assert "= 'r9': robots are r1, r2, r3, r4" in said


@pytest.mark.parametrize("table", ["robot.", "target.parameters."])
def test_an_unknown_parameter_of_robot_or_behaviour_is_refused_with_its_value(table):
    said = refusal(f"{table}colour=987")
    assert "colour" in said
    assert "987" in said


@pytest.mark.parametrize("name", [f.name for f in fields(Parameters) if f.name != "xi_grid"])
@pytest.mark.parametrize("text", ["nan", "inf", "-5000.5", "[2]"])
def test_a_senseless_robot_parameter_is_refused_with_its_key_and_value(name, text):
    assert f"robot.{name} = {text}" in refusal(f"robot.{name}={text}")


@pytest.mark.parametrize("text", ["[]", "[1.0, 0.0]", "[-1.0]", "7", "[nan]", "[0.0, inf]", "'12'"])
def test_a_grid_of_prediction_steps_must_be_finite_ascending_numbers(text):
    assert "xi_grid" in refusal(f"robot.xi_grid={text}")


CONTRADICTIONS = [
    (["team.positions=[[3.0, 3.0]]"], ["team.robots = 4", "1 positions"]),
    (["team.positions=[]"], ["team.positions", "0 given"]),
    (["team.placement.distance_m_min=11.0"], ["team.placement.distance_m_min = 11.0", "10.0"]),
    (["capture.stop_distance_m=0.99"], ["capture.stop_distance_m = 0.99", "1.0"]),
    (["capture.count=5"], ["capture.count = 5", "4 robots"]),
    (["team.strategy=xi-9"], ["team.strategy = 'xi-9'", "xi-star", "pursuit"]),
    (["target.behaviour=sulk"], ["target.behaviour = 'sulk'", "flee", "patrol"]),
    (["target.behaviour=patrol"], ["target.behaviour = 'patrol'", "waypoints"]),
    (["target.behaviour=still", "target.parameters.speed=1"], ["'still'", "speed"]),
    (["robot.radius_m=0.4"], ["robot.radius_m = 0.4", "team"]),
    (["robot.search=dance"], ["robot.search = 'dance'", "spiral"]),
    (["robot.spline_samples=20"], ["robot.spline_samples = 20", "window_ticks"]),
    (["channel.loss.rate=0.5"], ["channel.loss.rate = 0.5", "none"]),
    (["channel.delay.std_s=0.2"], ["channel.delay.std_s = 0.2", "constant"]),
    (["channel.delay.model=gamma", "channel.delay.mean_s=1"], ["channel.delay", "std_s"]),
    (["channel.delay.model=lognormal", "channel.delay.std_s=1"], ["channel.delay", "mean_s"]),
    (
        ["channel.delay.model=uniform", "channel.delay.low_s=0.3", "channel.delay.high_s=0.2"],
        ["channel.delay.low_s = 0.3", "0.2"],
    ),
    (["channel.links=[{sender='r5'}]"], ["channel.links.0.sender = 'r5'", "r1, r2, r3, r4"]),
    (["channel.links=[{receiver='q'}]"], ["channel.links.0.receiver = 'q'"]),
    (
        ["channel.links=[{delay={low_s=1}}]"],
        ["channel.links.0.delay.low_s = 1:", "'constant'", "'uniform'"],
    ),
    (
        ["events=[{kind='silence',tick=1,ticks=1,robot='r7'}]"],
        ["events.0.robot = 'r7'", "r1, r2, r3, r4"],
    ),
    (["events=[{kind='storm'}]"], ["events.0", "storm", "silence"]),
    (["events=[{tick=1}]"], ["events.0", "kind"]),
    (["obstacles=[{position=[1,0],radius_m=0.5}]"], ["target.position", "obstacles.0.position"]),
]


@pytest.mark.parametrize(("overrides", "parts"), CONTRADICTIONS)
def test_a_contradiction_is_refused_and_named(overrides, parts):
    said = refusal(*overrides)
    assert all(part in said for part in parts), said


def test_robots_that_overlap_each_other_the_target_or_an_obstacle_are_refused_one_by_one():
    tree = {
        "team": {"positions": [[0.9, 0.0], [5.0, 0.0], [5.5, 0.5]]},
        "obstacles": [{"position": [0.9, 1.2], "radius_m": 0.7}],
    }
    said = refusal(tree=tree).splitlines()
    assert "3 problems" in said[0]
    for line, places in zip(
        said[1:],
        [
            ("team.positions.0 = (0.9, 0.0)", "target.position = (0.0, 0.0)"),
            ("team.positions.0 = (0.9, 0.0)", "obstacles.0.position = (0.9, 1.2)"),
            ("team.positions.2 = (5.5, 0.5)", "team.positions.1 = (5.0, 0.0)"),
        ],
        strict=True,
    ):
        assert "overlaps" in line
        assert all(place in line for place in places)


def test_bodies_that_touch_are_refused_and_bodies_a_little_apart_are_not():
    assert "overlaps" in refusal(tree={"team": {"positions": [[1.0, 0.0]]}})
    assert load({"team": {"positions": [[1.001, 0.0]]}}).ids == ("r1",)


def test_a_scenario_without_a_team_or_with_an_unsized_one_is_refused():
    assert "team" in refusal(tree={})
    assert "team: give either robots (a number) or positions" in refusal(tree={"team": {}})


def test_all_bad_values_are_reported_at_once():
    changes = ["tick_s=-1.0", "team.radius_m=0", "colour=1", "channel.loss.rate=2.0"]
    said = refusal(*changes)
    assert "4 problems" in said
    assert all(f"  {key} = " in said for key in (c.partition("=")[0] for c in changes))


def test_all_contradictions_are_reported_at_once():
    said = refusal(
        "capture.count=9",
        "team.strategy=none",
        "target.behaviour=none",
        "robot.xi_weight=-1",
        "robot.near_factor=-1",
        "channel.loss.rate=0.5",
        "channel.delay.high_s=1.0",
        "channel.links=[{sender='r8',receiver='r9'}]",
    )
    assert "9 problems" in said
    keys = ("capture.count", "team.strategy", "target.behaviour", "robot.xi_weight")
    keys += ("robot.near_factor", "channel.loss.rate", "channel.delay.high_s")
    keys += ("channel.links.0.sender", "channel.links.0.receiver")
    assert all(f"  {key} = " in said for key in keys), said


@pytest.mark.parametrize(
    ("behaviour", "parameters"),
    [
        ("patrol", "{waypoints=[]}"),
        ("patrol", "{waypoints=[[1.0]]}"),
        ("patrol", "{waypoints=[['a', 'b']]}"),
        ("patrol", "{waypoints=7}"),
        ("flee", "{obstacle_range_m='near'}"),
        ("gap", "{obstacle_range_m=[1.0]}"),
    ],
)
def test_a_behaviours_parameter_of_a_senseless_value_is_refused_before_the_run(
    behaviour, parameters
):
    said = refusal(f"target.behaviour={behaviour}", f"target.parameters={parameters}")
    assert parameters[1:].partition("=")[0] in said


KEYS = ["kind", "tick", "robot", "position", "radius_m", "model", "loss", "delay", "file"]
KEYS += ["values", "links", "sender", "rate", "groups", "mean_s"]
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats()
    | st.sampled_from(
        ["r1", "flee", "patrol", "gamma", "uniform", "silence", "trace", "outage", "", "x" * 99]
    ),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(KEYS),
            inner,
            max_size=3,
        )
    ),
    max_leaves=5,
)
TEAM = ["robots", "positions", "placement", "radius_m", "strategy", "motion", "jitter_m"]
TABLES = {
    "target": ["position", "behaviour", "parameters", "heading_rad"],
    "robot": ["xi_grid", "spline_samples", "search", "window_ticks", "clearance_m"],
    "channel": ["loss", "delay", "links", "order", "duplication", "rate_limit"],
    "capture": ["count", "stop_distance_m"],
}


@settings(deadline=None, derandomize=True, max_examples=300)
@given(
    tree=st.fixed_dictionaries(
        {"team": st.just({"robots": 3}) | st.dictionaries(st.sampled_from(TEAM), VALUES)},
        optional={
            **{name: st.dictionaries(st.sampled_from(k), VALUES) for name, k in TABLES.items()},
            **dict.fromkeys(["seed", "tick_s", "obstacles", "events", "sensing", "zz"], VALUES),
        },
    )
)
def test_whatever_the_values_loading_succeeds_or_says_what_is_wrong(tree):
    with suppress(ScenarioError):
        assert isinstance(load(tree), Scenario)


def test_a_study_is_told_from_a_scenario(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('scenario = "sim1"\naxes = []\n')
    with pytest.raises(ScenarioError, match=r"is a study: encircle study .*mine\.toml"):
        load(path)


@pytest.mark.parametrize(
    ("changes", "keys"),
    [
        (("events.1.ticks=-1", 'events.10.robot="r9"'), ("events.1.ticks", "events.10.robot")),
        (("robot=5", "capture.count=9"), ("robot", "capture.count")),
    ],
)
def test_a_refused_value_hides_no_contradiction_whose_key_only_looks_like_its_own(changes, keys):
    crashes = [{"kind": "crash", "robot": "r1", "tick": 5 + k, "ticks": 1} for k in range(12)]
    with pytest.raises(ScenarioError) as refused:
        load({"team": {"robots": 4}, "events": crashes}, changes)
    lines = str(refused.value).splitlines()[1:]
    assert [line.split(" = ")[0].strip() for line in lines] == list(keys)


@pytest.mark.parametrize("gain", [float("nan"), float("inf"), 1e300, 2**60, 2**70, [{"a": 1e10}]])
def test_what_robots_would_not_take_of_a_policys_own_parameters_is_refused_before(
    gain, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "any.py").write_text("def policy(memory, view, *, gain=None):\n    return memory\n")
    team = {"robots": 3, "strategy": "any.py:policy", "policy_parameters": {"gain": gain}}
    with pytest.raises(ScenarioError, match=r"team.policy_parameters = .*: must be .*number") as no:
        load({"team": team})
    assert len(str(no.value).splitlines()) == 2
