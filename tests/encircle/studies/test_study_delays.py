"""Studies of delay: delivered beside requested delay, and axes labelled by delivered delay."""

import csv
from contextlib import closing
from math import exp

import numpy as np
import pytest
from helpers_pages import Page
from helpers_studies import ARMS, DELAY, LOSS, filled, study_plan

from encircle.studies.charts.frames import scaled_levels
from encircle.studies.charts.lines import RATE, draw_along_axis
from encircle.studies.charts.maps import draw_maps
from encircle.studies.plan import StudyError
from encircle.studies.plan_files import load_plan
from encircle.studies.report.report import write_report
from encircle.studies.study import Study
from encircle.studies.summary import summarise

SHOWN = {**DELAY, "show": "delivered"}
SHORT = {**LOSS, "values": [0.0, 0.3, 0.6]}


def summed_up(directory, **changes):
    """Rows, summary and report of a filled study."""
    plan = study_plan(**changes)
    with closing(filled(plan, directory)) as table:
        rows = table.read().to_pandas()
        summary = summarise(plan, table)
        path = write_report(plan, table, directory, "again", summary=summary)
    return rows, summary, Page(path.read_text(encoding="utf-8"))


def summary_of(plan, directory):
    with closing(filled(plan, directory)) as table:
        return summarise(plan, table)


def test_an_axis_of_delays_can_be_drawn_and_named_by_what_was_delivered(tmp_path):
    rows, summary, page = summed_up(tmp_path / "t", axes=[SHORT, SHOWN], seeds=4)
    delivered_ms = 1000 * rows.groupby("delay")["delay_s_mean"].mean()
    axis = summary.plan.axes[1]
    assert scaled_levels(axis) == pytest.approx(delivered_ms)
    (drawn,) = draw_maps(summary)
    names = [f"{ms:.0f}" if ms >= 1000 else f"{ms:.3g}" for ms in delivered_ms]
    assert [t.get_text() for t in drawn.figure.axes[0].get_yticklabels()] == names
    panel = draw_along_axis(summary, axis, RATE).figure.axes[0]
    assert panel.get_xlabel() == "delivered mean delay (ms)"
    points = np.mean([c.lines[0].get_xdata() for c in panel.containers], axis=0)
    assert points == pytest.approx(delivered_ms)
    head, *body = page.table("Cells")
    assert head[1] == "delivered mean delay (ms)"
    assert [line[1] for line in body[:7]] == names
    varied = page.table("What is varied")[2]
    assert varied[2] == f"0, 100, 200, 400, 600, 800, 1000; delivered: {', '.join(names)}"


def test_levels_are_kept_as_they_were_asked_for_in_the_files(tmp_path):
    _rows, summary, _page = summed_up(tmp_path / "t", axes=[SHOWN], seeds=2)
    with open(tmp_path / "t" / "summary.csv", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert [float(line["delay"]) for line in lines] == DELAY["values"]
    assert [float(line["delay_s_mean_asked"]) for line in lines] == DELAY["values"]
    assert {line["delay_model"] for line in lines} == {"constant"}
    delivered_s = [float(line["delay_s_mean"]) for line in lines]
    assert delivered_s == pytest.approx(summary.plan.axes[0].display_values)


def test_how_much_delay_is_tolerated_is_told_as_delivered(tmp_path):
    plans = (study_plan(axes=[axis], seeds=30, tolerated_rate=0.95) for axis in (DELAY, SHOWN))
    requested, shown = (summary_of(plan, tmp_path / str(k)) for k, plan in enumerate(plans))
    levels, delivered_s = DELAY["values"], shown.plan.axes[0].display_values
    (one,), (other,) = requested.tolerances, shown.tolerances
    assert levels[0] < one.level.value < levels[-1]
    # Between two levels, requested and delivered delay are both interpolated linearly.
    assert other.level.value == pytest.approx(np.interp(one.level.value, levels, delivered_s))


def test_cells_show_what_was_delivered_beside_what_was_asked_where_there_is_delay(tmp_path):
    arms = {
        "name": "radio",
        "arms": [
            {"name": "perfect", "set": {}},
            {"name": "slow", "set": {"channel.delay": {"model": "exponential", "mean_s": 0.3}}},
        ],
    }
    rows, _summary, page = summed_up(tmp_path / "t", axes=[arms], seeds=3)
    head, *body = page.table("Cells")
    assert head[1:3] == ["Mean delay, asked (s)", "Mean delay, delivered (s)"]
    assert [line[1] for line in body] == ["0 (constant)", "0.3 (exponential)"]
    delays = [float(line[2].split()[0]) for line in body]
    assert delays == pytest.approx(rows.groupby("cell")["delay_s_mean"].mean(), rel=1e-3)
    _rows, _summary, page = summed_up(tmp_path / "n", axes=[SHORT], seeds=3)
    assert "delay" not in " ".join(page.table("Cells")[0])


def test_levels_that_come_out_alike_are_drawn_and_nothing_is_said_to_be_tolerated(tmp_path):
    plan = study_plan(axes=[{**SHOWN, "values": [0.0, 0.01, 0.05, 0.1]}], seeds=2)
    summary = summary_of(plan, tmp_path / "t")
    alike = plan.as_delivered({"delay": [0.1, 0.1, 0.1, 0.1]})
    summary = type(summary)(
        alike, *(getattr(summary, f) for f in ("cells", "captured", "ticks", "tick_s"))
    )
    assert summary.tolerances == ()
    line = draw_along_axis(summary, alike.axes[0], RATE).figure.axes[0].containers[0].lines[0]
    assert line.get_xdata() == pytest.approx([100.0] * 4)


@pytest.mark.parametrize(
    ("axis", "wrong"),
    [
        ({**LOSS, "show": "delivered"}, "not channel.loss.rate"),
        ({**ARMS, "show": "delivered"}, "not arms"),
        ({"name": "a", "key": "channel.delay.std_s", "values": [1], "show": "delivered"}, "std_s"),
        ({**DELAY, "show": "measured"}, "must be one of asked, delivered"),
    ],
)
def test_only_delays_can_be_shown_as_delivered(axis, wrong):
    with pytest.raises(StudyError, match=r"axes\.0") as error:
        study_plan(axes=[axis])
    assert wrong in str(error.value)


def test_a_study_that_runs_shows_the_delay_that_the_law_gives(tmp_path):
    # Mean of an exponential delay m that is rounded up to ticks of length h: h / (1 - exp(-h / m)).
    axis = {**SHOWN, "values": [0.05, 0.1, 0.4]}
    tree = {"scenario": "sim1", "axes": [axis], "seeds": 6, "measures": ["captured"]}
    plan = load_plan(
        {**tree, "set": {"channel.delay.model": "exponential", "target.step_m_max": 0.3}}
    )
    study = Study(plan, tmp_path)
    study.run(workers=1)
    with closing(study.open()) as table:
        shown = summarise(plan, table).plan.axes[0].display_values
    expected = [0.1 / (1.0 - exp(-0.1 / mean_s)) for mean_s in axis["values"]]
    assert shown == pytest.approx(expected, rel=0.05)
