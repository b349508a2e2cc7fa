"""Mean delays as they come out at ticks: tail sums of scipy's laws, runs, and what runs say.

The time of a packet with delay D is N = max(1, ceil(D / h)) ticks, and E[N] is the sum over
k = 0, 1, ... of P(N > k), of which the first is 1 and the others are P(D > k h).
"""

import json
import re
from math import inf, log, sqrt

import numpy as np
import pytest
from helpers_channel import ALPHA, tables
from helpers_paths import DOCS
from helpers_waiting import TIMEOUTS
from helpers_world import small
from scipy import stats

from encircle.cli.hunting import HuntRequest, hunt_and_draw
from encircle.measures.registry import measure
from encircle.runlog.runlog import RunLogCollector
from encircle.runner.hunts import run
from encircle.runner.memory import run_in_memory
from encircle.world.arena.engine import build
from encircle.world.channel.delay_means import (
    RequestedDelay,
    delivered_s_mean,
    mean_s,
    requested_delay,
)
from encircle.world.coordinator.result import GO_ON
from encircle.world.scenario.delay_models import DELAY_MODELS, TraceDelay

TICK_S = 0.1
FAR = [[90.0, 0.0], [0.0, 90.0], [-90.0, 0.0], [0.0, -90.0], [70.0, 70.0]]
WIDTH = sqrt(log(1.0 + 4.0**2))
LAWS = {
    "constant": ("mean_s=0.05", None, 0.05),
    "constant-longer": ("mean_s=0.12", None, 0.12),
    "constant-none": ("mean_s=0.0", None, 0.0),
    "uniform": ("low_s=0.02, high_s=0.31", stats.uniform(0.02, 0.29), 0.165),
    "gamma": ("mean_s=0.06, std_s=0.09", stats.gamma(4 / 9, scale=0.135), 0.06),
    "lognormal": (
        "mean_s=0.05, std_s=0.2",
        stats.lognorm(WIDTH, scale=0.05 * np.exp(-(WIDTH**2) / 2)),
        0.05,
    ),
    "normal": (
        "mean_s=0.05, std_s=0.1",
        stats.truncnorm(-0.5, inf, loc=0.05, scale=0.1),
        stats.truncnorm(-0.5, inf, loc=0.05, scale=0.1).mean(),
    ),
    "exponential": ("mean_s=0.05", stats.expon(scale=0.05), 0.05),
}


def delay_of(name):
    keys, law, mean = LAWS[name]
    settings = dict(pair.split("=") for pair in keys.split(", "))
    model_name = name.partition("-")[0]
    model = DELAY_MODELS[model_name](model=model_name, **settings)
    return model, law, mean


def moments_ticks(model, law):
    """Mean and standard deviation of the whole ticks that a packet takes, by its tail."""
    if law is None:
        return float(max(1, np.ceil(model.mean_s / TICK_S))), 0.0
    k = np.arange(1, 100_000)
    tail = law.sf(k * TICK_S)
    mean = 1.0 + tail.sum()
    return mean, sqrt(1.0 + ((2 * k + 1) * tail).sum() - mean**2)


def hunt_of(model, ticks):
    table = ", ".join(
        f"{key}={value!r}" for key, value in model.model_dump(exclude_unset=True).items()
    )
    settings = [f"channel.delay={{{table}}}", f"ticks_max={ticks}"]
    return run({"team": {"positions": FAR}}, link="memory", overrides=settings)


@pytest.mark.parametrize("name", LAWS)
def test_the_mean_delivered_is_the_sum_of_the_laws_tail(name):
    model, law, mean = delay_of(name)
    assert mean_s(model) == pytest.approx(mean, rel=1e-9)
    expected_s = TICK_S * moments_ticks(model, law)[0]
    assert delivered_s_mean(model, TICK_S) == pytest.approx(expected_s, rel=1e-9)
    assert max(mean, TICK_S) - 1e-12 <= expected_s <= mean + TICK_S


@pytest.mark.parametrize("name", LAWS)
def test_runs_deliver_and_tell_the_mean_that_the_law_gives(name):
    model, law, mean = delay_of(name)
    ticks = 100
    result = hunt_of(model, ticks).result
    assert (result.delay_model, result.delay_s_mean_asked) == (model.model, pytest.approx(mean))
    packets = ticks * len(FAR) * (len(FAR) - 1)
    assert result.packets_sent == packets
    expected, std = moments_ticks(model, law)
    bound = stats.norm.isf(ALPHA / 2) * std / sqrt(packets)
    assert abs(result.delay_s_mean / TICK_S - expected) <= bound + 1e-9


@pytest.mark.parametrize("mode", ["repeat", "shifted", "resample"])
def test_a_trace_delivers_the_mean_of_its_rows_in_whole_ticks(mode):
    model = TraceDelay(model="trace", mode=mode, values=(0.05, 0.12, None, 0.3, 0.31, 0.0))
    met = [0.05, 0.12, 0.12, 0.3, 0.31, 0.0] if mode != "resample" else [0.05, 0.12, 0.3, 0.31, 0]
    whole = [1, 2, 2, 3, 4, 1] if mode != "resample" else [1, 2, 3, 4, 1]
    assert mean_s(model) == pytest.approx(np.mean(met))
    assert delivered_s_mean(model, TICK_S) == pytest.approx(TICK_S * np.mean(whole))
    tree = {"team": {"positions": FAR}, "channel": {"delay": model.model_dump(exclude_unset=True)}}
    result = run(tree, link="memory", overrides=["ticks_max=60"]).result
    bound = stats.norm.isf(ALPHA / 2) * np.std(whole) / sqrt(60 * 20)
    exact = mode != "resample"  # 60 ticks are ten rounds of the trace
    assert abs(result.delay_s_mean / TICK_S - np.mean(whole)) <= (1e-9 if exact else bound)


def test_what_is_asked_is_the_mean_over_links_whatever_each_is_given_by():
    links = [
        "{sender='r1', delay={model='gamma', mean_s=0.5, std_s=0.1}}",
        "{sender='r2', receiver='r1', delay={model='trace', values=[0.2, 0.6]}}",
    ]
    scenario = small(
        "channel.delay={model='exponential', mean_s=0.1}", f"channel.links=[{', '.join(links)}]"
    )
    found = requested_delay(scenario.channel, scenario.ids)
    assert found == RequestedDelay(
        "exponential and gamma and trace", pytest.approx((8 * 0.1 + 3 * 0.5 + 0.4) / 12)
    )
    lone = small("channel.delay.mean_s=0.3", team={"robots": 1})
    assert requested_delay(lone.channel, lone.ids) == RequestedDelay("constant", 0.3)


@pytest.mark.parametrize(
    "stages",
    [
        {"delay": "model='exponential', mean_s=0.3", "copies": 0.5, "order": "kept"},
        {"delay": "model='normal', mean_s=0.2, std_s=0.2", "loss": "model='bernoulli', rate=0.4"},
        {"delay": "model='constant', mean_s=0.07", "limit": "packets_per_s=8, queue_packets_max=2"},
        {"loss": "model='bernoulli', rate=1.0"},
    ],
)
def test_a_run_tells_the_delay_that_measures_find_in_its_log(stages):
    scenario = small(*tables(**stages), "ticks_max=40", team={"positions": FAR})
    collector = RunLogCollector()
    result = run_in_memory(build(scenario, 3), "told", print, observer=collector)
    measured = measure(collector.log(), ["delay_s_mean"])["delay_s_mean"]
    if np.isnan(measured):
        assert result.delay_s_mean is None
    else:
        assert result.delay_s_mean == pytest.approx(measured)


def test_a_run_shows_the_delay_that_came_of_it_beside_the_one_asked_for(tmp_path, capsys):
    changes = ["channel.delay.mean_s=0.05", "ticks_max=5"]
    how = (None, "memory", GO_ON, TIMEOUTS)
    wishes = [HuntRequest("sim1", changes, tmp_path / name, *how) for name in "ab"]
    hunt_and_draw(wishes[0], as_json=False)
    shown = " ".join(capsys.readouterr().out.split())
    assert "packets' delay │ 0.1 s on average; asked for: 0.05 s (constant)" in shown
    hunt_and_draw(wishes[1], as_json=True)
    told = json.loads(capsys.readouterr().out)
    for found in (told, json.loads((tmp_path / "b" / "summary.json").read_text())):
        assert found["delay_model"] == "constant"
        assert found["delay_s_mean_asked"] == 0.05
        assert found["delay_s_mean"] == pytest.approx(0.1)


def test_the_table_in_the_documentation_is_what_its_command_prints(capsys):
    text = (DOCS / "radio.md").read_text(encoding="utf-8")
    (code,) = re.findall(
        r"```python\n(from encircle\.world\.channel\.delay_means.*?)```", text, re.DOTALL
    )
    exec(compile(code, "docs/radio.md", "exec"), {})
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 8
    for line in printed:
        assert any(row.startswith(line) for row in text.splitlines()), line
