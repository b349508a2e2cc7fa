"""Profiles of real links: complete, sourced, loaded in place of their name, and overridden."""

import re
import tomllib
from math import exp, log, sqrt

import pytest
from helpers_paths import DOCS

import encircle
from encircle.studies.plan_files import load_plan
from encircle.world.loading.load import load
from encircle.world.loading.profiles import current, expanded, profiles
from encircle.world.loading.remarks import ScenarioRemark
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import digest_header

FOUR = {"team": {"robots": 4}}
PAGE = (DOCS / "radio.md").read_text(encoding="utf-8")


def channel(*changes, tree=FOUR):
    return load(tree, changes).channel


def test_the_page_is_current():
    assert current(PAGE) == PAGE, "run python -m encircle.world.loading.profiles --write"


@pytest.mark.parametrize("name", profiles())
def test_a_profile_can_be_loaded_and_says_where_its_figures_are_from(name):
    made = channel(f"channel.profile={name}")
    assert made != channel()
    profile = profiles()[name]
    assert re.search(r"\b(19|20)\d\d\b", profile.source), "a year"
    assert len(profile.fitted) > 100
    assert set(profile.channel) <= set(type(made).model_fields)
    assert {"loss", "delay", "rate_limit"} & set(profile.channel)


@pytest.mark.parametrize("name", profiles())
def test_a_resolved_scenario_knows_no_profile_and_is_the_same_again(name):
    scenario = load(FOUR, [f"channel.profile={name}"])
    again = load(scenario.model_dump(mode="json"))
    assert again == scenario
    assert digest_header(again, 1) == digest_header(scenario, 1)
    assert "profile" not in digest_header(scenario, 1)


def test_a_file_may_name_a_profile_as_an_override_may(tmp_path):
    file = tmp_path / "own.toml"
    file.write_text('[team]\nrobots = 4\n[channel]\nprofile = "4g"\n', encoding="utf-8")
    assert load(file).channel == channel("channel.profile=4g")


def test_bursts_in_seconds_become_packets_of_the_ticks_there_are():
    for tick_s in (0.02, 0.1, 0.5):
        loss = channel(f"tick_s={tick_s}", "channel.profile=wifi-moving").loss
        assert loss.burst_packets == pytest.approx(1.87 / tick_s)
    # At least one packet, and as many as the rate needs.
    loss = channel("tick_s=10", "channel.profile=wifi-moving").loss
    assert loss.burst_packets == 1.0
    loss = channel("tick_s=10", "channel.profile=wifi-moving", "channel.loss.rate=0.8").loss
    assert loss.burst_packets == pytest.approx(4.0)


def test_own_keys_count_before_the_profiles():
    plain = channel("channel.profile=wifi-moving")
    own = channel("channel.profile=wifi-moving", "channel.loss.rate=0.3", "channel.order=kept")
    assert (own.loss.rate, own.loss.burst_packets) == (0.3, plain.loss.burst_packets)
    assert (own.delay, own.order) == (plain.delay, "kept")
    packets = channel("channel.profile=wifi-moving", "channel.loss.burst_packets=3").loss
    assert (packets.rate, packets.burst_packets) == (0.06, 3.0)


def test_another_model_takes_the_place_of_the_profiles_table():
    own = channel("channel.profile=wifi-moving", "channel.loss={model='bernoulli', rate=0.2}")
    assert own.loss == channel("channel.loss={model='bernoulli', rate=0.2}").loss
    assert own.delay == channel("channel.profile=wifi-moving").delay
    none = channel("channel.profile=zigbee", "channel.loss.model=none")
    assert none.loss == channel().loss
    assert none.contention == channel("channel.profile=zigbee").contention


def test_tables_without_models_are_merged_key_by_key():
    own = channel("channel.profile=zigbee", "channel.contention.access=slotted-aloha")
    assert (own.contention.access, own.contention.packet_s) == ("slotted-aloha", 0.00426)
    own = channel("channel.profile=lora", "channel.rate_limit.queue_packets_max=7")
    assert (own.rate_limit.bytes_per_s, own.rate_limit.queue_packets_max) == (684.0, 7)


@pytest.mark.parametrize(
    ("value", "shown"), [("'wifi-movin'", "'wifi-movin'"), ("7", "7"), ("['4g']", "['4g']")]
)
def test_an_unknown_profile_is_refused_with_those_that_there_are(value, shown):
    with pytest.raises(ScenarioError) as caught:
        channel(f"channel.profile={value}")
    told = str(caught.value)
    assert "one problem" in told
    assert f"channel.profile = {shown}: must be one of 4g, acoustic-modem, " in told
    assert told.endswith("(did you mean 'wifi-moving'?)") == (value == "'wifi-movin'")


@pytest.mark.parametrize("tree", [{}, {"channel": 7}, {"channel": {"profile": None}}, [], None])
def test_what_names_no_profile_is_left_as_it_is(tree):
    assert expanded(tree) == []


def test_a_malformed_tick_or_rate_beside_a_profile_is_told_alone():
    for change in ("tick_s='long'", "channel.loss.rate='much'", "tick_s=0"):
        with pytest.raises(ScenarioError) as caught:
            channel("channel.profile=4g", change)
        assert "one problem" in str(caught.value)
        assert f"\n  {change.split('=')[0]} = " in str(caught.value)


def test_a_cell_of_a_study_may_name_another_profile_than_its_base_scenario(tmp_path):
    (tmp_path / "lossy.csv").write_text("lost\n0\n1\n", encoding="utf-8")
    (tmp_path / "base.toml").write_text(
        """
        [team]
        robots = 4
        [channel]
        profile = "zigbee"
        order = "kept"
        delay = { model = "constant", mean_s = 0.3 }
        [[channel.links]]
        sender = "r1"
        loss = { model = "trace", file = "lossy.csv" }
        """,
        encoding="utf-8",
    )
    study = tmp_path / "study.toml"
    study.write_text(
        """
        scenario = "base.toml"
        seeds = 1
        [[axes]]
        name = "link"
        key = "channel.profile"
        values = ["zigbee", "4g"]
        """,
        encoding="utf-8",
    )
    plan = load_plan(study)
    (tmp_path / "lossy.csv").unlink()
    made = [plan.scenario_of(cell).channel for cell in (0, 1)]
    for name, of_cell in zip(("zigbee", "4g"), made, strict=True):
        of_profile = channel(f"channel.profile={name}")
        assert (of_cell.loss, of_cell.rate_limit, of_cell.contention) == (
            of_profile.loss,
            of_profile.rate_limit,
            of_profile.contention,
        )
        assert (of_cell.order, of_cell.delay.mean_s) == ("kept", 0.3)
        assert of_cell.links[0].loss.values == (0, 1)


def examples():
    return [tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)]


def test_axes_on_the_page_are_axes_of_a_study():
    axes = [axis for tree in examples() for axis in tree.get("axes", ())]
    assert {axis["key"] for axis in axes} == {"channel.profile", "channel.loss.range_m"}
    for axis in axes:
        base = {"channel.loss.model": "path-loss"} if "range" in axis["name"] else {}
        study = {"scenario": "sim1", "seeds": 2, "set": base, "axes": [axis]}
        plan = load_plan(study)
        made = [plan.scenario_of(cell).channel for cell in range(len(plan.cells))]
        assert len(made) == len(axis["values"])
        assert all(one != other for k, one in enumerate(made) for other in made[:k])


def test_commands_on_the_page_set_what_a_scenario_can_have():
    lines = re.findall(r"(?m)^encircle run (\w+)((?: --set \S+)+)$", PAGE)
    assert len(lines) >= 3
    # Those of a trace need its file.
    for name, changes in (line for line in lines if ".file=" not in line[1]):
        assert load(name, changes.split(" --set ")[1:]).channel != load(name).channel


def test_figures_that_follow_from_their_sources_follow():
    """Ranges from link budgets, and losses from how often outages come and how long they last."""

    def loss_rate(outages, round_trips, outage_s):
        share = outages / round_trips * outage_s / 0.1
        return share / (1.0 + share)

    known = {name: profile.channel for name, profile in profiles().items()}
    for name, outages in {
        "wifi-indoor": (13, 8958, 1.57),
        "wifi-moving": (65, 18933, 1.87),
        "4g": (349, 741735, 0.47),
    }.items():
        assert known[name]["loss"]["rate"] == pytest.approx(loss_rate(*outages), rel=0.02)
        assert known[name]["loss"]["burst_s"] == outages[2]
    office, zigbee, lora = (known[name]["loss"] for name in ("wifi-office", "zigbee", "lora"))
    assert office["range_m"] == pytest.approx(10 ** ((20 - 40.2 + 82) / 40.2), rel=0.01)
    assert zigbee["range_m"] == pytest.approx(8 * 10 ** ((85 - 58.5) / 33), rel=0.01)
    assert lora["range_m"] == pytest.approx(1000 * 10 ** ((14 + 123 - 128.95) / 23.2), rel=0.01)
    assert known["zigbee"]["contention"]["packet_s"] == pytest.approx(133 * 8 / 250e3, rel=0.01)
    # 4G: the lognormal of that mean and deviation has the measured median, within 2 %.
    delay = known["4g"]["delay"]
    spread = sqrt(log(1 + (delay["std_s"] / delay["mean_s"]) ** 2))
    assert delay["mean_s"] * exp(-(spread**2) / 2) == pytest.approx(0.119, rel=0.02)


@pytest.mark.parametrize("burst_s", ["long", -1.0, 0.0, float("nan"), float("inf"), [1.0], True])
def test_bursts_that_are_no_length_of_time_are_refused_in_one_line(burst_s):
    tree = {"team": {"robots": 4}, "channel": {"profile": "4g", "loss": {"burst_s": burst_s}}}
    with pytest.raises(ScenarioError) as caught:
        load(tree)
    assert str(caught.value).splitlines()[1:] == [
        f"  channel.loss.burst_s = {burst_s!r}: must be a number above 0, in s"
    ]


def test_what_the_profile_of_lora_advises_against_its_collisions_helps():
    def delivered(*overrides):
        scene = {"team": {"robots": 4}, "ticks_max": 200, "channel": {"profile": "lora"}}
        with pytest.warns(ScenarioRemark):
            result = encircle.run(
                load(scene, ["target.behaviour=still", *overrides]), link="memory"
            ).result
        return result.packets_delivered / result.packets_sent

    together, spread = delivered("robot.publish_every_ticks=10"), delivered("robot.publish=event")
    assert together < 0.02
    assert spread > 0.2
    assert 'Use `robot.publish = "event"`' in profiles()["lora"].fitted
