"""The figure of a whole hunt: captors, silent and lost robots, times, and the area shown.

The texts are compared with the hunt's result and plain geometry. Their positions are compared with
the boxes that matplotlib measures when it draws.
"""

from itertools import combinations, pairwise
from math import dist

import matplotlib
import numpy as np
import pytest
from helpers_paths import DOCS
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.image import imread

from encircle.figures import run_figures
from encircle.figures.run_figures import draw_run
from encircle.runlog.ground_truth import ground_truth_of
from encircle.runner.hunts import run
from encircle.world.recording.recording import read_recording

HUNT = DOCS / "hunt.png"
CHASE = {
    "ticks_max": 300,
    "team": {"positions": [[0, 0], [-1.5, 1], [-1.5, -1]], "sensing_range_m": 500.0},
    "target": {"position": [6, 0], "behaviour": "straight", "step_m_max": 0.3},
}
TALL = CHASE | {
    "target": CHASE["target"] | {"behaviour": "patrol", "parameters": {"waypoints": [[0, 90]]}}
}
MANY = {"team": {"robots": 16, "placement": {"distance_m_max": 14.0}}, "ticks_max": 150}
CASES = {
    **{f"sim{k}": (f"sim{k}", ()) for k in range(1, 6)},
    "chase": (CHASE, ()),
    "tall": (TALL, ()),
    "many": (MANY, ("seed=3",)),
    "unicycle": ("sim1", ("team.motion=unicycle",)),
    "failed": ("sim1", ("ticks_max=25",)),
    "fewer": ("sim1", ("capture.count=3", "capture.stop_distance_m=1.2")),
    "silent": (
        "sim1",
        (
            'events=[{kind="silence",robot="r2",tick=5,ticks=10},'
            '{kind="silence",robot="r4",tick=12,ticks=300}]',
        ),
    ),
    "lost": (
        "sim1",
        (
            'events=[{kind="crash",robot="r4",tick=8,ticks=9},'
            '{kind="crash",robot="r2",tick=20},{kind="silence",robot="r2",tick=18,ticks=9}]',
        ),
    ),
}
SIMULATIONS = [name for name in CASES if name.startswith("sim")]
SPREAD_OUT = sorted(CASES.keys() - {"chase", "tall"})


@pytest.fixture(scope="module")
def hunts(tmp_path_factory):
    """Hunts by name, each with its figure; each is made at its first use."""
    made = {}

    def hunt(name):
        if name not in made:
            out = tmp_path_factory.mktemp(name) / "run"
            scenario, changes = CASES[name]
            done = run(scenario, link="memory", out=out, overrides=changes)
            made[name] = (done, ground_truth_of(read_recording(out)), _drawn(out))
        return made[name]

    return hunt


def _drawn(directory):
    drawn = []
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(run_figures, "save_png", lambda figure, path: drawn.append(figure))
        draw_run(directory, directory / "t.png")
    (figure,) = drawn
    figure.draw_without_rendering()
    return figure


def legend_of(figure):
    (legend,) = [*figure.legends, *filter(None, [figure.axes[0].get_legend()])]
    return legend


def entries_of(figure):
    return [text.get_text() for text in legend_of(figure).get_texts()]


def labels_of(figure):
    return {text.get_text(): text for text in figure.axes[0].texts}


def numerals_of(figure):
    """Number, position and text of every time label."""
    small = min(text.get_fontsize() for text in figure.axes[0].texts)
    texts = [text for text in figure.axes[0].texts if text.get_fontsize() == small]
    return [(int(t.get_text()), t.xy, t) for t in texts if t.get_text().isdigit()]


def shown(ground_truth):
    """All positions of bodies, in m."""
    return ground_truth.positions.reshape(-1, 2)


@pytest.mark.parametrize("name", SPREAD_OUT)
def test_what_happened_fills_the_axes(hunts, name):
    _, ground_truth, figure = hunts(name)
    (axes,) = figure.axes
    fixed = [np.array(o.position) for o in ground_truth.scenario.obstacles]
    corners = [p + s for p in fixed for s in (-0.8, 0.8)]
    positions = np.vstack([shown(ground_truth), *corners])
    box = axes.transData.transform([positions.min(axis=0), positions.max(axis=0)])
    share = np.prod(box[1] - box[0]) / (axes.bbox.width * axes.bbox.height)
    assert share > 0.75
    assert axes.bbox.width * axes.bbox.height / np.prod(figure.bbox.size) > 0.55


@pytest.mark.parametrize(("name", "along"), [("chase", 0), ("tall", 1)])
def test_a_long_thin_hunt_makes_a_long_thin_picture(hunts, name, along):
    _, ground_truth, figure = hunts(name)
    (axes,) = figure.axes
    box = axes.transData.transform(
        [shown(ground_truth).min(axis=0), shown(ground_truth).max(axis=0)]
    )
    sizes = axes.bbox.size
    assert (box[1] - box[0])[along] > 0.88 * sizes[along]
    assert sizes[along] > 3.5 * sizes[1 - along]
    assert figure.bbox.size[1 - along] < figure.bbox.size[along]


@pytest.mark.parametrize("name", CASES)
def test_a_metre_is_as_long_upwards_as_across_and_axes_have_units(hunts, name):
    axes = hunts(name)[2].axes[0]
    (x0, y0), (x1, y1) = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)])
    assert x1 - x0 == pytest.approx(y1 - y0)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (m)", "y (m)")


@pytest.mark.parametrize("name", [*SIMULATIONS, "chase", "unicycle", "silent", "lost"])
def test_times_are_numbered_at_the_same_ticks_for_all(hunts, name):
    _, ground_truth, figure = hunts(name)
    numerals = numerals_of(figure)
    ticks = sorted({number for number, _, _ in numerals})
    steps = {b - a for a, b in pairwise([0, *ticks])}
    assert len(ticks) in range(2, 7)
    (step,) = steps
    assert f"every {step} ticks, numbered" in entries_of(figure)
    for tick in ticks:
        positions = {position for number, position, _ in numerals if number == tick}
        expected = {
            tuple(position) for position in ground_truth.positions[ground_truth.row(tick)].tolist()
        }
        assert positions <= expected
    # Where all bodies are close to the target, one or two labels may find no free box.
    assert len(numerals) >= 0.9 * len(ticks) * ground_truth.positions.shape[1]


@pytest.mark.parametrize("name", CASES)
def test_no_label_covers_another_or_the_legend_or_leaves_the_axes(hunts, name):
    figure = hunts(name)[2]
    (axes,) = figure.axes
    texts = [text for text in axes.texts if text.get_fontsize() < 7.0]
    boxes = [text.get_window_extent() for text in texts]
    for one, other in combinations(boxes, 2):
        shared = matplotlib.transforms.Bbox.intersection(one, other)
        assert shared is None or shared.width * shared.height < 0.05 * one.width * one.height
    for box in boxes:
        assert not box.overlaps(legend_of(figure).get_window_extent())
        assert axes.bbox.x0 <= box.x0 < box.x1 <= axes.bbox.x1
        assert axes.bbox.y0 <= box.y0 < box.y1 <= axes.bbox.y1


@pytest.mark.parametrize("name", CASES)
def test_the_legend_is_in_the_picture_and_covers_nothing_that_happened(hunts, name):
    _, ground_truth, figure = hunts(name)
    box = legend_of(figure).get_window_extent()
    assert 0.0 <= box.x0 < box.x1 <= figure.bbox.width + 1.0
    assert 0.0 <= box.y0 < box.y1 <= figure.bbox.height + 1.0
    (axes,) = figure.axes
    for x, y in axes.transData.transform(shown(ground_truth)):
        assert not (box.x0 <= x <= box.x1 and box.y0 <= y <= box.y1)


@pytest.mark.parametrize("name", CASES)
def test_the_title_and_the_axes_labels_are_in_the_picture(hunts, name):
    figure = hunts(name)[2]
    (axes,) = figure.axes
    for text in (axes._left_title, axes.xaxis.label, axes.yaxis.label):
        box = text.get_window_extent()
        assert 0.0 <= box.x0 <= box.x1 <= figure.bbox.width
        assert 0.0 <= box.y0 <= box.y1 <= figure.bbox.height


@pytest.mark.parametrize(("name", "needed"), [("fewer", 3), ("many", 5), ("lost", 3)])
def test_it_says_and_shows_who_captured_when_not_all_did(hunts, name, needed):
    hunt, ground_truth, figure = hunts(name)
    assert hunt.captured
    last = hunt.result.distances_m
    away = {robot for _, robot, what in hunt.result.departures if what.startswith("lost")}
    away -= {robot for _, robot, what in hunt.result.departures if what == "back"}
    limit_m = hunt.scenario.capture.stop_distance_m
    near = [r for r, d in zip(hunt.scenario.ids, last, strict=True) if d <= limit_m]
    captors = [robot for robot in near if robot not in away]
    title = figure.axes[0].get_title(loc="left").replace("\n", " ")
    assert title.endswith(f" by {', '.join(captors)} ({needed} needed)")
    assert "captured it" in entries_of(figure)
    discs = {tuple(p.center): p.get_facecolor() for p in figure.axes[0].patches}
    for robot, position in zip(hunt.scenario.ids, ground_truth.robots[-1].tolist(), strict=True):
        white = discs[tuple(position)] == (1.0, 1.0, 1.0, 1.0)
        assert white == (robot not in captors)


@pytest.mark.parametrize("name", [*SIMULATIONS, "chase", "failed"])
def test_where_all_captured_or_none_nobody_is_named(hunts, name):
    figure = hunts(name)[2]
    title = figure.axes[0].get_title(loc="left")
    assert title.split("\n")[-1].startswith(("captured at tick", "not captured in"))
    assert "needed" not in title
    assert not {"captured it", "radio off", "lost"} & set(entries_of(figure))


def test_silence_is_marked_where_it_was_and_when(hunts):
    _, ground_truth, figure = hunts("silent")
    assert "radio off" in entries_of(figure)
    (entry,) = [h for h in legend_of(figure).legend_handles if h.get_label() == "radio off"]
    under = [x for x in figure.axes[0].lines if x.get_color() == entry.get_color()]
    last = ground_truth.last_tick
    for line, (robot, first, after) in zip(under, [(1, 5, 15), (3, 12, last)], strict=True):
        np.testing.assert_array_equal(
            line.get_xydata(), ground_truth.robots[first : after + 1, robot]
        )
    labels = labels_of(figure)
    for text, robot, tick in (("off 5", 1, 5), ("on 15", 1, 15), ("off 12", 3, 12)):
        assert dist(labels[text].xy, ground_truth.robots[tick, robot]) < 1e-9
    assert not any(text.startswith("on ") for text in labels if text != "on 15")


def test_losses_are_marked_as_the_result_tells_them(hunts):
    hunt, ground_truth, figure = hunts("lost")
    assert "lost" in entries_of(figure)
    labels = labels_of(figure)
    assert {what.partition(":")[0] for _, _, what in hunt.result.departures} == {"lost", "back"}
    for tick, robot, what in hunt.result.departures:
        position = ground_truth.robots[tick, hunt.scenario.ids.index(robot)]
        assert dist(labels[f"{what.partition(':')[0]} {tick}"].xy, position) < 1e-9
    # A lost robot is not marked as silent too.
    assert dist(labels["off 18"].xy, ground_truth.robots[18, 1]) < 1e-9
    assert ground_truth.silent.sum() == 2
    for robot, span in ((3, range(8, 17)), (1, range(20, ground_truth.last_tick + 1))):
        assert np.flatnonzero(ground_truth.lost[:, robot]).tolist() == list(span)


@pytest.mark.parametrize("share", [0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9])
def test_nobody_is_taken_for_lost_where_a_recording_breaks_off(tmp_path, share):
    run("sim1", link="memory", out=tmp_path / "whole")
    whole = (tmp_path / "whole" / "recording.mcap").read_bytes()
    (tmp_path / "recording.mcap").write_bytes(whole[: int(share * len(whole))])
    assert not ground_truth_of(read_recording(tmp_path)).lost.any()


def test_robots_of_one_colour_differ_in_line_and_marker(tmp_path):
    run({"team": {"robots": 8}, "ticks_max": 2}, link="memory", out=tmp_path / "run")
    handles = legend_of(_drawn(tmp_path / "run")).legend_handles[:8]
    looks = [(h.get_color(), h.get_marker(), str(h._unscaled_dash_pattern)) for h in handles]
    for part in (slice(0, 2), slice(0, 3, 2)):
        assert len({look[part] for look in looks}) == 8


@given(st.integers(1, 10**6), st.integers(1, 256))
def test_times_are_marked_at_round_ticks_and_not_too_often(last_tick, robots):
    from encircle.figures.trajectories import TIME_MARKS_MAX, TIMES_MAX, time_mark_period_ticks

    step = time_mark_period_ticks(last_tick, robots)
    assert str(step).rstrip("0") in {"1", "2", "5"}
    marks = last_tick // step
    assert marks <= TIME_MARKS_MAX
    assert marks <= 1 or marks * (robots + 1) <= TIMES_MAX
    if step > 1 and robots < 9:
        assert marks >= 2, "with few robots two marks at least"


def test_the_picture_in_the_readme_is_of_this_program(hunts, tmp_path):
    """The edges of letters are not compared, because they depend on the renderer."""
    draw_run(hunts("sim1")[0].out, tmp_path / "t.png")
    ours, shipped = imread(tmp_path / "t.png"), imread(HUNT)
    assert ours.shape == shipped.shape
    assert (np.abs(ours - shipped).max(axis=2) < 0.2).mean() > 0.99
