"""Figures of studies: drawn values against counts from the table, names, and what fits."""

import os
import subprocess
import sys
from contextlib import closing
from itertools import chain, combinations, pairwise
from math import sqrt

import matplotlib
import numpy as np
import pytest
from helpers_paths import TESTS
from helpers_studies import (
    ARMS,
    DELAY,
    LOSS,
    Truth,
    filled,
    loss_only,
    never,
    study_plan,
)
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.text import Text

from encircle.statistics.comparisons import Verdict
from encircle.studies.charts import charts, layout
from encircle.studies.charts import frames as chart_frames
from encircle.studies.charts import survival as chart_survival
from encircle.studies.charts.charts import axes_to_draw, charts_of, write_charts
from encircle.studies.charts.lines import RATE, draw_along_axis
from encircle.studies.charts.maps import _name_levels, draw_maps
from encircle.studies.plan import Axis
from encircle.studies.summary import OUTCOMES, summarise

STRATEGIES = ["xi-star", "xi-0"]
HOSTILE = ["$x^2", "_hidden", "a\nb <script>", "w" * 70, "a name that is longer than " * 4]
EDGE_PX = 1.0
SHORT = {**LOSS, "values": [0.0, 0.4]}
WORDY = "share of the packets between robots that the radio drops on the way"
FEW = {**DELAY, "values": [0.0, 0.1, 0.4, 1.0]}


def slow_in_bursts(levels):
    """The second arm captures later and less often than the others."""
    truth = loss_only(levels)
    slower = 5.0 if levels["radio"] == ARMS["arms"][1]["name"] else 1.0
    return truth._replace(mean_s=slower * truth.mean_s)


CASES = {
    "lines": ({"axes": [LOSS], "strategies": STRATEGIES, "seeds": 12}, loss_only),
    "grid": ({"axes": [LOSS, FEW], "seeds": 6}, loss_only),
    "arms": ({"axes": [ARMS, LOSS], "compare": "radio", "seeds": 30}, slow_in_bursts),
    "names": (
        {
            "axes": [{"name": "arm", "arms": [{"name": n, "set": {}} for n in HOSTILE]}],
            "strategies": STRATEGIES,
            "seeds": 6,
        },
        loss_only,
    ),
    "wordy": (
        {
            "axes": [
                {**LOSS, "label": WORDY, "values": [0.0, 0.3, 0.6]},
                {**FEW, "label": WORDY, "values": [0.0, 0.3, 0.6]},
            ],
            "strategies": STRATEGIES,
            "seeds": 2,
        },
        loss_only,
    ),
    "single": ({"seeds": 1}, loss_only),
    "one_seed": ({"axes": [SHORT], "strategies": STRATEGIES, "seeds": 1}, loss_only),
    "none": ({"axes": [SHORT], "strategies": STRATEGIES, "seeds": 6}, never),
    "all": ({"axes": [SHORT], "seeds": 6}, lambda _levels: Truth(0.3)),
}


class Case:
    """A simulated study: rows of its table, its summary, and its figures by name."""

    def __init__(self, directory, tree, truth):
        self.plan = study_plan(**tree, measures=["age_ticks_mean"])
        with closing(filled(self.plan, directory, truth)) as table:
            self.rows = table.read().to_pydict()
            self.summary = summarise(self.plan, table)
        with matplotlib.rc_context(chart_frames.STUDY_STYLE):
            self.drawn = {drawn.name: drawn for drawn in charts_of(self.summary)}
            for drawn in self.drawn.values():
                FigureCanvasAgg(drawn.figure)
                drawn.figure.draw_without_rendering()

    def table_value(self, name, **levels):
        """A column of the runs at some levels, in the order of seeds."""
        selected = np.ones(len(self.rows[name]), bool)
        for axis, level in levels.items():
            selected &= np.array([value == level for value in self.rows[axis]])
        return np.array(self.rows[name], float)[selected]


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    made = {}

    def case(name):
        if name not in made:
            made[name] = Case(tmp_path_factory.mktemp(name) / "t", *CASES[name])
        return made[name]

    return case


def wilson(captured):
    """Wilson's interval for 95 %, in closed form."""
    n, p, z = len(captured), np.mean(captured), 1.959963984540054
    centre, reach = p + z * z / (2 * n), z * sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return (centre - reach) / (1 + z * z / n), (centre + reach) / (1 + z * z / n)


def bars(axes, index):
    """Lower and upper ends of the error bars of one errorbar container of the axes."""
    _line, _caps, (segments,) = axes.containers[index]
    return np.array(segments.get_segments())


def legend_texts(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_rates_are_shares_of_the_runs_with_wilsons_bars(cases):
    case = cases("lines")
    (axes,) = case.drawn["rate-by-loss"].figure.axes
    for index, strategy in enumerate(STRATEGIES):
        runs = [case.table_value("captured", loss=x, strategy=strategy) for x in LOSS["values"]]
        points = axes.containers[index].lines[0].get_ydata()
        assert points == pytest.approx([100 * np.mean(r) for r in runs])
        expected = 100 * np.array([wilson(r) for r in runs])
        assert bars(axes, index)[:, :, 1] == pytest.approx(expected, abs=1e-9)


def test_times_are_means_in_which_runs_without_capture_count_as_the_limit(cases):
    case = cases("lines")
    (axes,) = case.drawn["time-by-loss"].figure.axes
    for index, strategy in enumerate(STRATEGIES):
        runs = [case.table_value("ticks", loss=x, strategy=strategy) for x in LOSS["values"]]
        points = axes.containers[index].lines[0].get_ydata()
        assert points == pytest.approx([0.1 * np.mean(np.minimum(r, 300)) for r in runs])


def test_points_of_a_level_stand_side_by_side_about_it(cases):
    (axes,) = cases("lines").drawn["rate-by-loss"].figure.axes
    left, right = (container.lines[0].get_xdata() for container in axes.containers)
    assert (left + right) / 2 == pytest.approx([0, 20, 40, 60, 80])
    assert (left < right).all()
    assert np.diff(np.sort(np.concatenate([left, right]))).max() < 20


def test_every_axis_has_a_label_with_its_unit_and_every_line_an_entry(cases):
    figures = cases("lines").drawn
    (axes,) = figures["rate-by-loss"].figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("packet loss (%)", "capture rate (%)")
    (axes,) = figures["time-by-loss"].figure.axes
    assert axes.get_ylabel() == "mean time to capture,\nup to the limit (s)"
    assert legend_texts(figures["rate-by-loss"].figure) == STRATEGIES
    survival = figures["survival"].figure
    assert legend_texts(survival) == [*STRATEGIES, "not captured"]
    assert {a.get_xlabel() for a in survival.axes} == {"time (s)", ""}
    assert {a.get_ylabel() for a in survival.axes} == {"share still free (%)", ""}
    left, middle, right = figures["differences"].figure.axes
    assert "(points)" in left.get_xlabel()
    assert "(points)" in middle.get_xlabel()
    assert "(s)" in right.get_xlabel()
    ages = figures["age"].figure.axes
    assert [a.get_xlabel() for a in ages[:2]] == ["mean age of information (s)"] * 2
    assert ages[2].get_ylabel() == "packet loss (%)"
    maps = cases("grid").drawn["map"].figure.axes
    assert {a.get_xlabel() for a in maps} == {
        "packet loss (%)",
        "capture rate (%)",
        "mean time to capture,\nup to the limit (s)",
    }
    assert maps[0].get_ylabel() == "mean delay (ms)"


def test_lines_differ_in_colour_and_marker_and_dashes(cases):
    (axes,) = cases("grid").drawn["rate-by-delay"].figure.axes
    looks = [container.lines[0] for container in axes.containers]
    assert len(looks) == 5
    for one, other in combinations(looks, 2):
        assert not same_color(one.get_color(), other.get_color())
        assert one.get_marker() != other.get_marker()
        assert one._unscaled_dash_pattern != other._unscaled_dash_pattern


def test_survival_is_the_share_of_runs_that_last_longer(cases):
    case = cases("lines")
    panels = case.drawn["survival"].figure.axes
    assert [axes.get_title() for axes in panels] == [
        f"packet\N{NO-BREAK SPACE}loss\N{NO-BREAK SPACE}{x}\N{NO-BREAK SPACE}%"
        for x in (0, 20, 40, 60, 80)
    ]
    for axes, loss in zip(panels, LOSS["values"], strict=True):
        for index, strategy in enumerate(STRATEGIES):
            curve, stroke = axes.lines[2 * index : 2 * index + 2]
            captured = case.table_value("captured", loss=loss, strategy=strategy) > 0
            ticks = case.table_value("ticks", loss=loss, strategy=strategy)
            # Runs are censored only at the end, so Kaplan and Meier's estimate is a plain share.
            for time_s, share in zip(*curve.get_data(), strict=True):
                still = (ticks > time_s / 0.1 + 1e-6) | ~captured
                assert share == pytest.approx(100 * still.mean())
            assert list(stroke.get_xdata()) == pytest.approx([30.0] * (not captured.all()))
        assert axes.get_xlim()[1] >= 30.0


def test_a_map_has_each_cell_in_its_place_with_its_number(cases):
    case = cases("grid")
    rates, times = case.drawn["map"].figure.axes[:2]
    shown = rates.collections[0].get_array().reshape(4, 5)
    printed = np.array([text.get_text() for text in rates.texts]).reshape(4, 5)
    seconds = np.array([text.get_text() for text in times.texts]).reshape(4, 5)
    for (y, x), value in np.ndenumerate(shown):
        at = {"loss": LOSS["values"][x], "delay": FEW["values"][y]}
        assert value == pytest.approx(100 * case.table_value("captured", **at).mean())
        assert float(printed[y, x]) == pytest.approx(value, abs=0.5)
        assert float(seconds[y, x]) == pytest.approx(
            0.1 * case.table_value("ticks", **at).mean(), abs=0.05 + 1e-9
        )
    assert [t.get_text() for t in rates.get_xticklabels()] == ["0", "20", "40", "60", "80"]
    assert [t.get_text() for t in rates.get_yticklabels()] == [
        f"{1000 * d:g}" for d in FEW["values"]
    ]


def test_maps_whose_cells_are_all_equal_are_left_out(tmp_path):
    axes = [SHORT | {"values": [0.0, 0.2, 0.4]}, FEW]

    def figures(name, truth):
        plan = study_plan(axes=axes, seeds=3)
        with closing(filled(plan, tmp_path / name, truth)) as table:
            return list(draw_maps(summarise(plan, table)))

    assert figures("never", never) == []
    (drawn,) = figures("always", lambda levels: Truth(0.4 + levels["loss"]))
    shown = [axes for axes in drawn.figure.axes if axes.get_xlabel() == "packet loss (%)"]
    assert len(shown) == 1
    assert "The capture rate is 100 % in all of these cells." in drawn.caption
    assert "capture rate" not in drawn.alt


def test_curves_end_with_the_last_run_under_observation(tmp_path):
    ends = {"name": "end", "key": "ticks_max", "values": [100, 300]}
    plan = study_plan(axes=[ends, SHORT], seeds=8)
    with closing(filled(plan, tmp_path / "t")) as table:
        rows, summary = table.read().to_pandas(), summarise(plan, table)
    panels = chart_survival.draw_survival(summary).figure.axes
    last_s = 0.1 * rows.groupby("cell")["ticks"].max()
    assert set(0.1 * rows[rows["captured"] == 0]["ticks"]) == {10.0, 30.0}
    curves = [line for axes in panels for line in axes.lines[::2]]
    drawn_s = sorted(max(line.get_xdata()) for line in curves)
    assert drawn_s == pytest.approx(sorted(last_s))
    bands_s = [band.get_datalim(axes.transData).x1 for axes in panels for band in axes.collections]
    assert sorted(bands_s) == pytest.approx(drawn_s)


def test_time_is_cut_soon_after_the_last_capture_if_that_is_early(tmp_path):
    def truth(levels):
        return never(levels) if levels["loss"] else Truth(0.6)

    plan = study_plan(axes=[SHORT], seeds=8)
    with closing(filled(plan, tmp_path / "t", truth)) as table:
        rows, summary = table.read().to_pandas(), summarise(plan, table)
    drawn = chart_survival.draw_survival(summary)
    (axes,) = drawn.figure.axes
    last_s = 0.1 * rows[rows["captured"] == 1]["ticks"].max()
    assert last_s < axes.get_xlim()[1] < 1.5 * last_s
    caught, _no_stroke, free, stroke = axes.lines
    assert max(caught.get_xdata()) == pytest.approx(last_s)
    assert max(free.get_xdata()) == stroke.get_xdata()[0] < axes.get_xlim()[1]
    assert f"Nothing changes after {stroke.get_xdata()[0]:.3g} s" in drawn.caption
    assert "at the limit, 30 s" in drawn.caption


def test_numbers_of_a_map_can_be_read_on_their_cells(cases):
    def luminance(colour):
        parts = np.asarray(matplotlib.colors.to_rgb(colour))
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return linear @ (0.2126, 0.7152, 0.0722)

    for axes in cases("grid").drawn["map"].figure.axes[:2]:
        faces = axes.collections[0].get_facecolors()
        for text, face in zip(axes.texts, faces, strict=True):
            dark, light = sorted((luminance(text.get_color()), luminance(face[:3])))
            assert (light + 0.05) / (dark + 0.05) >= 4.5


def test_levels_that_are_not_in_order_are_drawn_in_order(tmp_path):
    plan = study_plan(axes=[{**LOSS, "values": [0.6, 0.0, 0.3]}, FEW], seeds=3)
    with closing(filled(plan, tmp_path / "t")) as table:
        summary = summarise(plan, table)
    rates = [100.0 * summary.captured[len(FEW["values"]) * index].mean() for index in (1, 2, 0)]
    (axes,) = draw_along_axis(summary, plan.axes[0], RATE).figure.axes
    line = axes.containers[0].lines[0]
    assert (np.diff(line.get_xdata()) > 0).all()
    assert line.get_ydata() == pytest.approx(rates)
    (drawn,) = draw_maps(summary)
    shown = drawn.figure.axes[0].collections[0].get_array().reshape(4, 3)
    assert list(shown[0]) == pytest.approx(rates)


def test_differences_are_level_minus_baseline_and_filled_where_decided(cases):
    case = cases("arms")
    panels = dict(zip(OUTCOMES, case.drawn["differences"].figure.axes, strict=True))
    arms = [arm["name"] for arm in ARMS["arms"]]

    def change(name, x, arm):
        base, values = (case.table_value(name, loss=x, radio=which) for which in (arms[0], arm))
        return (values - base).mean()

    comparisons = {(one.others["loss"], one.level): one for one in case.summary.comparisons}
    for claim, axes in panels.items():
        points = [
            line for line in axes.lines if line.get_marker() in "osD^" and line.get_ls() == "None"
        ]
        spans = [line for line in axes.lines if len(line.get_xdata()) == 2 and line.get_lw() == 1.0]
        assert len(points) == len(spans) == 10
        for index, (point, span) in enumerate(zip(points, spans, strict=True)):
            level, arm = LOSS["values"][index // 2], arms[1 + index % 2]
            expected = {
                "rate": 100.0 * change("captured", level, arm),
                "time_s": 0.1 * change("ticks", level, arm),
            }
            test = getattr(comparisons[level, arm], claim)
            scale = 1.0 if claim == "time_s" else 100.0
            assert point.get_xdata()[0] == pytest.approx(
                expected.get(claim, 100.0 * test.mean.value)
            )
            assert span.get_xdata() == pytest.approx([scale * x for x in test.mean[1:]])
            assert int(point.get_ydata()[0]) == index // 2
            hollow = same_color(point.get_markerfacecolor(), "white")
            assert hollow == (test.verdict is Verdict.UNDECIDED)
        decided = [getattr(one, claim).verdict for one in comparisons.values()]
        assert {"undecided"} < set(decided)
    names = panels["rate"].get_yticklabels()
    assert names[0].get_text().endswith("0\N{NO-BREAK SPACE}%")


def test_age_is_in_seconds_and_has_a_point_for_each_cell(cases):
    case = cases("grid")
    rates, _times, _bar = case.drawn["age"].figure.axes
    points = np.vstack([c.get_offsets() for c in rates.collections if c.get_offsets().size > 2])
    expected = [
        (
            0.1 * case.table_value("age_ticks_mean", loss=x, delay=d).mean(),
            100 * case.table_value("captured", loss=x, delay=d).mean(),
        )
        for x in LOSS["values"]
        for d in FEW["values"]
    ]
    assert np.array(sorted(points.tolist())) == pytest.approx(np.array(sorted(expected)))


def tick_labels(axes):
    """The visible tick labels along x, and those along y."""
    visible = []
    for axis, limits in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        low, high = sorted(limits)
        ticks = [t for t in axis.get_major_ticks() if low <= t.get_loc() <= high]
        texts = [t for tick in ticks for t in (tick.label1, tick.label2)]
        visible.append([text for text in texts if text.get_visible() and text.get_text()])
    return visible


def texts_in(figure):
    """All texts that are drawn; of tick labels only the visible ones."""
    texts = [text for legend in figure.legends for text in legend.findobj(Text)]
    for axes in figure.axes:
        rulers = {text for axis in (axes.xaxis, axes.yaxis) for text in axis.findobj(Text)}
        texts += [text for text in axes.findobj(Text) if text not in rulers]
        texts += [axes.xaxis.label, axes.yaxis.label, *chain(*tick_labels(axes))]
    return [text for text in texts if text.get_visible() and text.get_text().strip()]


@pytest.mark.parametrize("name", sorted(CASES))
def test_all_text_is_inside_the_figure_and_names_do_not_overlap(cases, name):
    for drawn in cases(name).drawn.values():
        figure = drawn.figure
        for text in texts_in(figure):
            low, high = text.get_window_extent().get_points()
            assert (low > -EDGE_PX).all(), (drawn.name, text)
            assert (high < figure.bbox.size + EDGE_PX).all(), (drawn.name, text)
        for axes in figure.axes:
            for end, labels in enumerate(tick_labels(axes)):
                boxes = sorted(t.get_window_extent().get_points()[:, end].tolist() for t in labels)
                assert all(a[1] <= b[0] for a, b in pairwise(boxes)), (drawn.name, labels)
            for legend in figure.legends:
                assert legend.get_window_extent().y1 <= axes.get_window_extent().y0, drawn.name


def test_a_label_without_room_gives_way_to_the_name_and_never_hides_a_level(cases):
    figures = cases("wordy").drawn
    titles = [axes.get_title() for axes in figures["rate-by-loss"].figure.axes]
    assert [title.split()[-2:] for title in titles] == [["0", "ms"], ["300", "ms"], ["600", "ms"]]
    assert {axes.get_xlabel() for axes in figures["rate-by-loss"].figure.axes} == {"loss (%)"}


def test_names_are_shown_as_they_are_and_not_as_mathematics(cases):
    (axes,) = cases("names").drawn["rate-by-arm"].figure.axes
    names = [text.get_text() for text in axes.get_yticklabels()]
    assert names[:3] == ["$x^2", "_hidden", r"a\nb <script>"]
    assert names[3].replace("\n", "").startswith("w" * 40)
    assert names[4].endswith("\N{HORIZONTAL ELLIPSIS}")


def test_a_single_cell_has_its_survival_curve_and_nothing_else(cases):
    case = cases("single")
    assert list(case.drawn) == ["survival"]
    assert "1 run per curve. 1 of 1 captured." in case.drawn["survival"].caption
    assert legend_texts(case.drawn["survival"].figure) == []


@pytest.mark.parametrize("name", ["one_seed", "none", "all"])
def test_studies_without_spread_are_drawn_too(cases, name):
    figures = cases(name).drawn
    assert {"rate-by-loss", "time-by-loss", "survival", "age"} <= set(figures)
    assert ("differences" in figures) == (name != "all")
    for drawn in figures.values():
        for axes in drawn.figure.axes:
            assert np.isfinite((axes.get_xlim(), axes.get_ylim())).all()


def test_no_captures_leave_all_free_and_no_time_beyond_the_limit(cases):
    figures = cases("none").drawn
    for axes in figures["survival"].figure.axes:
        assert {float(y) for y in axes.lines[0].get_ydata()} == {100.0}
    (axes,) = figures["time-by-loss"].figure.axes
    assert axes.get_ylim()[0] == 0.0
    assert [text.get_text() for text in axes.texts] == ["limit 30 s"]


def test_captions_say_how_many_runs_and_which_intervals(cases):
    figures = cases("lines").drawn
    assert "12 runs per point; bars: 95 % Wilson intervals." in figures["rate-by-loss"].caption
    assert "12 runs per curve" in figures["survival"].caption
    assert "limit, 30 s" in figures["time-by-loss"].caption
    assert "12 common seeds" in figures["differences"].caption
    assert "by p corrected for 18 tests" in figures["differences"].caption
    assert all(drawn.alt.endswith(".") for drawn in figures.values())


def test_what_does_not_fit_is_left_out_evenly_and_the_caption_says_so(tmp_path):
    many = {"name": "limit", "label": "limit", "unit": "ticks", "key": "ticks_max"}
    many["range"] = {"first": 30, "last": 300, "count": 10}
    plan = study_plan(axes=[many, DELAY], seeds=1)
    shape = layout.figure_layout(plan, plan.axes[1])
    assert shape.level_indices == (0, 2, 4, 5, 7, 9)
    assert shape.left_out == (
        "Shown are 6 of 10 levels of limit (30, 90, 150, 180, 240, 300 ticks)."
    )
    shape = layout.figure_layout(plan)
    assert len(shape.settings) == 6
    assert shape.left_out.endswith("and 6 of 7 settings of mean delay.")


@pytest.mark.parametrize(("count", "most"), [(1, 6), (6, 6), (7, 6), (13, 6), (100, 1), (9, 2)])
def test_evenly_keeps_the_ends_and_the_spacing(count, most):
    chosen = layout.evenly_spaced(count, most)
    assert len(chosen) == min(count, most)
    assert chosen[0] == 0
    assert chosen[-1] == count - 1 or most == 1
    steps = np.diff(chosen)
    assert steps.size == 0 or steps.max() - steps.min() <= 1


def test_a_view_finds_the_cells_of_the_plan():
    plan = study_plan(axes=[LOSS, ARMS, DELAY], compare="radio", seeds=1)
    shape = layout.figure_layout(plan, plan.axes[0])
    assert shape.lines is plan.axes[1]
    for setting in shape.settings:
        for line in shape.level_indices:
            for index in range(5):
                cell = shape.cell(setting, line, index)
                assert plan.cells[cell] == (index, line, setting["delay"])


def test_named_axes_are_drawn_along_if_nothing_else_shows_them():
    def along(*axes):
        return [axis.name for axis in axes_to_draw(study_plan(axes=axes, seeds=1))]

    arms = [{"name": f"a{k}", "set": {}} for k in range(7)]
    assert along(ARMS) == ["radio"]
    assert along(ARMS, LOSS) == ["loss"]
    assert along({"name": "many", "arms": arms}, LOSS) == ["loss", "many"]
    assert along({**LOSS, "values": [0.5]}) == []


def test_a_map_of_many_levels_names_those_that_fit():
    fine = Axis(name="fine", key="k", range={"first": 0.0, "last": 1.99, "count": 200})
    axes = Figure().subplots()
    _name_levels(axes, fine, fine, room_pt=2.0, high_pt=100.0)
    across = [text.get_text() for text in axes.get_xticklabels()]
    assert (across[0], across[-1], len(across)) == ("0", "1.99", 33)
    assert axes.get_xticks()[-1] == 199.5
    assert {text.get_rotation() for text in axes.get_xticklabels()} == {90.0}
    assert [text.get_text() for text in axes.get_yticklabels()][-1] == "1.99"
    assert len(axes.get_yticks()) == 8


def test_widely_spread_levels_have_a_log_scale():
    axis = Axis(name="noise", key="k", values=(0.001, 0.01, 1.0))
    values = chart_frames.scaled_levels(axis)
    assert chart_frames.spans_decades(values)
    assert not chart_frames.spans_decades(np.array([0.0, 0.001, 1.0]))
    left, right = (chart_frames.side_by_side(values, k, 2) for k in (0, 1))
    assert np.sqrt(left * right) == pytest.approx(values)


REPEATED = """
import sys
from pathlib import Path
from contextlib import closing
from encircle.studies.charts.lines import RATE, draw_along_axis
from encircle.studies.charts.maps import _name_levels, draw_maps
from encircle.studies.charts.charts import write_charts
from encircle.studies.summary import summarise
from helpers_studies import filled, study_plan
out = Path(sys.argv[1])
plan = study_plan(seeds=4)
with closing(filled(plan, out)) as table:
    write_charts(summarise(plan, table), out)
"""


def test_the_same_study_gives_the_same_files_in_every_process(tmp_path):
    changed = {"PYTHONHASHSEED": "1", "PYTHONPATH": str(TESTS / "helpers")}
    command = [sys.executable, "-W", "error", "-c", REPEATED, str(tmp_path / "there")]
    subprocess.run(command, check=True, env=os.environ | changed)
    plan = study_plan(seeds=4)
    with closing(filled(plan, tmp_path / "here")) as table:
        write_charts(summarise(plan, table), tmp_path / "here")
    for name, kind in (("survival.png", b"\x89PNG"), ("survival.pdf", b"%PDF")):
        here, there = (
            (tmp_path / d / charts.FIGURES / name).read_bytes() for d in ("here", "there")
        )
        assert here == there
        assert here.startswith(kind)
        assert b"CreationDate" not in here
        assert b"/Type3" not in here


def test_files_are_written_for_every_figure(cases, tmp_path):
    case = cases("single")
    (chart,) = write_charts(case.summary, tmp_path)
    assert chart.path == tmp_path / charts.FIGURES / "survival.png"
    assert chart.path.stat().st_size > 5000
    assert chart.path.with_suffix(".pdf").stat().st_size > 5000
    assert not chart.wide
