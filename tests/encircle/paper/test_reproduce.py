"""The reproduction: its facts against independent computations, its statistics, its refusals."""

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
from encircle.paper.claims import ClaimCheck, ClaimStatus, Simulation, solid_finding
from encircle.paper.execution_times import (
    CONFIDENCE_EACH,
    JITTER_M,
    MIDDLE_HALF,
    POLICIES,
    STAR,
    ExecutionTimes,
    estimate,
    jittered,
    rate,
    run_many,
)
from encircle.paper.reproduce import Report, _fastest, _fulfilled, _simulation_4, _table, reproduce
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
    entered, told = [], []

    def progress(name):
        entered.append(name)
        return nullcontext(lambda done, of: told.append((done, of)))

    out = tmp_path_factory.mktemp("reproduce") / "out"
    found = reproduce(out, SEEDS, random_starts=2, x_m=X_M, progress=progress)
    assert entered == [f"simulation {number}" for number in range(1, 6)]
    rates, times = 3 * 2, len(X_M) * 4 * (SEEDS + 1)
    assert [done for done, of in told if done == of] == [rates, times]
    return found


@pytest.fixture(scope="module")
def first():
    """Simulation 1, run anew: positions (T, 5, 2) straight from the world, and its result."""
    arena = build(load("sim1"), load("sim1").seed)
    places, worlds = {}, []

    def keep(world):
        worlds.append(world)
        places[world.state.tick] = world.state.positions

    result = run_in_memory(arena, "again", lambda _line: None, None, keep)
    keep(worlds[-1])
    places[0] = initial(arena).positions
    return np.array([places[tick] for tick in range(len(places))])[:, :5], result


def facts(report, name):
    return report.as_dict()["simulations"][name]


def table(ticks, captured=None, ticks_max=300, farthest_m=1.2):
    """Execution times with starts, policies and seeds as axes."""
    ticks = np.array(ticks)
    captured = ticks < ticks_max if captured is None else np.array(captured)
    far = np.full(ticks.shape, farthest_m)
    return ExecutionTimes(tuple(range(len(ticks))), ticks, captured, far, ticks_max)


def test_simulation_1_is_what_it_is_when_run_anew(report, first):
    places, result = first
    found = facts(report, "sim1")
    robots, target = places[:, :4], places[:, 4]
    assert found["digest"] == result.digest
    assert found["captured"] is result.captured is True
    assert found["capture_tick"] == result.capture_tick == len(places) - 1
    near = [f"r{k + 1}" for k in range(4) if dist(robots[0, k], target[0]) <= 6.0]
    assert found["detecting_at_start"] == near == ["r1"]
    seen = next(t for t in range(len(places)) if dist(robots[t, 2], target[t]) <= 6.0)
    assert found["target_detects_r3_tick"] == seen
    steps = np.diff(target, axis=0)
    headings = [degrees(atan2(y, x)) for x, y in steps.tolist()]
    turn = degrees(remainder(np.radians(headings[seen + 4] - headings[seen - 1]), tau))
    assert found["turn_deg"] == pytest.approx(turn)
    gaps = [
        dist(row[i], row[k]) - 1.0 for row in places.tolist() for i in range(5) for k in range(i)
    ]
    assert found["least_gap_m"] == pytest.approx(min(gaps), abs=1e-12)
    assert min(gaps) >= 0.0


def test_simulation_3_is_simulation_1_until_the_target_is_moved(report, first):
    found = facts(report, "sim3")
    assert found["same_until_moved"] is True
    (event,) = load("sim3").events
    assert found["moved_tick"] == event.tick
    assert found["moved_m"] == pytest.approx(dist(first[0][event.tick - 1, 4], event.position))
    assert event.tick <= found["caught_up_tick"] < found["capture_tick"]


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
    found = facts(report, "sim5")["execution_times"]
    assert found["x_m"] == list(X_M)
    for name in ("xi-0", "xi-star"):
        starts = [list(p) for p in load("sim5").team.positions]
        starts[2][0] = X_M[1]
        exact = run("sim5", link="memory", overrides=_set(name, starts)).result
        noise = ["sensing.noise_m_std=0.02", "seed=2"]
        overrides = [*_set(name, jittered(starts, 2)), *noise]
        paired = run("sim5", link="memory", overrides=overrides).result
        assert found["policies"][name]["exact_ticks"][1] == exact.ticks
        assert found["policies"][name]["ticks"][1][1] == paired.ticks
        assert found["policies"][name]["captured_runs"][1][1] == paired.captured


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
    report = Report(Path("out"), 3, 1.0, (simulation,))
    lines = report.text().splitlines()
    assert lines[-7:-5] == ["    paper claims", "      yes so"]
    assert lines[-5].startswith("       NO not not")
    assert lines[-4].startswith("          not")
    assert lines[-3:] == ["undecided who knows", "          beside", "  table"]
    told = report.as_dict()["simulations"]["sim1"]["findings"]
    assert [one["holds"] for one in told] == ["yes", "no", "undecided", "no claim"]


def test_an_overlap_would_be_reported_as_one():
    found = {"least_gap_m": -0.002, "least_gap_pair": ["r1", "r2"], "least_gap_tick": 7}
    finding = solid_finding({**found, "contact_ticks": {}})
    assert finding.holds is ClaimStatus.NO
    assert "overlapped by 2.000 mm: r1 and r2 at tick 7" in finding.text
    assert (
        solid_finding({**found, "least_gap_m": 0.0, "contact_ticks": {}}).holds
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
    found = rate([True] * 7 + [False] * 3)
    z = stats.norm.ppf(0.975)
    middle = (0.7 + z * z / 20) / (1 + z * z / 10)
    half = z * sqrt(0.7 * 0.3 / 10 + z * z / 400) / (1 + z * z / 10)
    assert (found.captured, found.runs) == (7, 10)
    assert found[2:] == pytest.approx((middle - half, middle + half))


@pytest.mark.parametrize("seeds", [4, 12, 40])
def test_typical_differences_cover_the_truth_together(seeds):
    # Nine starts on common seeds; whole ticks, 3 % that never end in either. Percentiles of the
    # bootstrap would cover 85 % of such at 4 seeds, each for 98.3 %.
    rng = np.random.default_rng(1)
    starts = np.linspace(-0.5, 1.0, 9)[:, None]

    def draw(count):
        change = np.rint(starts + rng.normal(0, 0.7, count) + rng.normal(0, 1.5, (9, count)))
        chance = rng.random((9, count))
        return np.where(chance < 0.03, 264, np.where(chance > 0.97, -264, change))

    truth = stats.trim_mean(draw(100_000), MIDDLE_HALF, axis=None)
    found = [estimate(draw(seeds), MIDDLE_HALF, CONFIDENCE_EACH) for _ in range(250)]
    assert pytest.approx(1 - 0.05 / 3) == CONFIDENCE_EACH
    assert_covers((e.low <= truth <= e.high for e in found), 0.975, 0.997)


def test_seeds_are_resampled_whole():
    # Starts of one seed are alike, so that ten starts tell no more than one.
    alike = np.tile(np.arange(20.0), (10, 1))
    assert estimate(alike, 0.0) == pytest.approx(estimate(alike[0], 0.0))
    assert estimate(alike[0], 0.0).high == pytest.approx(
        stats.ttest_1samp(alike[0], 0.0).confidence_interval().high, rel=0.02
    )


def test_typical_times_do_not_feel_the_few_that_escape():
    ticks = np.arange(30, 50)
    escaped = np.where(ticks == 49, 300, ticks)
    assert estimate(escaped, MIDDLE_HALF).mean == estimate(ticks, MIDDLE_HALF).mean == 39.5
    found = table([[escaped] * 4])
    assert found.mean(0, 0).mean == pytest.approx(ticks.mean() + 251 / 20)
    assert found.mean(0, 0).high > found.mean(0, 0).mean + 20


def test_a_run_that_escapes_comes_after_every_capture():
    ticks = [[[30, 300, 300, 31], [30] * 4, [30] * 4, [31, 300, 40, 31]]]
    captured = [[[True, False, False, True], [True] * 4, [True] * 4, [True, False, True, True]]]
    assert table(ticks, captured).order(0) == (1, 1, 2)
    # A capture at the very last tick is still a capture.
    last = [[[300], [30], [30], [300]]]
    assert table(last, [[[False], [True], [True], [True]]]).order(0) == (1, 0, 0)


def holds(ticks):
    """What is said of the typical and of the mean time."""
    return tuple(finding.holds for finding in _fastest(table(ticks), table(ticks[:, :, :1]))[:2])


def test_a_policy_is_called_fastest_or_not_only_if_intervals_decide():
    noise = np.random.default_rng(3).integers(0, 3, (2, 1, 40))
    ahead = np.array([64, 65, 66, 33])[None, :, None] + noise
    assert holds(ahead) == ("yes", "yes")
    behind = ahead.copy()
    behind[:, 0] = behind[:, STAR] - 30
    assert holds(behind) == ("no", "no")
    level = ahead.copy()
    level[:, 0] = level[:, STAR]
    assert holds(level) == ("undecided", "undecided")
    # Ahead by two ticks: more failures than these seeds show could turn the mean.
    barely = np.array([35, 36, 37, 33])[None, :, None] + noise
    assert holds(barely) == ("yes", "undecided")
    lost = barely.copy()
    lost[0, STAR, 0] = 300
    assert holds(lost) == ("yes", "undecided")


def test_differences_that_are_noise_are_neither_so_nor_not():
    # Of policies that are alike, one of two would be called shorter, and the claim false.
    rng = np.random.default_rng(4)
    found = [holds(rng.integers(30, 40, (3, 4, 40))) for _ in range(60)]
    for kind in zip(*found, strict=True):
        assert kind.count("yes") <= 1
        assert_covers((mark == "no" for mark in kind), 0.0, 0.05)


def test_few_seeds_decide_nothing_however_alike_they_are():
    # Signs that are all alike come by chance once in 2^(seeds - 1), and there are three of them.
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
        reproduce_module, "captures", lambda _runs, _tell: runs | {"near": runs["slow"]}
    )
    monkeypatch.setattr(reproduce_module, "draw_trajectories", lambda _recording, path: path)
    scenario = load("sim4")
    ground_truth = SimpleNamespace(scenario=scenario, captured=True, outcome="captured")
    facts = {"least_gap_m": 0.1, "least_gap_pair": ["r1", "r2"], "least_gap_tick": 1}
    found = _simulation_4(
        tmp_path, None, ground_truth, {**facts, "contact_ticks": {}}, 60, no_progress
    )
    (claim,) = (one for one in found.findings if one.text.startswith("the faster"))
    assert claim.holds == mark


def test_runs_without_capture_are_told_where_they_happened():
    ticks = np.full((2, 4, 5), 32)
    ticks[1, 2, :2] = 300
    found = table(ticks)
    assert found.missed.tolist() == [[0, 0, 0, 0], [0, 0, 2, 0]]
    assert "xi = 0 10, xi = 1 10, xi = 3 8, xi* 10" in _fulfilled(found)
    assert "of 2 without capture 2 end with the target surrounded" in _fulfilled(found)
    assert table(ticks, farthest_m=9.0).surrounded == 0
    assert "surrounded" not in _fulfilled(table(np.full((1, 4, 2), 32)))
    rows = [line for line in _table(found) if line.endswith("]") or "(" in line]
    assert [row.count("(2)") for row in rows if row.strip().startswith(("0.0", "1.0"))] == [0, 1]


def test_many_runs_come_back_in_their_order():
    jobs = [{"team": {"robots": 2}, "ticks_max": n, "seed": 1} for n in (3, 1, 2)]
    assert [outcome.ticks for outcome in run_many(jobs)] == [3, 1, 2]


def test_the_policies_are_known_strategies():
    for name in POLICIES:
        assert load("sim5", [f"team.strategy={name}"]).team.strategy == name
    assert list(POLICIES)[STAR] == "xi-star"
    assert load("sim1").target.step_m_max == times_module.SLOW_STEP_M
