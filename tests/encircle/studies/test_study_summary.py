import csv
from contextlib import closing

import numpy as np
import pytest
from helpers_studies import ARMS, DELAY, LOSS, filled, loss_only, never, study_plan
from scipy import stats

from encircle.studies.csv_files import write_cells, write_comparisons
from encircle.studies.plan import STRATEGY_AXIS
from encircle.studies.report.sentences import levels_text, summary_sentences, verdict_text
from encircle.studies.summary import OUTCOMES, baseline_index, cells_along, summarise

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
        assert one.time_s.effect_size.value == pytest.approx(change.mean() / change.std())
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
    _, _, turned = summed(tmp_path, **TWO, compare=STRATEGY_AXIS, baseline="xi-0")
    for a, b in zip(two[2].comparisons, turned.comparisons, strict=True):
        assert b.time_s.mean.value == pytest.approx(-a.time_s.mean.value)
        assert b.rate.mean.value == pytest.approx(-a.rate.mean.value)


def test_overall_settings_are_averaged_within_each_seed(two):
    _, frame, summary = two
    (overall,) = summary.overall
    by_seed = frame.pivot_table(index="seed", columns="strategy", values="ticks") * 0.1
    change = by_seed["xi-0"] - by_seed["xi-star"]
    assert overall.time_s.mean.value == pytest.approx(change.mean())
    assert overall.time_s.effect_size.value == pytest.approx(change.mean() / change.std())
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
    assert [(t.axis, t.others) for t in summary.tolerances] == [
        ("loss", {STRATEGY_AXIS: "xi-star"}),
        ("loss", {STRATEGY_AXIS: "xi-0"}),
    ]
    rates = frame[frame.strategy == "xi-star"].groupby("loss").captured.mean()
    first_below = int((rates.to_numpy() < plan.tolerated_rate).argmax())
    levels = LOSS["values"]
    assert first_below > 0
    assert levels[first_below - 1] <= summary.tolerances[0].level.value <= levels[first_below]


def test_where_capture_rises_with_the_axis_it_is_told_from_where_on(tmp_path):
    def turned(levels):
        return loss_only({"loss": 0.8 - levels["loss"]})

    _, _, up = summed(tmp_path, turned, axes=[LOSS], seeds=60)
    (rising,) = up.tolerances
    assert rising.rising
    rates = [cell.rate.value for cell in up.cells]
    above = next(k for k, rate in enumerate(rates) if rate >= 0.9)
    assert LOSS["values"][above - 1] <= rising.level.value <= LOSS["values"][above]
    assert rising.level.low <= rising.level.value <= rising.level.high
    assert f"from packet loss {100 * rising.level.value:.3g} %" in summary_sentences(up)[1]
    assert summary_sentences(up)[1].endswith(" on.")


def test_rows_along_an_axis_are_every_cell_once():
    plan = study_plan(axes=[LOSS, DELAY], strategies=["xi-star", "xi-0"])
    for axis in plan.all_axes:
        rows = list(cells_along(plan, axis))
        cells = [cell for _, row in rows for cell in row]
        assert sorted(cells) == list(range(len(plan.cells)))
        for others, row in rows:
            assert [plan.levels(c)[axis.name] for c in row] == [
                axis.table_value(k) for k in range(len(axis.levels))
            ]
            assert all(others.items() <= plan.levels(c).items() for c in row)
            assert axis.name not in others


def test_the_baseline_is_the_plans_or_the_first():
    plan = study_plan(axes=[ARMS], compare="radio", baseline="short")
    assert baseline_index(plan, plan.axes[0]) == 2
    assert baseline_index(study_plan(axes=[ARMS], compare="radio"), plan.axes[0]) == 0


def test_summary_csv_has_every_number_of_every_cell(tmp_path, two):
    _, _, summary = two
    write_cells(summary, tmp_path / "summary.csv")
    with open(tmp_path / "summary.csv", encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == len(summary.cells)
    for line, cell in zip(lines, summary.cells, strict=True):
        assert (float(line["loss"]), line["strategy"]) == tuple(cell.levels.values())
        for name, interval in (("capture_rate", cell.rate), ("time_s_restricted", cell.time_s)):
            numbers = [float(line[f"{name}{end}"]) for end in ("", "_low", "_high")]
            assert numbers == pytest.approx(list(interval))
        assert float(line["age_ticks_mean"]) == pytest.approx(cell.means["age_ticks_mean"].value)


def test_sentences_quote_the_intervals(two):
    _, _, summary = two
    best_and_worst, along, over = summary_sentences(summary)
    best = max(summary.cells, key=lambda cell: cell.rate.value)
    assert f"{100 * best.rate.value:.0f} %" in best_and_worst
    for one in summary.tolerances:
        low = "below 0" if np.isinf(one.level.low) else f"{100 * one.level.low:.3g}"
        quoted = f"up to {100 * one.level.value:.3g} % [{low}, {100 * one.level.high:.3g}]"
        assert f"at strategy {one.others['strategy']} {quoted}" in along
    time_s = summary.overall[0].time_s.mean
    assert f"{time_s.value:+.3g} [{time_s.low:+.3g}, {time_s.high:+.3g}] s" in over


def decided_by(test):
    """Whether interval and corrected p decide, and whether the uncorrected p would."""
    apart = test.mean.low > 0 or test.mean.high < 0
    return apart and test.p_corrected <= 0.05, apart and test.p <= 0.05


def test_a_sentence_says_what_interval_and_corrected_p_say_both(two):
    _, _, summary = two
    (over,) = summary.overall
    sentence = summary_sentences(summary)[2].partition(" Of the ")[0]
    parts = sentence.split(": ", 1)[1].split("; ")
    for part, name in zip(parts, OUTCOMES, strict=True):
        decided, alone = decided_by(getattr(over, name))
        assert ("undecided" not in part) == decided
        assert ("after correction" in part) == (alone and not decided)
        assert part.count(", p ") == part.count(", corrected ") == 1


def test_settings_and_verdicts_say_what_interval_and_corrected_p_say_both(two):
    _, _, summary = two
    comparisons = (
        summary_sentences(summary)[2].partition(" Of the 5 settings: ")[2].rstrip(".").split("; ")
    )
    beginnings = ["capture rate", "captured", "mean time to capture"]
    for part, beginning, name in zip(comparisons, beginnings, OUTCOMES, strict=True):
        tests = [getattr(one, name) for one in summary.comparisons]
        assert part.startswith(beginning)
        assert part.count("packet loss") == sum(decided_by(test)[0] for test in tests)
    for one in summary.comparisons:
        marks = [decided_by(getattr(one, name)) for name in OUTCOMES]
        text = verdict_text(one)
        if any(decided for decided, _ in marks):
            assert text.count(";") + 1 == sum(decided for decided, _ in marks)
            assert "undecided" not in text
        else:
            assert text.startswith("undecided")
            assert text.endswith("after correction") == any(alone for _, alone in marks)


def test_every_p_is_corrected_for_all_that_a_report_tells(two):
    _, _, summary = two
    comparisons = [*summary.comparisons, *summary.overall]
    tests = [getattr(one, name) for one in comparisons for name in OUTCOMES]
    assert len(tests) == summary.tests == 18
    ascending = sorted(test.p for test in tests)
    for test in tests:
        before = [p * (18 - k) for k, p in enumerate(ascending) if p <= test.p]
        assert test.p_corrected == pytest.approx(min(1.0, max(before)))


def test_the_order_within_seeds_takes_a_run_without_capture_for_late(two):
    _, frame, summary = two
    for one in summary.comparisons:
        here = frame[frame.loss == one.others["loss"]]
        late = here.ticks + 1000 * (1 - here.captured)
        a, b = (late[here.strategy == s].to_numpy() for s in ("xi-star", "xi-0"))
        assert (one.order.worse, one.order.better) == ((b > a).sum(), (b < a).sum())
        assert one.order.mean.value == pytest.approx(np.sign(b - a).mean())


def test_times_are_compared_up_to_the_lower_of_two_limits(tmp_path):
    arms = [{"name": name, "set": {"ticks_max": most}} for name, most in (("a", 300), ("b", 100))]
    axes = [{"name": "limit", "arms": arms}]
    _, frame, summary = summed(tmp_path, axes=axes, compare="limit", seeds=40)
    (one,) = summary.comparisons
    capped = [
        np.minimum(0.1 * rows.ticks, 10.0).to_numpy()
        for rows in (frame[frame["cell"] == cell] for cell in (0, 1))
    ]
    assert one.time_s.mean.value == pytest.approx((capped[1] - capped[0]).mean())
    # A capture after the lower of two limits counts like no capture.
    assert one.order.ties >= ((capped[0] == 10.0) & (capped[1] == 10.0)).sum() > 0


def test_comparisons_csv_has_both_p_of_every_test(tmp_path, two):
    _, _, summary = two
    write_comparisons(summary, tmp_path / "comparisons.csv")
    with open(tmp_path / "comparisons.csv", encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    comparisons = [*summary.comparisons, *summary.overall]
    assert [line["loss"] for line in lines] == [*map(str, LOSS["values"]), "all"]
    for line, one in zip(lines, comparisons, strict=True):
        assert (line["strategy"], line["baseline"], line["pairs"]) == ("xi-0", "xi-star", "60")
        for name, test in (
            ("capture_rate", one.rate),
            ("later_less_earlier", one.order),
            ("time_s_restricted", one.time_s),
        ):
            ends = ("difference", "low", "high", "p", "p_corrected")
            numbers = [float(line[f"{name}_{end}"]) for end in ends]
            assert numbers == pytest.approx([*test.mean, test.p, test.p_corrected])
            assert line[f"{name}_decision"] == test.verdict


def test_nothing_captured_is_said_as_it_is(tmp_path):
    _, _, summary = summed(tmp_path, never, axes=[LOSS], seeds=20)
    text = " ".join(summary_sentences(summary))
    assert "0 % [0, 16]" in text  # Wilson: 3.8416 / (20 + 3.8416)
    assert "Capture is below 90 % even at packet loss 0 %" in text
    assert all(np.isnan(cell.survival.median) for cell in summary.cells)
    assert all(cell.time_s.value == cell.limit_s for cell in summary.cells)


def test_one_cell_and_one_seed_can_be_summed_up(tmp_path):
    _, _, summary = summed(tmp_path, seeds=1)
    assert summary.comparisons == ()
    assert summary.tolerances == ()
    assert "of 1 run." in summary_sentences(summary)[0]


def test_levels_are_told_as_a_person_reads_them():
    plan = study_plan(axes=[LOSS, DELAY], strategies=["xi-star", "xi-0"])
    text = levels_text(plan, {"loss": 0.2, "delay": 0.4, STRATEGY_AXIS: "xi-0"})
    assert text == "packet loss 20 %, mean delay 400 ms, strategy xi-0"
