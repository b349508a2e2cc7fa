"""What of the radio is refused: values out of range, contradictions, keys that a model ignores."""

import pytest

from encircle.world.loading.load import load
from encircle.world.scenario.delay_models import DELAY_MODELS
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.loss_models import LOSS_MODELS

FOUR = {"team": {"robots": 4}}


def refusal(*overrides, tree=FOUR):
    with pytest.raises(ScenarioError) as caught:
        load(tree, overrides)
    return str(caught.value)


OUT_OF_RANGE = [
    ("channel.loss.burst_packets", "0.5"),
    ("channel.loss.burst_packets", "nan"),
    ("channel.loss.midpoint_m", "0.0"),
    ("channel.loss.midpoint_m", "-3.0"),
    ("channel.loss.width_m", "0.0"),
    ("channel.loss.width_m", "inf"),
    ("channel.loss.cutoff_m", "0.0"),
    ("channel.loss.range_m", "0.0"),
    ("channel.loss.exponent", "0.1"),
    ("channel.loss.fading", "'rician'"),
    ("channel.loss.coherence_s", "-1.0"),
    ("channel.loss.shadowing_db", "41.0"),
    ("channel.loss.shadowing_s", "0.0"),
    ("channel.contention.packet_s", "0.0"),
    ("channel.loss.mode", "'twice'"),
    ("channel.delay.mode", "'twice'"),
    ("channel.duplication.rate", "1.5"),
    ("channel.duplication.rate", "-0.1"),
    ("channel.rate_limit.packets_per_s", "0.0"),
    ("channel.rate_limit.bytes_per_s", "-5.0"),
    ("channel.rate_limit.bytes_per_s", "inf"),
    ("channel.rate_limit.queue_packets_max", "-1"),
    ("channel.rate_limit.queue_packets_max", "1001"),
    ("channel.rate_limit.queue_packets_max", "1.5"),
    ("team.jitter_m", "-0.1"),
    ("team.jitter_m", "nan"),
]


@pytest.mark.parametrize(("key", "text"), OUT_OF_RANGE)
def test_a_value_out_of_range_is_refused_with_its_key_and_value(key, text):
    said = refusal(f"{key}={text}")
    assert "one problem" in said
    assert f"\n  {key} = {text}" in said


@pytest.mark.parametrize(
    "table", ["channel.duplication.", "channel.rate_limit.", "channel.contention."]
)
def test_an_unknown_key_is_refused_with_its_value(table):
    assert f"\n  {table}colour = 987: unknown key" in refusal(f"{table}colour=987")


EVENT = "events=[{{kind='{}', tick=1, ticks=1, {}}}]"
CONTRADICTIONS = [
    (["channel.loss={model='burst', rate=0.2}"], ["channel.loss.burst_packets", "must be given"]),
    (
        ["channel.loss={model='burst', rate=0.9, burst_packets=2}"],
        ["channel.loss.rate = 0.9", "burst_packets = 2", "0.666667"],
    ),
    (["channel.loss={model='burst', rate=1.0, burst_packets=1e6}"], ["channel.loss.rate = 1.0"]),
    (["channel.loss={model='distance', width_m=1}"], ["channel.loss.midpoint_m"]),
    (["channel.loss={model='distance', midpoint_m=1}"], ["channel.loss.width_m"]),
    (
        ["channel.loss={model='path-loss', exponent=3}"],
        ["channel.loss.range_m", "must be given", "'path-loss'"],
    ),
    (["channel.contention={}"], ["channel.contention.packet_s", "is missing"]),
    (["channel.contention={packet_s=0.1, range_m=0}"], ["channel.contention.range_m = 0", "above"]),
    (
        ["channel.contention={packet_s=0.1, access='csma'}"],
        ["channel.contention.access = 'csma'", "one of slotted-aloha, aloha"],
    ),
    (["channel.loss={model='range'}"], ["channel.loss.cutoff_m", "must be given", "'range'"]),
    (
        ["channel.delay.model=normal", "channel.delay.mean_s=1"],
        ["channel.delay.std_s: is missing", "'normal'"],
    ),
    (["channel.delay.model=exponential"], ["channel.delay.mean_s: is missing", "exponential"]),
    (["channel.rate_limit={}"], ["channel.rate_limit", "packets_per_s, bytes_per_s or both"]),
    (["channel.rate_limit.queue_packets_max=3"], ["channel.rate_limit", "or both"]),
    (
        ["channel.links=[{sender='r1', loss={model='burst', rate=0.9, burst_packets=2}}]"],
        ["channel.links.0.loss.rate = 0.9"],
    ),
    (["channel.links=[{sender='r2', receiver='r2'}]"], ["channel.links.0.receiver = 'r2'"]),
    (
        ["channel.links=[{sender='r1', delay={model='trace'}}]"],
        ["channel.links.0.delay", "file or values"],
    ),
    ([EVENT.format("outage", "sender='r9'")], ["events.0.sender = 'r9'", "r1, r2, r3, r4"]),
    ([EVENT.format("outage", "receiver='q'")], ["events.0.receiver = 'q'"]),
    ([EVENT.format("outage", "sender='r1', receiver='r1'")], ["events.0.receiver = 'r1'"]),
    (
        [EVENT.format("outage", "robot='r1'")],
        ["events.0.robot = 'r1'", "no meaning for kind 'outage'", "'silence', 'crash'"],
    ),
    ([EVENT.format("partition", "groups=[['r1', 'r9'], ['r2']]")], ["events.0.groups.0.1 = 'r9'"]),
    (
        [EVENT.format("partition", "groups=[['r1'], ['r2', 'r1']]")],
        ["events.0.groups.1.1 = 'r1'", "groups.0 already"],
    ),
    ([EVENT.format("partition", "groups=[['r1']]")], ["events.0.groups ="]),
    ([EVENT.format("partition", "groups=[['r1'], []]")], ["events.0.groups.1 = ()"]),
    ([EVENT.format("partition", "groups=7")], ["events.0.groups = 7"]),
    (["team.jitter_m=0.2"], ["team.jitter_m = 0.2", "without positions"]),
]


@pytest.mark.parametrize(("overrides", "parts"), CONTRADICTIONS)
def test_a_contradiction_is_refused_and_named(overrides, parts):
    said = refusal(*overrides)
    assert "one problem" in said
    assert all(part in said for part in parts), said


LOSS_VALUES = {
    "rate": 0.1,
    "good_to_bad": 0.1,
    "bad_to_good": 0.5,
    "loss_good": 0.1,
    "loss_bad": 0.5,
    "burst_packets": 2.0,
    "midpoint_m": 5.0,
    "width_m": 1.0,
    "cutoff_m": 9.0,
    "range_m": 9.0,
    "exponent": 3.0,
    "fading": "'none'",
    "coherence_s": 0.2,
    "shadowing_db": 4.0,
    "shadowing_s": 3.0,
    "mode": "'shifted'",
    "values": "[1, 0]",
}
DELAY_VALUES = {
    "mean_s": 0.1,
    "std_s": 0.1,
    "low_s": 0.1,
    "high_s": 0.2,
    "mode": "'resample'",
    "values": "[0.1]",
}
EVERY = [
    *(("loss", name, set(model.model_fields), LOSS_VALUES) for name, model in LOSS_MODELS.items()),
    *(
        ("delay", name, set(model.model_fields), DELAY_VALUES)
        for name, model in DELAY_MODELS.items()
    ),
]


@pytest.mark.parametrize(("sort", "model", "used", "values"), EVERY)
@pytest.mark.parametrize("place", ["channel.{}", "channel.links=[{{sender='r1', {}="])
def test_a_model_takes_its_own_keys_and_refuses_each_that_it_ignores(
    sort, model, used, values, place
):
    own = [f"{key}={value}" for key, value in values.items() if key in used]
    table = "{" + ", ".join([f"model='{model}'", *own]) + "}"
    if "links" in place:
        given = place.format(sort) + "{}}}]"
        key = f"channel.links.0.{sort}"
        change = given[: -len("{}}}]")] + "%s}]"
    else:
        key = place.format(sort)
        change = f"{key}=%s"
    assert load(FOUR, [change % table]).ids
    for name, value in values.items():
        if name not in used:
            other = table[:-1] + f", {name}={value}}}"
            said = refusal(change % other)
            assert "one problem" in said
            assert f"{key}.{name} = " in said
            assert f"has no meaning for model '{model}'" in said


@pytest.mark.parametrize(("rate", "length"), [(0.5, 1.0), (2 / 3, 2.0), (0.75, 3.0), (0.9, 9.0)])
def test_the_highest_feasible_rate_of_bursts_is_taken_and_a_higher_one_refused(rate, length):
    text = "channel.loss={{model='burst', rate={!r}, burst_packets={}}}"
    assert load(FOUR, [text.format(rate, length)]).channel.loss.rate == rate
    assert "channel.loss.rate" in refusal(text.format(rate + 1e-6, length))


@pytest.mark.parametrize(
    ("table", "parts"),
    [
        ({"model": "bernoulli", "file": "x.csv"}, ["channel.loss.file = 'x.csv'", "trace"]),
        ({"file": "x.csv"}, ["channel.loss.file = 'x.csv'", "trace"]),
        ({"model": "trace", "file": 7}, ["channel.loss.file = 7"]),
        ({"model": "trace"}, ["channel.loss", "file or values"]),
        ({"model": "trace", "values": []}, ["channel.loss.values = ()", "at least one row"]),
        ({"model": "trace", "values": [0, 2]}, ["channel.loss.values.1 = 2"]),
        ({"model": "trace", "values": [1], "file": "x.csv"}, ["channel.loss.file", "either"]),
        ({"model": "trace", "mode": "random", "values": [1]}, ["channel.loss.mode = 'random'"]),
        ({"model": "bernoulli", "values": [1] * 90}, ["channel.loss.values = [1, 1,", "..."]),
        ({"model": "trace", "values": [1], "rate": 0.5}, ["channel.loss.rate = 0.5", "mode"]),
        (
            {"model": "trace", "links": [{"sender": "r1", "receiver": "r2", "values": [1]}] * 2},
            ["channel.loss.links.1", "r1 -> r2 has rows already", "no rows for r2 -> r1"],
        ),
    ],
)
def test_a_table_that_asks_for_no_sensible_trace_is_refused(table, parts):
    with pytest.raises(ScenarioError) as caught:
        load({"team": {"robots": 2}, "channel": {"loss": table}})
    assert all(part in str(caught.value) for part in parts), caught.value


def test_a_bad_item_of_a_list_hides_no_other_problem():
    event = "events=[{kind='outage', tick=-1, ticks=3}]"
    said = refusal(event, "capture.count=9", "team.strategy=none")
    assert "3 problems" in said
    assert all(f"  {key} = " in said for key in ("events.0.tick", "capture.count", "team.strategy"))


def test_a_table_written_out_as_null_can_be_overridden():
    tree = load(FOUR).model_dump(mode="json")
    assert tree["channel"]["rate_limit"] is None
    changed = load(tree, ["channel.rate_limit.packets_per_s=5"])
    assert changed.channel.rate_limit.packets_per_s == 5.0


def test_very_many_problems_are_counted_but_not_all_listed():
    tree = {**FOUR, "channel": {"loss": {"model": "trace", "values": [7] * 5000}}}
    lines = refusal(tree=tree).splitlines()
    assert "5000 problems" in lines[0]
    assert len(lines) == 102
    assert "and 4900 more" in lines[-1]
