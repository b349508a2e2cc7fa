"""No word of pydantic's reaches a person, whatever is wrong: every field, with values of all kinds.

What pydantic itself would have said is the oracle of what must not be said.
"""

import copy
import datetime
import re
import types
from functools import partial
from typing import Annotated, Literal, Union, get_args, get_origin, get_type_hints

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from encircle.protocol.parameters import Problems, Range
from encircle.studies.plan import Plan, StudyError
from encircle.studies.plan_files import load_plan
from encircle.world.loading.load import load
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.fields import shown
from encircle.world.scenario.model import Scenario
from encircle.world.scenario.plugin_parameters import check_parameters
from encircle.world.scenario.validation import OTHERWISE, keys_of, problems_in

WRONG = [
    *(None, True, False, 0, 1, -1, 7, 2**70, 10**400, 0.0, 1.5, -2.5, 1e300),
    *(float("inf"), float("-inf"), float("nan"), "", "x", "12", "r1", "x" * 500, b"x"),
    *([], [1], ["x"], [[1.0, 2.0]], [1.0, 2.0, 3.0], [None], [{}], (1.0,), {1, 2}),
    *({}, {"a": 1}, {"a": {"b": 1}}, {1: 2}, datetime.date(2026, 1, 2), object),
]
ITS_WORDS = re.compile(
    r"Input|should be|should have|valid |validation|Field required|Extra|permitted|Value error"
    r"|unable to|discriminator|instance of|pydantic|url|\btype=|Tuple|Dict|__|Traceback",
    re.IGNORECASE,
)
SCENARIO = {
    "title": "whole",
    "seed": 1,
    "team": {
        "positions": [[4.0, 0.0], [0.0, 4.0], [-4.0, 0.0]],
        "placement": {},
        "robots": {"count": 3, "r2": {"step_m_max": 0.1, "policy_parameters": {}}},
    },
    "target": {"behaviour": "patrol", "parameters": {"waypoints": [[60.0, 0.0], [0.0, 60.0]]}},
    "robot": {"xi_weight": 0.1},
    "sensing": {},
    "obstacles": [{"position": [9.0, 9.0], "radius_m": 1.0}],
    "events": [
        {"kind": "move-target", "tick": 3, "position": [1.0, 1.0]},
        {"kind": "silence", "tick": 3, "ticks": 2, "robot": "r1"},
        {"kind": "outage", "tick": 3, "ticks": 2},
        {"kind": "partition", "tick": 3, "ticks": 2, "groups": [["r1"], ["r2"]]},
        {"kind": "crash", "tick": 3, "robot": "r1"},
    ],
    "channel": {
        "loss": {
            "model": "trace",
            "values": [0, 1],
            "links": [{"sender": "r1", "receiver": "r2", "values": [0, 1]}],
        },
        "delay": {
            "model": "trace",
            "values": [0.1, None],
            "links": [{"sender": "r1", "receiver": "r2", "values": [0.1]}],
        },
        "duplication": {},
        "rate_limit": {"packets_per_s": 5.0},
        "contention": {"packet_s": 0.01},
        "links": [{"sender": "r1", "receiver": "r3", "loss": {}, "delay": {}}],
    },
    "capture": {},
}
STUDY = {
    "name": "whole",
    "scenario": "sim1",
    "set": {"ticks_max": 3},
    "axes": [
        {"name": "loss", "key": "channel.loss.rate", "values": [0.0]},
        {
            "name": "delay",
            "key": "channel.delay.mean_s",
            "range": {"first": 0.0, "last": 1.0, "count": 2},
        },
        {"name": "arm", "arms": [{"name": "a", "set": {"tick_s": 0.2}}]},
    ],
    "strategies": ["xi-0"],
    "seeds": [1, 2],
    "measures": ["captured"],
}


def models_in(annotation):
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif get_origin(annotation) in (Union, types.UnionType, Annotated, tuple, list):
        for part in get_args(annotation):
            yield from models_in(part)


def fields_in(model, tree, path=()):
    """The place of every field of a model, in it and in the tables and lists of a tree."""
    if model.model_config.get("extra") == "allow":
        (other,) = models_in(get_args(get_type_hints(model)["__pydantic_extra__"])[-1])
        for name in set(tree) - set(model.model_fields):
            yield (*path, name)
            yield from fields_in(other, tree[name], (*path, name))
    for name, field in model.model_fields.items():
        yield (*path, name)
        value = tree.get(name)
        tables = list(models_in(field.annotation))
        places = [((*path, name), value)]
        if isinstance(value, list):
            places = [((*path, name, k), item) for k, item in enumerate(value)]
            yield from (place for place, _ in places)
            yield from (
                (*place, k)
                for place, item in places
                if isinstance(item, list)
                for k in range(len(item))
            )
        for place, item in places:
            if isinstance(item, dict):
                for table in tables:
                    if "kind" not in item or item["kind"] in get_args(
                        table.model_fields["kind"].annotation
                    ):
                        yield from fields_in(table, item, place)


def with_value(tree, path, value):
    changed = copy.deepcopy(tree)
    place = changed
    for part in path[:-1]:
        place = place[part]
    place[path[-1]] = value
    return changed


def its_messages(model, tree):
    """What pydantic says of a tree, but for what our own checks say through it."""
    try:
        model.model_validate(tree)
    except ValidationError as error:
        return {e["msg"] for e in error.errors() if e["type"] != "value_error"}
    return set()


def check(said, path, value, tree, model):
    """No foreign word; and if it is the value itself that is wrong, its key and value."""
    foreign = its_messages(model, tree)
    lines = said.splitlines()[1:]
    assert not any(message in said for message in foreign)
    for line in lines:
        bare = line.replace(shown(value), "").split(" = ")[0] + line.rpartition(": ")[2]
        assert ITS_WORDS.search(bare) is None, line
        assert OTHERWISE not in line, line
    if not foreign:
        return
    keys = [".".join(map(str, path[: k + 1])) for k in range(len(path))]
    # Of a list or table it is the part that is wrong, or the whole that the value is in.
    values = [shown(value), shown(_as_read(value))]
    values += [shown(part) for part in _parts(value)]
    around = tree
    for part in path[:-1]:
        around = around[part]
        values.append(shown(around)[:40])
    assert any(
        f"  {key}" in line and (line.endswith("is missing") or any(v in line for v in values))
        for key in keys
        for line in lines
    ), (path, value, said)


def _as_read(value):
    """A scenario is copied as it is read, with lists for tuples."""
    return list(value) if isinstance(value, tuple) else value


def _parts(value):
    inner = value.values() if isinstance(value, dict) else value
    if not isinstance(value, dict | list | tuple | set):
        return []
    return [part for one in inner for part in (one, *_parts(one))]


SCENARIO_FIELDS = list(dict.fromkeys(fields_in(Scenario, SCENARIO)))
STUDY_FIELDS = list(fields_in(Plan, STUDY))


def test_the_walk_meets_every_field_of_every_model():
    assert load(SCENARIO).seed == 1
    assert load_plan(STUDY).runs == 4
    assert len(WRONG) > 30
    for key in keys_of(Scenario):
        assert tuple(key.split(".")) in SCENARIO_FIELDS
    kinds = {path[2] for path in SCENARIO_FIELDS if path[0] == "events" and len(path) > 2}
    assert kinds >= {"kind", "tick", "ticks", "robot", "sender", "receiver", "groups", "position"}
    assert {path[2] for path in STUDY_FIELDS if path[0] == "axes" and len(path) > 2} >= {
        *("name", "key", "values", "range", "arms", "label", "unit", "scale", "show")
    }


THIRDS = [0, 1, 2]
"""Every field meets a third of the values in an ordinary run, another one than its neighbours."""


def some(fields):
    return [
        pytest.param(path, third, id=".".join(map(str, path)) + f"-{third}")
        if third == place % len(THIRDS)
        else pytest.param(path, third, marks=pytest.mark.nightly)
        for place, path in enumerate(fields)
        for third in THIRDS
    ]


@pytest.mark.parametrize(("path", "third"), some(SCENARIO_FIELDS))
def test_of_a_scenario_every_wrong_value_is_refused_in_plain_words(path, third):
    for value in WRONG[third :: len(THIRDS)]:
        tree = with_value(SCENARIO, path, value)
        try:
            load(tree)
        except ScenarioError as error:
            check(str(error), path, value, tree, Scenario)


@pytest.mark.parametrize(("path", "third"), some(STUDY_FIELDS))
def test_of_a_study_every_wrong_value_is_refused_in_plain_words(path, third):
    for value in WRONG[third :: len(THIRDS)] if path != ("changes",) else []:
        tree = with_value(STUDY, path, value)
        try:
            load_plan(tree)
        except StudyError as error:
            check(str(error), path, value, {**tree, "changes": ()}, Plan)


@pytest.mark.parametrize(
    ("annotation", "values"),
    [
        (int, ["x", 1.5]),
        (int | str, [1.5, []]),
        (float | None, ["x"]),
        (list[int], [3, ["x"], {"a": 1}]),
        (tuple[float, float], [[1.0], [1.0, 2.0, 3.0], "x"]),
        (dict[str, int], [3, {"a": "x"}]),
        (Literal["a", "b"], ["c", 1]),
        (bool, ["x", 3]),
        (Annotated[int, Field(gt=1, lt=9, multiple_of=2)], [0, 10, 3]),
        (Annotated[str, Field(min_length=2, max_length=3, pattern="^a*$")], ["a", "aaaa", "bb", 1]),
        (set[int], [3]),
        (bytes, [3]),
    ],
)
def test_of_a_target_of_ones_own_as_well(annotation, values):
    def behaviour(memory, view, *, gain):
        return memory, (0.0, 0.0)

    behaviour.__annotations__["gain"] = annotation
    model = create_model("P", __config__=ConfigDict(extra="forbid"), gain=(annotation, ...))
    for value in values:
        with pytest.raises(ValueError, match=r"^gain") as caught:
            check_parameters(behaviour, {"gain": value})
        for message in its_messages(model, {"gain": value}):
            assert message not in str(caught.value)
        assert ITS_WORDS.search(str(caught.value)) is None, caught.value


@pytest.mark.parametrize(
    ("annotation", "value"),
    [(int, "5"), (int, True), (int, 5.0), (float, "0.5"), (bool, "no"), (bool, 0), (str, 3)],
)
def test_ones_own_parameter_is_not_taken_for_another_type_since_it_is_given_as_written(
    annotation, value
):
    def policy(memory, view, *, gain):
        return memory, None

    policy.__annotations__["gain"] = annotation
    with pytest.raises(ValueError, match=r"^gain = .*: must be "):
        check_parameters(policy, {"gain": value})


def test_whole_numbers_are_numbers_and_lists_are_tuples_in_ones_own_parameters():
    def policy(memory, view, *, gain: float, at: tuple[float, float], way: Literal["a", "b"]):
        return memory, None

    check_parameters(policy, {"gain": 1, "at": [1, 2.5], "way": "a"})
    check_parameters(policy, {"gain": 1, "at": (1, 2.5), "way": "b"})


def test_a_behaviour_whose_annotations_make_no_sense_is_named():
    def behaviour(memory, view, *, gain: "Nowhere"):  # noqa: F821
        return memory, (0.0, 0.0)

    with pytest.raises(ValueError, match="its parameters cannot be understood: NameError"):
        check_parameters(behaviour, {})


def refusal(tree, *overrides):
    with pytest.raises(ScenarioError) as caught:
        load(tree, overrides)
    return str(caught.value)


@pytest.mark.parametrize(
    ("change", "meant"),
    [
        ("tem.robots=3", "'team'"),
        ("team.robot=3", "'robots'"),
        ("channel.los.rate=1", "'loss'"),
        ("channel.loss.rat=1", "'rate'"),
        ("channel.rate=0.5", "'channel.loss.rate' or 'channel.duplication.rate'"),
        ("step_m_max=0.3", "'team.step_m_max' or 'target.step_m_max'"),
        ("xi_weight=0.3", "'robot.xi_weight'"),
        ("robot.xi_wait=0.3", "'xi_weight'"),
        ("robot.search='spirals'", "'spiral'"),
        ("target.parameters.obstacle_rang_m=1", "'obstacle_range_m'"),
        ("team.strategy='xi-sta'", "'xi-star'"),
        ("target.behaviour='fle'", "'flee'"),
        ("channel.loss.model='bernouli'", "'bernoulli'"),
        ("team.motion='unicycles'", "'unicycle'"),
        ("clock='walls'", "'wall'"),
        ("events=[{kind='crush', tick=1, robot='r1'}]", "'crash'"),
        ("events=[{kind='crash', tik=1, robot='r1'}]", "'tick'"),
    ],
)
def test_what_is_nearly_right_is_told_what_was_meant(change, meant):
    assert f"(did you mean {meant}?)" in refusal({"team": {"robots": 4}}, change)


def test_names_that_are_nearly_right_are_told_what_was_meant():
    assert "(did you mean 'sim1'?)" in refusal("sim01")
    for tree, meant in [
        ({"scenario": "simm1"}, "sim1"),
        ({"scenario": "sim1", "measure": []}, "measures"),
        ({"scenario": "sim1", "measures": ["capturd"]}, "captured"),
        ({"scenario": "sim1", "strategies": ["xi-1", "pursue"]}, "pursuit"),
        ({**STUDY, "compare": "los"}, "loss"),
        ({**STUDY, "compare": "arm", "baseline": "A"}, None),
        ({**STUDY, "axes": [{**STUDY["axes"][0], "keys": 1}]}, "key"),
    ]:
        with pytest.raises(StudyError) as caught:
            load_plan(tree)
        assert meant is None or f"(did you mean '{meant}'?)" in str(caught.value)
    with pytest.raises(StudyError, match=r"did you mean 'staleness'\?"):
        load_plan("stalenes")


def test_nothing_is_suggested_where_nothing_is_like_it():
    said = refusal({"team": {"robots": 4}}, "qqqq=1", "team.strategy=zzzz")
    assert "did you mean" not in said


def test_every_problem_of_a_study_is_listed_at_once():
    tree = {
        "scenario": "sim1",
        "seeds": 0,
        "strategies": ["xi-stat"],
        "set": {"channel.loss": {"model": "bernoulli", "rate": 1.5}, "ticks_max": 0},
        "measures": ["speed"],
        "compare": "speed",
        "colour": "red",
        "tolerated_rate": 3,
        "axes": [
            {"name": "Bad Name", "key": "seed", "values": [1]},
            {"name": "delay", "key": "channel.delay.mean_s", "values": [0.1, -4.0]},
        ],
    }
    with pytest.raises(StudyError) as caught:
        load_plan(tree, ["team.radius=2"])
    said = str(caught.value)
    for part in (
        "seeds = 0: must be a number from 1 to",
        "team.strategy = 'xi-stat': unknown policy (did you mean 'xi-star'?)",
        "channel.loss.rate = 1.5: must be at most 1",
        "ticks_max = 0: must be at least 1",
        "measures: 'speed': unknown measure",
        "colour = 'red': unknown key",
        "tolerated_rate = 3: must be below 1",
        "axes.0.name = 'Bad Name': must begin with a small letter",
        "channel.delay.mean_s = -4.0: must be at least 0",
        "team.radius = 2: unknown key (did you mean 'radius_m'?)",
    ):
        assert part in said
    # As the strategies are wrong in a cell, not in the study, it is known what can be compared.
    assert said.count("\n") == int(re.search(r"has (\d+) problems", said)[1])


def test_the_base_scenario_and_the_rest_of_a_study_are_listed_together():
    with pytest.raises(StudyError) as caught:
        load_plan({"scenario": "simm1", "seeds": -1, "measures": ["speed"]})
    assert "has 3 problems" in str(caught.value)


def test_overrides_and_parameters_of_robots_are_listed_all_at_once():
    said = refusal(
        {"team": {"robots": 4}},
        "nothing",
        "team.robots.x=1",
        "robot.xi_weight=-1",
        "robot.publish=2",
        "robot.colour=1",
        "robot.spline_samples=1.5",
    )
    assert said.startswith("scenario 'scenario' has 6 problems:")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("obstacles.1.radius_m=1", "obstacles is a list, and '1' not the number of one"),
        ("obstacles.x.radius_m=1", "they are numbered from 0 to 0"),
        ("obstacles.-1=1", "they are numbered from 0 to 0"),
        ("seed.x=1", "seed = 1 is no table"),
        ("events.x=1", "it has none"),
    ],
)
def test_an_override_of_what_is_not_there_is_told_why(change, said):
    tree = {**SCENARIO, "events": []}
    assert said in refusal(tree, change)


def test_more_seeds_than_allowed_are_refused_before_they_are_made():
    for seeds in (10**15, [1] * 3, True, 1.5, "3", [], "4-3", "0-9999999", "1 - 3"):
        with pytest.raises(StudyError, match=r"seeds = .*must be a number from 1 to 1000000"):
            load_plan({"scenario": "sim1", "seeds": seeds})


def test_seeds_may_be_the_first_and_the_last():
    assert load_plan({"scenario": "sim1", "seeds": "1001-1003"}).seed_list == (1001, 1002, 1003)
    assert load_plan("loss", seeds="0-0").seed_list == (0,)


def test_an_unknown_kind_of_error_is_not_told_in_foreign_words():
    class Strange(BaseModel):
        when: datetime.datetime

    with pytest.raises(ValidationError) as caught:
        Strange.model_validate({"when": "x"})
    found = problems_in(caught.value, Strange, {"when": "x"})
    assert found == {("when",): f"when = 'x': {OTHERWISE}"}


class Weighted:
    """A policy that is an object: its parameters are those of its call."""

    def __call__(self, memory, view, *, weight: Annotated[float, Range(0.0, 1.0)] = 0.5):
        raise NotImplementedError("only its parameters are asked for")


@pytest.mark.parametrize("policy", [Weighted(), partial(Weighted(), weight=0.25)])
def test_an_object_and_a_partial_have_the_parameters_of_what_they_call(policy):
    check_parameters(policy, {"weight": 0.75})
    with pytest.raises(Problems) as refused:
        check_parameters(policy, {"weight": 2.0})
    (line,) = refused.value.lines
    assert line.startswith("weight")


def test_of_an_own_parameter_without_its_unit_it_is_told_what_was_meant():
    def policy(memory, view, *, lead_ticks=3.0, reach_m=1.0):
        return memory, view.search

    with pytest.raises(Problems) as caught:
        check_parameters(policy, {"lead": 3})
    known = "(did you mean 'lead_ticks'?); known are: lead_ticks, reach_m"
    assert list(caught.value.lines) == [f"lead = 3: unknown key {known}"]
