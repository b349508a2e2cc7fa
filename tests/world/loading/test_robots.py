"""Mixed teams in a scenario: what may be said of one robot, how, and what is refused."""

import pytest

from encircle.world.loading.load import load
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import digest_header
from encircle.world.scenario.robots_table import RobotOverride, RobotsTable

NUMBER = {"team": {"robots": 4}}
TABLE = {"team": {"robots": {"count": 4}}}
PLACES = {"team": {"positions": [[5.0, 0.0], [0.0, 5.0], [-5.0, 0.0], [0.0, -5.0]]}}
WRITTEN_OUT = {"team": {"robots": None, "positions": PLACES["team"]["positions"]}}
SLOW = "team.robots.r3.step_m_max=0.15"


def steps(scenario):
    return [scenario.parameters_of(robot)["step_m_max"] for robot in scenario.ids]


def refusal(*overrides, tree=NUMBER):
    with pytest.raises(ScenarioError) as caught:
        load(tree, overrides)
    return str(caught.value).splitlines()[1:]


@pytest.mark.parametrize("tree", [NUMBER, TABLE, PLACES, WRITTEN_OUT, "sim1"])
def test_one_robot_can_be_overridden_however_the_team_is_given(tree):
    scenario = load(tree, [SLOW])
    assert scenario.ids == ("r1", "r2", "r3", "r4")
    assert steps(scenario) == [0.3, 0.3, 0.15, 0.3]
    assert load(scenario.model_dump(mode="json")) == scenario
    assert load(scenario.model_dump(mode="json", exclude_defaults=True)) == scenario


def test_a_number_and_a_table_with_nothing_else_are_the_same_scenario():
    plain = load(NUMBER)
    assert plain.team.robots == 4
    for tree in (TABLE, {"team": {"robots": {"count": 4, "r2": {}, "r3": {"loss_rate": 0.0}}}}):
        assert load(tree) == plain
        assert digest_header(load(tree), 1) == digest_header(plain, 1)
    assert digest_header(load(PLACES, ["team.robots.r1={}"]), 1) == digest_header(load(PLACES), 1)


def test_what_is_overridden_is_in_the_digest_header_and_nothing_else():
    header = digest_header(load(NUMBER, [SLOW]), 1)
    assert '"team": {"robots": {"count": 4, "r3": {"step_m_max": 0.15}}}' in header


def test_a_number_set_over_a_table_is_its_count_in_either_order():
    six = [0.3, 0.3, 0.15, 0.3, 0.3, 0.3]
    assert steps(load(NUMBER, [SLOW, "team.robots=6"])) == six
    assert steps(load(NUMBER, ["team.robots=6", SLOW])) == six
    assert load(NUMBER, [SLOW, "team.robots={count=4}"]) == load(NUMBER)


def test_every_key_of_one_robot_counts_for_that_one_alone():
    scenario = load(
        NUMBER,
        [
            "team.robots.r2={strategy='pursuit', step_m_max=0.1, sensing_range_m=2.0}",
            "team.robots.r2.radio_range_m=3",
            "team.robots.r2.loss_rate=0.5",
        ],
    )
    assert scenario.team.robots == RobotsTable(
        count=4,
        r2=RobotOverride(
            strategy="pursuit",
            step_m_max=0.1,
            sensing_range_m=2.0,
            radio_range_m=3.0,
            loss_rate=0.5,
        ),
    )
    assert [scenario.strategy_of(r) for r in scenario.ids] == [
        *("xi-star", "pursuit", "xi-star", "xi-star")
    ]
    assert scenario.parameters_of("r2") == {
        **scenario.parameters,
        "step_m_max": 0.1,
        "sensing_range_m": 2.0,
    }
    assert scenario.parameters_of("r1") == scenario.parameters


def parameters(*overrides):
    """What r1, r2 and r3 are given of {a: 1, b: 2}; whether there are such is not checked here."""
    scenario = load(NUMBER, ["team.robots.r1.step_m_max=0.1", *overrides])
    team = scenario.team.model_copy(update={"policy_parameters": {"a": 1, "b": 2}})
    changed = scenario.model_copy(update={"team": team})
    return [changed.policy_parameters_of(robot) for robot in ("r1", "r2", "r3")]


def test_policies_get_the_teams_parameters_unless_theirs_is_another_policy():
    both = {"a": 1, "b": 2}
    assert parameters() == [both, both, both]
    assert parameters("team.robots.r2.strategy=pursuit") == [both, {}, both]
    assert parameters("team.robots.r2.strategy=xi-star") == [both, both, both]


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        (["team.robots.r5.step_m_max=1"], "team.robots.r5 = {'step_m_max': 1}: robots are r1 to"),
        (["team.robots.r0.step_m_max=1"], "team.robots.r0 = {'step_m_max': 1}: robots are r1 to"),
        (["team.robots.cuont=3"], "team.robots.cuont = 3: robots are r1 to r4 (did you mean 'c"),
        (["team.robots.step_m_max=1"], "team.robots.step_m_max = 1: robots are r1 to r4"),
        (
            ["team.robots.r1=0.2"],
            "team.robots.r1 = 0.2: must be a table, as in team.robots.r1 = {...}, or set one",
        ),
        (["team.robots.r1.step_max=1"], "team.robots.r1.step_max = 1: unknown key (did you mean '"),
        (["team.robots.r1.step_m_max=0"], "team.robots.r1.step_m_max = 0: must be above 0"),
        (["team.robots.r1.step_m_max=5e3"], "team.robots.r1.step_m_max = 5000.0: must be from"),
        (["team.robots.r1.sensing_range_m='far'"], "team.robots.r1.sensing_range_m = 'far': must"),
        (["team.robots.r1.radio_range_m=-1"], "team.robots.r1.radio_range_m = -1: must be above"),
        (["team.robots.r1.loss_rate=1.5"], "team.robots.r1.loss_rate = 1.5: must be at most 1"),
        (["team.robots.r1.strategy=xi-9"], "team.robots.r1.strategy = 'xi-9': unknown policy"),
        (["team.robots.count=257"], "team.robots.count = 257: must be at most 256"),
        (["team.robots.r1.step_m_max.x=1"], "team.robots.r1.step_m_max.x=1': there is no such"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(overrides, expected):
    lines = refusal("team.robots.r1.step_m_max=0.2", *overrides)
    assert len(lines) == 1
    assert expected in lines[0]


def test_more_problems_are_listed_together():
    lines = refusal(
        "team.robots.r7.step_m_max=1",
        "team.robots.r2.loss_rate=-1",
        "team.robots.r3.strategy=none",
        "tick_s=0",
    )
    assert len(lines) == 4


def test_a_problem_of_the_teams_policy_is_told_once():
    own = "team.robots.r2.policy_parameters={a=1}"
    (line,) = refusal("team.strategy=xi-9", own, SLOW)
    assert line.startswith("  team.strategy = 'xi-9': unknown policy")
    (line,) = refusal(own, SLOW)
    assert line.startswith("  team.robots.r2.policy_parameters.a = 1: ")


def test_a_count_beside_positions_must_be_theirs():
    (line,) = refusal("team.robots.count=3", SLOW, tree=PLACES)
    assert line == (
        "  team.robots.count = 3: but 4 positions are given; give 3, or leave team.positions out to"
        " have robots placed at random (team.placement)"
    )


def test_a_team_of_no_size_is_refused_for_that_alone():
    (line,) = refusal(SLOW, tree={"team": {}})
    assert line == "  team: give either robots (a number) or positions"
