from pathlib import Path

import numpy as np
import pytest

from encircle.measures.registry import MEASURES
from encircle.studies.plan import StudyError, toml_text
from encircle.studies.plan_files import load_plan, shipped_studies
from encircle.world.loading.load import load

LOSS = {"name": "loss", "key": "channel.loss.rate", "values": [0.0, 0.5]}
TREE = {
    "name": "tested",
    "scenario": "sim1",
    "seeds": 3,
    "set": {"channel.loss.model": "bernoulli"},
    "axes": [LOSS],
}


def plan(**changes):
    return load_plan({**TREE, **changes})


def refusal(**changes):
    with pytest.raises(StudyError) as caught:
        plan(**changes)
    return str(caught.value)


@pytest.mark.parametrize("name", sorted(shipped_studies()))
def test_every_shipped_study_can_be_run(name):
    loaded = load_plan(name)
    assert loaded.name == name
    assert loaded.title
    assert loaded.question.endswith("?")
    assert loaded.runs == len(loaded.cells) * len(loaded.seed_list)


def test_the_shipped_studies_are_those_that_the_readme_names():
    assert set(shipped_studies()) == {
        *("loss", "delay", "loss-delay", "burst", "range", "staleness", "team", "fusion", "fig7"),
        *("faster-target", "negotiation", "benchmark"),
    }


def test_loss_delay_is_a_grid_from_nothing_to_90_percent_and_a_second():
    loaded = load_plan("loss-delay")
    loss, delay = loaded.axes
    assert (len(loaded.cells), loaded.runs) == (49, 1960)
    assert (loss.levels[0], loss.levels[-1]) == (0.0, 0.9)
    assert (delay.levels[0], delay.levels[-1]) == (0.0, 1.0)
    assert max(loaded.scenario_of(cell).ticks_max for cell in range(49)) <= 300


def test_cells_are_all_combinations_with_the_last_axis_fastest():
    loaded = plan(
        axes=[LOSS, {"name": "robots_wait", "key": "ticks_max", "values": [5, 6, 7]}],
        strategies=["xi-star", "pursuit"],
    )
    levels = [tuple(loaded.levels(cell).values()) for cell in range(len(loaded.cells))]
    assert levels == [
        (rate, ticks, strategy)
        for rate in (0.0, 0.5)
        for ticks in (5.0, 6.0, 7.0)
        for strategy in ("xi-star", "pursuit")
    ]


def test_a_cells_scenario_is_the_base_with_its_levels():
    loaded = plan(axes=[LOSS], strategies=["xi-0", "xi-3"])
    expected = load("sim1", ["channel.loss.model=bernoulli", "channel.loss.rate=0.5"])
    got = loaded.scenario_of(3)
    assert got.team.strategy == "xi-3"
    assert got.model_copy(update={"team": expected.team}) == expected


def test_arms_change_several_keys():
    arms = [
        {"name": "plain", "set": {}},
        {"name": "slow", "set": {"target.step_m_max": 0.1, "team.strategy": "pursuit"}},
    ]
    loaded = plan(axes=[{"name": "arm", "arms": arms}])
    assert [loaded.levels(k) for k in (0, 1)] == [{"arm": "plain"}, {"arm": "slow"}]
    assert loaded.scenario_of(0).target.step_m_max == load("sim1").target.step_m_max
    assert loaded.scenario_of(1).target.step_m_max == 0.1
    assert loaded.scenario_of(1).team.strategy == "pursuit"


def test_a_range_has_both_its_ends():
    axis = {**LOSS, "range": {"first": 0.0, "last": 0.9, "count": 7}}
    del axis["values"]
    levels = plan(axes=[axis]).axes[0].levels
    assert np.allclose(levels, np.arange(7) * 0.15)
    assert levels[-1] == 0.9


def test_levels_of_one_axis_have_one_type_in_the_table():
    loaded = plan(axes=[{**LOSS, "values": [0, 0.5]}])
    assert [type(loaded.levels(k)["loss"]) for k in (0, 1)] == [float, float]


@pytest.mark.parametrize(
    "changes",
    [{"title": "other"}, {"question": "other?"}, {"seeds": 9}, {"name": "other"}],
)
def test_the_fingerprint_leaves_out_what_changes_no_number(changes):
    assert plan(**changes).fingerprint == plan().fingerprint


@pytest.mark.parametrize(
    "changes",
    [
        {"axes": [{**LOSS, "values": [0.0, 0.6]}]},
        {"axes": [{**LOSS, "name": "lost"}]},
        {"scenario": "sim3"},
        {"set": {"channel.loss.model": "bernoulli", "ticks_max": 50}},
        {"measures": ["captured"]},
        {"strategies": ["xi-0"]},
    ],
)
def test_the_fingerprint_covers_what_changes_numbers(changes):
    assert plan(**changes).fingerprint != plan().fingerprint


def test_overrides_of_the_command_line_count(tmp_path):
    changed = load_plan(TREE, ["target.step_m_max=0.1"])
    assert changed.scenario_of(0).target.step_m_max == 0.1
    assert changed.fingerprint != plan().fingerprint


def test_a_base_scenario_may_stand_beside_the_study(tmp_path):
    (tmp_path / "mine.toml").write_text("ticks_max = 17\n[team]\nrobots = 3\n")
    (tmp_path / "study.toml").write_text('scenario = "mine.toml"\n')
    assert load_plan(tmp_path / "study.toml").scenario_of(0).ticks_max == 17


def test_a_plan_survives_its_way_to_a_worker():
    loaded = load_plan("staleness")
    again = type(loaded).model_validate_json(loaded.model_dump_json())
    assert again.fingerprint == loaded.fingerprint
    assert [again.scenario_of(c) for c in (0, 9)] == [loaded.scenario_of(c) for c in (0, 9)]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"axis": []}, "axis = []: unknown key"),
        ({"axes": [{**LOSS, "keys": 1}]}, "axes.0.keys = 1: unknown key"),
        ({"axes": [{**LOSS, "values": [0.0, 1.5]}]}, "channel.loss.rate = 1.5"),
        ({"axes": [{**LOSS, "key": "channel.loss.rat"}]}, "channel.loss.rat = 0.0: unknown key"),
        ({"axes": [{**LOSS, "values": []}]}, "at least one level"),
        ({"axes": [{**LOSS, "values": [0.1, 0.1]}]}, "every level once"),
        ({"axes": [{**LOSS, "arms": []}]}, "give one of values, range and arms"),
        ({"axes": [{"name": "loss", "values": [1]}]}, "need a key"),
        ({"axes": [{**LOSS, "name": "seed"}]}, "'seed': is a column"),
        ({"axes": [{**LOSS, "name": next(iter(MEASURES))}]}, "is a column"),
        ({"axes": [{**LOSS, "name": "Loss Rate"}]}, "axes.0.name = 'Loss Rate'"),
        ({"axes": [LOSS, LOSS]}, "'loss' stands twice"),
        ({"axes": [{"name": "s", "key": "seed", "values": [1, 2]}]}, "give those"),
        ({"measures": ["speed"]}, "measures: 'speed': unknown measure"),
        ({"compare": "delay"}, "compare = 'delay': must be one of the axes loss"),
        ({"compare": "loss", "baseline": "0.7"}, "baseline = '0.7'"),
        ({"baseline": "0.5"}, "nothing is compared"),
        ({"seeds": 0}, "seeds = 0"),
        ({"seeds": [1, 1]}, "different seeds"),
        ({"seeds": [-1]}, "different seeds"),
        ({"strategies": ["magic"]}, "team.strategy = 'magic'"),
        ({"scenario": "nowhere"}, "scenario 'nowhere' is neither a file nor one of"),
        ({"set": {"channel.loss.model": "never"}}, "channel.loss.model"),
        ({"tolerated_rate": 1.0}, "tolerated_rate = 1.0"),
    ],
)
def test_what_cannot_be_run_is_refused_with_its_key_and_value(changes, message):
    assert message in refusal(**changes)


def test_problems_are_listed_all_at_once():
    text = refusal(measures=["speed"], compare="delay", seeds=[1, 1])
    assert text.startswith("study 'tested' has 3 problems:")
    assert len(text.splitlines()) == 4


def test_a_problem_of_many_cells_is_told_once_with_where_it_first_is():
    text = refusal(axes=[{**LOSS, "values": [0.5, 1.5]}], strategies=["xi-0", "xi-1"])
    assert text.count("1.5") == 2  # value and where
    assert "(at loss = 1.5, strategy = xi-0)" in text


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("channel.loss.rat", "channel.loss.rat = 0.1: unknown key (did you mean 'rate'?)"),
        ("channel.loss.burst_packets", "channel.loss.burst_packets = 0.1: has no meaning"),
        ("title.x", "override 'title.x=0.1': there is no such key"),
    ],
)
def test_a_wrong_key_is_told_once_however_many_values_it_has(key, said):
    text = refusal(axes=[{**LOSS, "key": key, "values": [0.1, 0.2]}])
    assert "one problem" in text
    assert said in text


def test_every_wrong_value_of_a_key_is_told():
    text = refusal(axes=[{**LOSS, "values": [1.25, 1.5]}])
    assert "has 2 problems" in text


def test_files_that_are_no_studies(tmp_path):
    with pytest.raises(StudyError, match="neither a file nor one of: benchmark, burst, delay"):
        load_plan("nothing")
    broken = tmp_path / "broken.toml"
    broken.write_text("scenario = ")
    with pytest.raises(StudyError, match="cannot be parsed"):
        load_plan(broken)
    broken.write_bytes(b"\xff\xfe")
    with pytest.raises(StudyError, match="cannot be parsed"):
        load_plan(broken)


@pytest.mark.parametrize(
    "value", [1, 0.1, "a b", True, [1.0, [2.0]], {"model": "burst", "rate": 0.5, "list": [1]}]
)
def test_values_in_toml_are_read_back(value):
    import tomllib

    assert tomllib.loads(f"value = {toml_text(value)}")["value"] == value


def test_shipped_files_are_found_as_files():
    assert all(isinstance(path, Path) and path.is_file() for path in shipped_studies().values())
