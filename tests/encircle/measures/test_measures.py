"""The table of measures: complete, in step with its documentation, sound on whatever log."""

from math import isnan

import numpy as np
import pytest
from helpers_measures import random_log, standing
from helpers_paths import DOCS
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.measures.registry import MEASURES, ROBOT_MEASURES, measure, measure_named
from encircle.runlog.ground_truth import ground_truth_of, points_shared
from encircle.runlog.recorded_log import log_of_recording
from encircle.runlog.runlog import RunLogCollector
from encircle.runner.hunts import run
from encircle.runner.memory import run_in_memory
from encircle.world.arena.engine import build
from encircle.world.arena.sensing import geometry
from encircle.world.loading.load import load
from encircle.world.recording.recording import read_recording

CHEAP = settings(max_examples=80, deadline=None, derandomize=True)
DOCUMENTATION = DOCS / "measures.md"
SHARES = [name for name in MEASURES if name.endswith(("_share", "_ratio"))]


def test_the_documentation_lists_every_measure_with_its_unit_and_no_other():
    text = DOCUMENTATION.read_text(encoding="utf-8")
    of_team, of_each = text.split("## Of each robot\n")
    assert rows_of(of_team) == [(name, measure_named(name).unit) for name in MEASURES]
    below = of_team[of_team.rindex("| `") :]
    assert [name for name in MEASURES if f"`{name}`" not in below] == []
    assert rows_of(of_each) == [(name, measure_named(f"{name}/r1").unit) for name in ROBOT_MEASURES]


def rows_of(page):
    """Name and unit of each row of a page's table of measures."""
    rows = [line.split("|") for line in page.splitlines() if line.startswith("| `")]
    return [(row[1].strip(" `"), row[2].strip()) for row in rows]


def test_every_measure_says_what_it_is_in_one_line():
    for name in MEASURES:
        shown = measure_named(name)
        assert shown.name == name
        assert shown.function.unit == shown.unit
        assert shown.description.endswith(".")
        assert "\n" not in shown.description


def test_all_measures_by_default_and_those_asked_for_in_their_order():
    log = standing(5)
    assert list(measure(log)) == list(MEASURES)
    asked = measure(log, ["ring_s", "captured"])
    assert asked == {"ring_s": 0.0, "captured": 0.0}
    assert list(asked) == ["ring_s", "captured"]
    assert measure(log, []) == {}


def test_an_unknown_measure_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"'happiness'.*unknown.*captured, capture_tick") as caught:
        measure(standing(1), ["captured", "happiness"])
    assert "'captured'" not in str(caught.value)


@pytest.mark.parametrize(("ticks", "robots"), [(0, 4), (0, 1), (1, 1), (1, 4), (3, 2)])
def test_short_runs_and_small_teams_give_numbers_or_nan_and_no_warning(ticks, robots):
    found = measure(standing(ticks, robots))
    assert all(type(value) is float for value in found.values())
    if ticks == 0:
        assert isnan(found["age_ticks_mean"])
        assert isnan(found["sent_bytes_per_s"])
        assert found["path_m_total"] == 0.0


@CHEAP
@given(st.integers(0, 12), st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_what_must_hold_of_any_log(ticks, robots, seed):
    log = random_log(ticks, robots, seed)
    arrays = {name: value for name, value in vars(log).items() if isinstance(value, np.ndarray)}
    before = {name: value.copy() for name, value in arrays.items()}
    found = measure(log)
    assert all(
        np.array_equal(before[n], a, equal_nan=a.dtype.kind == "f") for n, a in arrays.items()
    )
    again = random_log(ticks, robots, seed)
    for name in reversed(list(MEASURES)):
        assert measure(again, [name])[name] == pytest.approx(found[name], abs=0.0, nan_ok=True)
    # A comparison with NaN is false; what must hold is that none of these is broken.
    assert not [n for n in SHARES if found[n] < 0.0 or found[n] > 1.0]
    assert not found["age_ticks_mean"] < 1.0
    assert not found["age_ticks_p95"] > found["age_ticks_max"]
    assert not found["age_ticks_max"] > ticks
    assert not found["delay_ticks_mean"] < 1.0
    assert not found["regret_m_mean"] < 0.0
    assert not found["nees_mean"] < 0.0
    assert not found["peer_error_m_rms"] < found["peer_error_m_mean"] - 1e-9
    assert not found["separation_robots_m_min"] < found["separation_m_min"]
    assert found["collisions"] <= found["contacts"]
    assert 2 * np.pi / robots - 1e-9 <= found["gap_rad_mean"] <= 2 * np.pi + 1e-9
    assert found["path_m_total"] == pytest.approx(robots * found["path_m_mean"])
    assert isnan(found["capture_tick"]) == (found["captured"] == 0.0)
    assert isnan(found["regret_m_mean"]) == (not found["regret_defined_share"] > 0.0)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    out = tmp_path_factory.mktemp("recorded") / "run"
    changes = [
        "channel.loss={model='bernoulli', rate=0.4}",
        "channel.delay={model='gamma', mean_s=0.3, std_s=0.3}",
        "sensing.noise_m_std=0.05",
        "robot.measurement_m_std=0.05",
    ]
    hunt = run("sim2", link="memory", out=out, overrides=changes, seed=6)
    return hunt, read_recording(out)


def test_measures_of_a_run_agree_with_its_result_and_its_tracks(recorded):
    hunt, recording = recorded
    found, result, ground_truth = (
        measure(log_of_recording(recording)),
        hunt.result,
        ground_truth_of(recording),
    )
    assert found["captured"] == float(result.captured)
    assert found["capture_tick"] == result.capture_tick
    lost = sum(result.packets_lost.values())
    assert found["delivery_ratio"] == pytest.approx(1 - lost / result.packets_sent)
    assert found["messages_sent"] * (len(hunt.scenario.ids) - 1) == result.packets_sent
    assert found["contacts"] == result.contacts
    assert found["separation_m_min"] == pytest.approx(ground_truth.least_gap()[0], abs=1e-12)
    assert found["separation_robots_m_min"] == pytest.approx(ground_truth.gaps[:, :3, :3].min())
    shared, ticks = points_shared(recording)
    assert found["conflict_share"] == pytest.approx(shared / ticks)
    assert found["ring_tick"] <= found["capture_tick"]
    assert found["gap_rad_final"] < np.pi


def test_a_nearest_gap_is_that_of_the_worlds_own_geometry(recorded):
    hunt, recording = recorded
    log, arena = log_of_recording(recording), ground_truth_of(recording).arena
    fixed = [obstacle.position for obstacle in hunt.scenario.obstacles]
    gaps = [geometry(np.array([*row, *fixed]), arena.radii, 4).gaps for row in log.positions]
    assert measure(log, ["separation_m_min"])["separation_m_min"] == pytest.approx(np.min(gaps))


def test_more_loss_means_older_information_and_worse_beliefs():
    # Paired by seed: a packet lost at 20 % is lost at 60 % too. Means over five seeds.
    rows = []
    for rate in (0.0, 0.2, 0.6):
        changes = [f"channel.loss={{model='bernoulli', rate={rate}}}", "sensing.noise_m_std=0.05"]
        scenario, found = load("sim1", changes), []
        for seed in range(5):
            collector = RunLogCollector()
            run_in_memory(build(scenario, seed), "loss", lambda line: None, observer=collector)
            found.append(measure(collector.log()))
        rows.append({name: np.mean([f[name] for f in found]) for name in MEASURES})
    for name in ("age_ticks_mean", "age_ticks_max", "peer_error_m_rms", "peer_missing_share"):
        assert rows[0][name] < rows[1][name] < rows[2][name], name
    assert [row["delivery_ratio"] for row in rows] == pytest.approx([1.0, 0.8, 0.4], abs=0.05)
    assert rows[0]["age_ticks_mean"] == 1.0
