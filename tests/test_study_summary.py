import csv
from contextlib import closing

import numpy as np
import pytest
from helpers_studies import ARMS, DELAY, LOSS, filled, loss_only, never, study_plan
from scipy import stats

from encircle.studies.plan import STRATEGY
from encircle.studies.sentences import findings, where_text
from encircle.studies.summary import baseline_of, rows_along, summarise

TWO = {"axes": [LOSS], "strategies": ["xi-star", "xi-0"], "seeds": 60}


def summed(tmp_path, truth=loss_only, **changes):
    plan = study_plan(**changes)
    with closing(filled(plan, tmp_path / "t", truth)) as table:
        frame = table.read().to_pandas()
        return plan, frame, summarise(plan, table)


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    return summed(tmp_path_factory.mktemp("two"), **TWO)


def test_every_cell_is_summed_up_by_itself(two):
    plan, frame, summary = two
    for cell in summary.cells:
        rows = frame[frame.cell == cell.cell]
        assert cell.runs == len(rows) == 60
        assert cell.levels == plan.levels(cell.cell)
        assert cell.rate.value == rows.captured.mean()
        wilson = stats.binomtest(int(rows.captured.sum()), 60).proportion_ci(method="wilson")
        assert cell.rate[1:] == pytest.approx((wilson.low, wilson.high))
        assert cell.time_s.value == pytest.approx((rows.ticks * 0.1).mean())
        assert cell.limit_s == 30.0
        assert cell.means["age_ticks_mean"].value == pytest.approx(rows.age_ticks_mean.mean())


def test_levels_are_compared_with_the_baseline_on_common_seeds(two):
    _, frame, summary = two
    assert [(c.level, c.baseline, c.others["loss"]) for c in summary.comparisons] == [
        ("xi-0", "xi-star", rate) for rate in LOSS["values"]
    ]
    for one in summary.comparisons:
        here = frame[frame.loss == one.others["loss"]]
        a, b = (here[here.strategy == s].set_index("seed") for s in ("xi-star", "xi-0"))
        assert one.rate.mean.value == pytest.approx(b.captured.mean() - a.captured.mean())
        change = (b.ticks - a.ticks) * 0.1
        assert one.time_s.mean.value == pytest.approx(change.mean())
        assert one.time_s.effect.value == pytest.approx(change.mean() / change.std())
        assert one.time_s.pairs == 60


def test_the_log_rank_test_takes_all_times_censored_ones_too(two):
    _, frame, summary = two
    for one in summary.comparisons:
        here = frame[frame.loss == one.others["loss"]]
        a, b = (
            stats.CensoredData.right_censored(rows.ticks, rows.captured < 0.5)
            for rows in (here[here.strategy == s] for s in ("xi-star", "xi-0"))
        )
        assert one.logrank_p == pytest.approx(stats.logrank(a, b).pvalue)
    assert min(one.logrank_p for one in summary.comparisons) < 0.05


def test_another_baseline_turns_the_signs_round(tmp_path, two):
    _, _, turned = summed(tmp_path, **TWO, compare=STRATEGY, baseline="xi-0")
    for a, b in zip(two[2].comparisons, turned.comparisons, strict=True):
        assert b.time_s.mean.value == pytest.approx(-a.time_s.mean.value)
        assert b.rate.mean.value == pytest.approx(-a.rate.mean.value)


def test_overall_settings_are_averaged_within_each_seed(two):
    _, frame, summary = two
    (overall,) = summary.overall
    by_seed = frame.pivot_table(index="seed", columns="strategy", values="ticks") * 0.1
    change = by_seed["xi-0"] - by_seed["xi-star"]
    assert overall.time_s.mean.value == pytest.approx(change.mean())
    assert overall.time_s.effect.value == pytest.approx(change.mean() / change.std())
    assert (overall.settings, overall.time_s.pairs) == (len(LOSS["values"]), 60)
    shares = frame.pivot_table(index="seed", columns="strategy", values="captured")
    lost = shares["xi-0"] - shares["xi-star"]
    assert overall.rate.mean.value == pytest.approx(lost.mean())
    assert overall.rate.better == (lost > 0).sum()


def test_there_is_no_overall_for_a_single_setting(tmp_path):
    _, _, summary = summed(tmp_path, seeds=5, strategies=["xi-star", "xi-0"])
    assert summary.overall == ()
    assert len(summary.comparisons) == 1


def test_tolerated_levels_are_those_of_each_setting(two):
    plan, frame, summary = two
    assert [(t.axis, t.others) for t in summary.tolerated] == [
        ("loss", {STRATEGY: "xi-star"}),
        ("loss", {STRATEGY: "xi-0"}),
    ]
    rates = frame[frame.strategy == "xi-star"].groupby("loss").captured.mean()
    first_below = int((rates.to_numpy() < plan.tolerated_rate).argmax())
    levels = LOSS["values"]
    assert first_below > 0
    assert levels[first_below - 1] <= summary.tolerated[0].level.value <= levels[first_below]


def test_where_capture_rises_with_the_axis_it_is_told_from_where_on(tmp_path):
    def turned(levels):
        return loss_only({"loss": 0.8 - levels["loss"]})

    _, _, up = summed(tmp_path, turned, axes=[LOSS], seeds=60)
    (rising,) = up.tolerated
    assert rising.rising
    rates = [cell.rate.value for cell in up.cells]
    above = next(k for k, rate in enumerate(rates) if rate >= 0.9)
    assert LOSS["values"][above - 1] <= rising.level.value <= LOSS["values"][above]
    assert rising.level.low <= rising.level.value <= rising.level.high
    assert f"from packet loss {100 * rising.level.value:.3g} %" in findings(up)[1]
    assert findings(up)[1].endswith(" on.")


def test_rows_along_an_axis_are_every_cell_once():
    plan = study_plan(axes=[LOSS, DELAY], strategies=["xi-star", "xi-0"])
    for axis in plan.all_axes:
        rows = list(rows_along(plan, axis))
        cells = [cell for _, row in rows for cell in row]
        assert sorted(cells) == list(range(len(plan.cells)))
        for others, row in rows:
            assert [plan.levels(c)[axis.name] for c in row] == [
                axis.column(k) for k in range(len(axis.levels))
            ]
            assert all(others.items() <= plan.levels(c).items() for c in row)
            assert axis.name not in others


def test_the_baseline_is_the_plans_or_the_first():
    plan = study_plan(axes=[ARMS], compare="radio", baseline="short")
    assert baseline_of(plan, plan.axes[0]) == 2
    assert baseline_of(study_plan(axes=[ARMS], compare="radio"), plan.axes[0]) == 0


def test_summary_csv_has_every_number_of_every_cell(tmp_path, two):
    _, _, summary = two
    summary.write_csv(tmp_path / "summary.csv")
    with open(tmp_path / "summary.csv", encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == len(summary.cells)
    for line, cell in zip(lines, summary.cells, strict=True):
        assert (float(line["loss"]), line["strategy"]) == tuple(cell.levels.values())
        for name, interval in (("capture_rate", cell.rate), ("time_s_restricted", cell.time_s)):
            found = [float(line[f"{name}{end}"]) for end in ("", "_low", "_high")]
            assert found == pytest.approx(list(interval))
        assert float(line["age_ticks_mean"]) == pytest.approx(cell.means["age_ticks_mean"].value)


def test_sentences_quote_the_intervals(two):
    _, _, summary = two
    said = findings(summary)
    assert len(said) == 2 + len(summary.tolerated) + len(summary.comparisons)
    best = max(summary.cells, key=lambda cell: cell.rate.value)
    assert f"{100 * best.rate.value:.0f} %" in said[0]
    level = summary.tolerated[0].level
    quoted = (
        f"packet loss {100 * level.value:.3g} % [{100 * level.low:.3g}, {100 * level.high:.3g}]"
    )
    assert quoted in said[1]
    first = summary.comparisons[0].time_s.mean
    assert f"{first.value:+.3g} [{first.low:+.3g}, {first.high:+.3g}] s" in said[4]


def test_a_difference_whose_interval_holds_zero_is_undecided(two):
    _, _, summary = two
    for sentence, one in zip(findings(summary)[4:], summary.comparisons, strict=True):
        for what, interval in (
            ("capture rate", one.rate.mean),
            ("time to capture", one.time_s.mean),
        ):
            decided = interval.low > 0 or interval.high < 0
            assert (f"{what} undecided" not in sentence) == decided


def test_nothing_captured_is_said_as_it_is(tmp_path):
    _, _, summary = summed(tmp_path, never, axes=[LOSS], seeds=20)
    said = " ".join(findings(summary))
    assert "0 % [0, 16]" in said  # Wilson: 3.8416 / (20 + 3.8416)
    assert "Capture is below 90 % even at packet loss 0 %" in said
    assert all(np.isnan(cell.survival.median) for cell in summary.cells)
    assert all(cell.time_s.value == cell.limit_s for cell in summary.cells)


def test_one_cell_and_one_seed_can_be_summed_up(tmp_path):
    _, _, summary = summed(tmp_path, seeds=1)
    assert summary.comparisons == ()
    assert summary.tolerated == ()
    assert "of 1 run." in findings(summary)[0]


def test_levels_are_told_as_a_person_reads_them():
    plan = study_plan(axes=[LOSS, DELAY], strategies=["xi-star", "xi-0"])
    text = where_text(plan, {"loss": 0.2, "delay": 0.4, STRATEGY: "xi-0"})
    assert text == "packet loss 20 %, mean delay 400 ms, strategy xi-0"
