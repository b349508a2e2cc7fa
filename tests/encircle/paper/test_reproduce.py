"""The reproduction: its facts against independent computations, its statistics, its errors."""

import json
from contextlib import nullcontext
from math import atan2, degrees, dist, remainder, sqrt, tau
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers_intervals import assert_covers
from scipy import stats

from encircle.paper import execution_times as times_module
from encircle.paper import reproduce as reproduce_module
from encircle.paper.claims import ClaimCheck, ClaimStatus, Simulation, check_no_overlap
from encircle.paper.execution_times import (
    CONFIDENCE_EACH,
    JITTER_M,
    POLICIES,
    TRIMMED_SHARE,
    XI_STAR,
    ExecutionTimes,
    capture_count,
    jittered,
    run_many,
    trimmed_mean_interval,
)
from encircle.paper.reproduce import (
    PaperReport,
    _captures_text,
    _check_fastest,
    _check_simulation_4,
    _table,
    reproduce,
)
from encircle.progress import no_progress
from encircle.runner.hunts import run
from encircle.runner.memory import run_in_memory
from encircle.world.arena.engine import build, initial
from encircle.world.loading.load import load
from encircle.world.recording.run_directory import RunDirectoryError

X_M = (9.0, 12.0)
SEEDS = 2


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    entered, reported = [], []

    def progress(name):
        entered.append(name)
        return nullcontext(lambda done, of: reported.append((done, of)))

    out = tmp_path_factory.mktemp("reproduce") / "out"
    result = reproduce(out, SEEDS, random_starts=2, x_m=X_M, progress=progress)
    assert entered == [f"simulation {number}" for number in range(1, 6)]
    rates, times = 3 * 2, len(X_M) * 4 * (SEEDS + 1)
    assert [done for done, of in reported if done == of] == [rates, times]
    return result


@pytest.fixture(scope="module")
def first():
    """Simulation 1, run again: positions (T, 5, 2) directly from the world, and its result."""
    arena = build(load("sim1"), load("sim1").seed)
    positions_of, worlds = {}, []

    def keep(world):
        worlds.append(world)
        positions_of[world.state.tick] = world.state.positions

    result = run_in_memory(arena, "again", lambda _line: None, None, keep)
    keep(worlds[-1])
    positions_of[0] = initial(arena).positions
    return np.array([positions_of[tick] for tick in range(len(positions_of))])[:, :5], result


def facts(report, name):
    return report.as_dict()["simulations"][name]


def table(ticks, captured=None, ticks_max=300, farthest_m=1.2):
    """Execution times with axes start, policy and seed."""
    ticks = np.array(ticks)
    captured = ticks < ticks_max if captured is None else np.array(captured)
    far = np.full(ticks.shape, farthest_m)
    return ExecutionTimes(tuple(range(len(ticks))), ticks, captured, far, ticks_max)


def test_simulation_1_is_what_it_is_when_run_anew(report, first):
    positions_of, result = first
    values = facts(report, "sim1")
    robots, target = positions_of[:, :4], positions_of[:, 4]
    assert values["digest"] == result.digest
    assert values["captured"] is result.captured is True
    assert values["capture_tick"] == result.capture_tick == len(positions_of) - 1
    near = [f"r{k + 1}" for k in range(4) if dist(robots[0, k], target[0]) <= 6.0]
    assert values["detecting_at_start"] == near == ["r1"]
    seen = next(t for t in range(len(positions_of)) if dist(robots[t, 2], target[t]) <= 6.0)
    assert values["target_detects_r3_tick"] == seen
    steps = np.diff(target, axis=0)
    headings = [degrees(atan2(y, x)) for x, y in steps.tolist()]
    turn = degrees(remainder(np.radians(headings[seen + 4] - headings[seen - 1]), tau))
    assert values["turn_deg"] == pytest.approx(turn)
    gaps = [
        dist(row[i], row[k]) - 1.0
        for row in positions_of.tolist()
        for i in range(5)
        for k in range(i)
    ]
    assert values["least_gap_m"] == pytest.approx(min(gaps), abs=1e-12)
    assert min(gaps) >= 0.0


def test_simulation_3_is_simulation_1_until_the_target_is_moved(report, first):
    result = facts(report, "sim3")
    assert result["same_until_moved"] is True
    (event,) = load("sim3").events
    assert result["moved_tick"] == event.tick
    assert result["moved_m"] == pytest.approx(dist(first[0][event.tick - 1, 4], event.position))
    assert event.tick <= result["caught_up_tick"] < result["capture_tick"]


def test_simulation_4_counts_captures_of_the_runs_it_names(report):
    rates = facts(report, "sim4")["capture_rates"]
    captured = [
        run({"team": {"robots": 4}, "ticks_max": 300}, link="memory", seed=seed).captured
        for seed in (1, 2)
    ]
    assert rates["slow"]["captured"] == sum(captured)
    shown = facts(report, "sim4")["slow_minus_fast"]
    assert shown["value"] == (rates["slow"]["captured"] - rates["fast"]["captured"]) / 2
    assert {r["runs"] for r in rates.values()} == {2}


def test_simulation_5_holds_the_runs_it_names(report):
    result = facts(report, "sim5")["execution_times"]
    assert result["x_m"] == list(X_M)
    for name in ("xi-0", "xi-star"):
        starts = [list(p) for p in load("sim5").team.positions]
        starts[2][0] = X_M[1]
        exact = run("sim5", link="memory", overrides=_set(name, starts)).result
        noise = ["sensing.noise_m_std=0.02", "seed=2"]
        overrides = [*_set(name, jittered(starts, 2)), *noise]
        paired = run("sim5", link="memory", overrides=overrides).result
        assert result["policies"][name]["exact_ticks"][1] == exact.ticks
        assert result["policies"][name]["ticks"][1][1] == paired.ticks
        assert result["policies"][name]["captured_runs"][1][1] == paired.captured


def _set(policy, starts):
    return [f"team.strategy={policy}", f"team.positions={starts}"]


def test_the_report_is_saved_as_text_and_json_with_its_figures(report):
    text = (report.out / "report.txt").read_text(encoding="utf-8")
    assert text == report.text() + "\n"
    assert max(len(line) for line in text.splitlines()) <= 100
    saved = json.loads((report.out / "report.json").read_text(encoding="utf-8"))
    assert saved == json.loads(json.dumps(report.as_dict()))
    for number in (3, 4, 5, 6, 7):
        assert (report.out / f"fig{number}.png").stat().st_size > 20_000
    for number in (1, 2, 3, 4, 5):
        assert (report.out / f"sim{number}" / "recording.mcap").exists()
        assert f"Simulation {number}:" in text


def test_a_directory_that_is_not_empty_is_refused_and_left_alone(tmp_path):
    (tmp_path / "precious").write_text("mine")
    with pytest.raises(RunDirectoryError, match="not empty"):
        reproduce(tmp_path, SEEDS)
    assert [p.name for p in tmp_path.iterdir()] == ["precious"]


def test_text_marks_what_holds_and_what_does_not():
    findings = (
        ClaimCheck(ClaimStatus.YES, "so"),
        ClaimCheck(ClaimStatus.NO, "not " * 40),
        ClaimCheck(ClaimStatus.UNDECIDED, "who knows"),
        ClaimCheck(ClaimStatus.NO_CLAIM, "beside"),
    )
    simulation = Simulation("sim1", "claims", Path("f.png"), findings, {"title": "One"}, ("table",))
    report = PaperReport(Path("out"), 3, 1.0, (simulation,))
    lines = report.text().splitlines()
    assert lines[-7:-5] == ["    paper claims", "      yes so"]
    assert lines[-5].startswith("       NO not not")
    assert lines[-4].startswith("          not")
    assert lines[-3:] == ["undecided who knows", "          beside", "  table"]
    reported = report.as_dict()["simulations"]["sim1"]["findings"]
    assert [one["holds"] for one in reported] == ["yes", "no", "undecided", "no claim"]


def test_an_overlap_would_be_reported_as_one():
    result = {"least_gap_m": -0.002, "least_gap_pair": ["r1", "r2"], "least_gap_tick": 7}
    finding = check_no_overlap({**result, "contact_ticks": {}})
    assert finding.holds is ClaimStatus.NO
    assert "overlapped by 2.000 mm: r1 and r2 at tick 7" in finding.text
    assert (
        check_no_overlap({**result, "least_gap_m": 0.0, "contact_ticks": {}}).holds
        is ClaimStatus.NO_CLAIM
    )


def test_jitter_is_bounded_paired_and_different_for_every_seed():
    starts = [[0.0, 5.0], [3.0, -4.0]]
    moved = [jittered(starts, seed) for seed in range(1, 20)]
    assert moved[4] == jittered(starts, 5)
    assert len({str(m) for m in moved}) == 19
    off = np.array(moved) - starts
    assert 0.9 * JITTER_M < np.abs(off).max() <= JITTER_M
    elsewhere = np.array(jittered([[0.0, 5.0], [9.0, -4.0]], 5))
    np.testing.assert_allclose(elsewhere - [[0.0, 5.0], [9.0, -4.0]], off[4], atol=2e-6)


def test_rates_have_wilsons_interval():
    result = capture_count([True] * 7 + [False] * 3)
    z = stats.norm.ppf(0.975)
    middle = (0.7 + z * z / 20) / (1 + z * z / 10)
    half = z * sqrt(0.7 * 0.3 / 10 + z * z / 400) / (1 + z * z / 10)
    assert (result.captured, result.runs) == (7, 10)
    assert result[2:] == pytest.approx((middle - half, middle + half))


@pytest.mark.parametrize("seeds", [4, 12, 40])
def test_typical_differences_cover_the_truth_together(seeds):

    # Nine starts on common seeds, in whole ticks; 3 % of the runs never end, in both policies. With
    # 4 seeds a percentile bootstrap for 98.3 % would cover 85 %.
    rng = np.random.default_rng(1)
    starts = np.linspace(-0.5, 1.0, 9)[:, None]

    def draw(count):
        change = np.rint(starts + rng.normal(0, 0.7, count) + rng.normal(0, 1.5, (9, count)))
        chance = rng.random((9, count))
        return np.where(chance < 0.03, 264, np.where(chance > 0.97, -264, change))

    truth = stats.trim_mean(draw(100_000), TRIMMED_SHARE, axis=None)
    result = [
        trimmed_mean_interval(draw(seeds), TRIMMED_SHARE, CONFIDENCE_EACH) for _ in range(250)
    ]
    assert pytest.approx(1 - 0.05 / 3) == CONFIDENCE_EACH
    assert_covers((e.low <= truth <= e.high for e in result), 0.975, 0.997)


def test_seeds_are_resampled_whole():
    # All starts of one seed are equal, so ten starts hold no more information than one.
    alike = np.tile(np.arange(20.0), (10, 1))
    assert trimmed_mean_interval(alike, 0.0) == pytest.approx(trimmed_mean_interval(alike[0], 0.0))
    assert trimmed_mean_interval(alike[0], 0.0).high == pytest.approx(
        stats.ttest_1samp(alike[0], 0.0).confidence_interval().high, rel=0.02
    )


def test_typical_times_do_not_feel_the_few_that_escape():
    ticks = np.arange(30, 50)
    escaped = np.where(ticks == 49, 300, ticks)
    assert (
        trimmed_mean_interval(escaped, TRIMMED_SHARE).mean
        == trimmed_mean_interval(ticks, TRIMMED_SHARE).mean
        == 39.5
    )
    result = table([[escaped] * 4])
    assert result.mean(0, 0).mean == pytest.approx(ticks.mean() + 251 / 20)
    assert result.mean(0, 0).high > result.mean(0, 0).mean + 20


def test_a_run_that_escapes_comes_after_every_capture():
    ticks = [[[30, 300, 300, 31], [30] * 4, [30] * 4, [31, 300, 40, 31]]]
    captured = [[[True, False, False, True], [True] * 4, [True] * 4, [True, False, True, True]]]
    assert table(ticks, captured).order(0) == (1, 1, 2)
    # A capture at the last tick counts as a capture.
    last = [[[300], [30], [30], [300]]]
    assert table(last, [[[False], [True], [True], [True]]]).order(0) == (1, 0, 0)


def holds(ticks):
    """Status of the claims on the typical and on the mean time."""
    return tuple(
        finding.holds for finding in _check_fastest(table(ticks), table(ticks[:, :, :1]))[:2]
    )


def test_a_policy_is_called_fastest_or_not_only_if_intervals_decide():
    noise = np.random.default_rng(3).integers(0, 3, (2, 1, 40))
    ahead = np.array([64, 65, 66, 33])[None, :, None] + noise
    assert holds(ahead) == ("yes", "yes")
    behind = ahead.copy()
    behind[:, 0] = behind[:, XI_STAR] - 30
    assert holds(behind) == ("no", "no")
    level = ahead.copy()
    level[:, 0] = level[:, XI_STAR]
    assert holds(level) == ("undecided", "undecided")
    # Faster by two ticks: failures that these seeds do not show could reverse the mean.
    barely = np.array([35, 36, 37, 33])[None, :, None] + noise
    assert holds(barely) == ("yes", "undecided")
    lost = barely.copy()
    lost[0, XI_STAR, 0] = 300
    assert holds(lost) == ("yes", "undecided")


def test_differences_that_are_noise_are_neither_so_nor_not():
    # Without intervals one of two equal policies would be called faster, and the claim false.
    rng = np.random.default_rng(4)
    result = [holds(rng.integers(30, 40, (3, 4, 40))) for _ in range(60)]
    for kind in zip(*result, strict=True):
        assert kind.count("yes") <= 1
        assert_covers((mark == "no" for mark in kind), 0.0, 0.05)


def test_few_seeds_decide_nothing_however_alike_they_are():
    # By chance all signs are equal once in 2^(seeds - 1) studies, for each of three comparisons.
    ahead = np.tile(np.array([64, 65, 66, 33])[None, :, None], (2, 1, 8))
    assert holds(ahead[:, :, :6])[0] == "undecided"
    assert holds(ahead)[0] == "yes"


@pytest.mark.parametrize(
    ("fast", "slow", "mark"),
    [
        ((0, 60), (20, 40), "yes"),
        ((0, 6), (4, 2), "undecided"),
        ((20, 40), (20, 40), "undecided"),
        ((40, 20), (0, 60), "no"),
    ],
)
def test_the_faster_target_escapes_more_often_only_if_the_interval_says_so(
    monkeypatch, tmp_path, fast, slow, mark
):
    runs = {
        name: np.repeat([True, False], counts) for name, counts in (("fast", fast), ("slow", slow))
    }
    monkeypatch.setattr(
        reproduce_module, "measure_captures", lambda _runs, _tell: runs | {"near": runs["slow"]}
    )
    monkeypatch.setattr(reproduce_module, "draw_trajectories", lambda _recording, path: path)
    scenario = load("sim4")
    ground_truth = SimpleNamespace(scenario=scenario, captured=True, outcome="captured")
    facts = {"least_gap_m": 0.1, "least_gap_pair": ["r1", "r2"], "least_gap_tick": 1}
    result = _check_simulation_4(
        tmp_path, None, ground_truth, {**facts, "contact_ticks": {}}, 60, no_progress
    )
    (claim,) = (one for one in result.checks if one.text.startswith("the faster"))
    assert claim.holds == mark


def test_runs_without_capture_are_told_where_they_happened():
    ticks = np.full((2, 4, 5), 32)
    ticks[1, 2, :2] = 300
    result = table(ticks)
    assert result.missed.tolist() == [[0, 0, 0, 0], [0, 0, 2, 0]]
    assert "xi = 0 10, xi = 1 10, xi = 3 8, xi* 10" in _captures_text(result)
    assert "of 2 without capture 2 end with the target surrounded" in _captures_text(result)
    assert table(ticks, farthest_m=9.0).surrounded_count == 0
    assert "surrounded" not in _captures_text(table(np.full((1, 4, 2), 32)))
    rows = [line for line in _table(result) if line.endswith("]") or "(" in line]
    assert [row.count("(2)") for row in rows if row.strip().startswith(("0.0", "1.0"))] == [0, 1]


def test_many_runs_come_back_in_their_order():
    jobs = [{"team": {"robots": 2}, "ticks_max": n, "seed": 1} for n in (3, 1, 2)]
    assert [outcome.ticks for outcome in run_many(jobs)] == [3, 1, 2]


def test_the_policies_are_known_strategies():
    for name in POLICIES:
        assert load("sim5", [f"team.strategy={name}"]).team.strategy == name
    assert list(POLICIES)[XI_STAR] == "xi-star"
    assert load("sim1").target.step_m_max == times_module.SLOW_STEP_M
