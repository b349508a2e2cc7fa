"""Figures of runs: what is drawn, where it is drawn, and figures of interrupted runs."""

from itertools import combinations
from math import cos, dist, hypot, inf, pi, sin

import numpy as np
import pytest
from matplotlib.image import imread
from matplotlib.legend import Legend
from matplotlib.patches import Circle

from encircle.agents.planning.ring import encirclement_points
from encircle.figures import drawing, run_figures
from encircle.figures.run_figures import (
    TimeCurve,
    draw_execution_times,
    draw_run,
    draw_snapshots,
    draw_trajectories,
)
from encircle.protocol.messages import Command
from encircle.runlog.ground_truth import (
    commands_at,
    estimates_agree,
    ground_truth_of,
    points_shared,
    ring_centre,
)
from encircle.runner.hunts import run
from encircle.world.recording.recording import read_recording

OKABE_ITO = {"#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7", "#000000"}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Directories of recorded runs by scenario; each run is made at its first use."""
    made = {}

    def directory(name):
        if name not in made:
            made[name] = tmp_path_factory.mktemp(name) / "run"
            scenario = {"team": {"robots": int(name[4:])}} if name[:4] == "team" else name
            longest = ["ticks_max=2", "team.placement.distance_m_max=30"]
            run(scenario, link="memory", out=made[name], overrides=longest * (name[:4] == "team"))
        return made[name]

    return directory


@pytest.fixture
def shown(monkeypatch):
    """The figures passed to ``save_png``, laid out but not rendered, in their order."""
    drawn = []

    def save(figure, path):
        figure.draw_without_rendering()
        drawn.append(figure)
        return path

    monkeypatch.setattr(run_figures, "save_png", save)
    return drawn


def legend_of(figure):
    return [text.get_text() for text in the_legend(figure).get_texts()]


def the_legend(figure):
    """The only legend of a figure, beside the axes or in them."""
    (legend,) = [*figure.legends, *filter(None, [figure.axes[0].get_legend()])]
    return legend


def circles(axes, radius_m):
    return [
        p.center
        for p in axes.patches
        if isinstance(p, Circle) and p.radius == pytest.approx(radius_m)
    ]


def cut(directory, share, into):
    """A copy of a recording that ends in the middle, like that of a killed run."""
    whole = (directory / "recording.mcap").read_bytes()
    into.mkdir()
    (into / "recording.mcap").write_bytes(whole[: int(share * len(whole))])
    return into


def command(robot, point, goal, estimate=(0.0, 0.0), team=4, tick=0):
    names = tuple(f"r{k + 1}" for k in range(team))
    return Command(robot, tick, (0.0, 0.0), "encircle", 2.0, point, goal, estimate, "spline", names)


def test_a_runs_picture_has_its_size_and_every_robots_colour(runs, tmp_path):
    path = draw_run(runs("sim1"), tmp_path / "trajectory.png")
    pixels = np.round(255 * imread(path)[:, :, :3]).astype(int)
    height, width = pixels.shape[:2]
    assert 0.9 < width / (drawing.WIDTH_IN * drawing.DOTS_PER_INCH) <= 1.0
    assert 600 <= height <= 2000
    for colour in drawing.COLOURS[:4]:
        expected = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
        assert (np.abs(pixels - expected).max(axis=2) <= 3).sum() > 200, colour
    assert (pixels == 0).all(axis=2).sum() > 1000  # the target's trail, axes and text
    assert (pixels == 255).all(axis=2).mean() < 0.98


def test_a_runs_picture_says_what_it_shows(runs, shown, tmp_path):
    draw_run(runs("sim2"), tmp_path / "t.png")
    (figure,) = shown
    (axes,) = figure.axes
    ground_truth = ground_truth_of(read_recording(runs("sim2")))
    assert (
        axes.get_title(loc="left")
        == f"Simulation 2: three robots among obstacles\n{ground_truth.outcome}"
    )
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (m)", "y (m)")
    assert axes.get_aspect() == 1.0
    assert legend_of(figure) == [
        *("r1", "r2", "r3", "obstacle", "target"),
        *("$D_{stop}$ about the target", "every 10 ticks, numbered"),
    ]


def test_bodies_stand_where_they_ended_and_to_scale(runs, shown, tmp_path):
    draw_run(runs("sim2"), tmp_path / "t.png")
    ground_truth = ground_truth_of(read_recording(runs("sim2")))
    (axes,) = shown[0].axes
    np.testing.assert_allclose(circles(axes, 0.5), ground_truth.positions[-1])
    np.testing.assert_allclose(circles(axes, 1.3), [ground_truth.target[-1]])
    for obstacle in ground_truth.scenario.obstacles:
        assert obstacle.position in circles(axes, obstacle.radius_m)


def test_the_picture_holds_all_that_is_drawn_to_scale(runs, shown, tmp_path):
    for name in ("sim1", "sim2", "sim3"):
        draw_run(runs(name), tmp_path / "t.png")
        (axes,) = shown[-1].axes
        low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
        for patch in axes.patches:
            assert (low <= np.array(patch.center) - patch.radius).all()
            assert (np.array(patch.center) + patch.radius <= high).all()


@pytest.mark.parametrize("robots", [1, 8, 9, 64])
def test_a_legend_names_few_robots_and_counts_many(runs, shown, robots, tmp_path):
    draw_run(runs(f"team{robots}"), tmp_path / "t.png")
    entries = legend_of(shown[0])
    if robots <= 8:
        assert entries[:robots] == [f"r{k + 1}" for k in range(robots)]
        assert len(entries) == robots + 3
    else:
        assert entries[:3] == [f"{robots} robots", "target", "$D_{stop}$ about the target"]
        (times,) = entries[3:]
        assert times.endswith(", numbered")


def test_legends_fit_into_the_picture(runs, shown, tmp_path):
    for name in ("team1", "team8", "sim3"):
        draw_run(runs(name), tmp_path / "t.png")
        draw_snapshots(read_recording(runs(name)), [0, 0, 1, 2], tmp_path / "s.png")
    for figure in shown:
        box = the_legend(figure).get_window_extent()
        assert 0 <= box.x0 < box.x1 <= figure.bbox.width
        for axes in figure.axes if figure.legends else []:
            assert not box.overlaps(axes.get_window_extent())


def test_robots_differ_without_colour(runs, shown, tmp_path):
    draw_run(runs("sim1"), tmp_path / "t.png")
    robots = the_legend(shown[0]).legend_handles[:4]
    assert len({h.get_marker() for h in robots}) == 4
    assert len({str(line) for line in drawing.LINE_STYLES}) == len(drawing.COLOURS)
    assert len(set(drawing.MARKERS)) == len(set(drawing.COLOURS)) == len(drawing.COLOURS)
    assert set(drawing.COLOURS) <= OKABE_ITO


def test_a_run_that_was_killed_is_drawn_as_far_as_it_goes(runs, shown, tmp_path):
    directory = cut(runs("sim3"), 0.6, tmp_path / "cut")
    whole, part = (ground_truth_of(read_recording(d)) for d in (runs("sim3"), directory))
    assert 0 < part.last_tick < whole.last_tick
    np.testing.assert_array_equal(part.positions, whole.positions[: part.last_tick + 1])
    draw_run(directory, tmp_path / "t.png")
    assert (
        shown[0]
        .axes[0]
        .get_title(loc="left")
        .endswith(f"unfinished, the recording ends at tick {part.last_tick}")
    )


def test_a_run_killed_before_its_first_chunk_shows_the_start(runs, tmp_path):
    directory = cut(runs("sim3"), 0.02, tmp_path / "cut")
    assert not read_recording(directory).messages
    ground_truth = ground_truth_of(read_recording(directory))
    np.testing.assert_array_equal(ground_truth.robots[0], ground_truth.scenario.team.positions)
    assert draw_run(directory, tmp_path / "t.png").stat().st_size > 10_000


def test_starts_are_labelled_in_trajectories(runs, shown, tmp_path):
    draw_trajectories(read_recording(runs("sim2")), tmp_path / "fig4.png")
    labels = [t for t in shown[0].axes[0].texts if t.get_text().startswith("$S")]
    assert [t.get_text() for t in labels] == ["$S_{1}$", "$S_{2}$", "$S_{3}$", "$S_{T}$"]
    assert [t.xy for t in labels] == [(-5.0, -1.0), (-6.0, 7.0), (9.0, -6.0), (0.0, 0.0)]


def test_no_legend_is_searched_a_place_for_by_trial(runs, monkeypatch, tmp_path):
    """Matplotlib's own search takes as long as much is drawn, and warns by the clock."""

    def searched(*_):
        raise AssertionError('a legend with loc="best"')

    monkeypatch.setattr(Legend, "_find_best_position", searched)
    recording = read_recording(runs("sim2"))
    draw_trajectories(recording, tmp_path / "t.png")
    draw_snapshots(recording, [0, 1, 2, 3], tmp_path / "s.png")


def test_each_robots_sensing_range_is_its_own(shown, tmp_path):
    out, own = tmp_path / "run", ["team.robots.r2.sensing_range_m=2", "ticks_max=2"]
    run("sim1", link="memory", out=out, overrides=own)
    draw_snapshots(read_recording(out), [0, 0, 1, 2], tmp_path / "s.png")
    starts = ground_truth_of(read_recording(out)).robots[0]
    axes = shown[0].axes[0]
    assert circles(axes, 2.0) == [pytest.approx(starts[1])]
    # The target's is 6 m too.
    assert len(circles(axes, 6.0)) == 4
    np.testing.assert_allclose(circles(axes, 6.0)[:3], starts[[0, 2, 3]])


def test_snapshots_show_trails_up_to_their_ticks(runs, shown, tmp_path):
    recording = read_recording(runs("sim1"))
    ground_truth = ground_truth_of(recording)
    ticks = [0, 7, 12, ground_truth.last_tick]
    draw_snapshots(recording, ticks, tmp_path / "fig3.png", ("", "told", "", ""))
    titles = [axes.get_title() for axes in shown[0].axes]
    assert titles == ["(a) tick 0", "(b) tick 7: told", "(c) tick 12", f"(d) tick {ticks[3]}"]
    for tick, axes in zip(ticks, shown[0].axes, strict=True):
        np.testing.assert_allclose(circles(axes, 0.5), ground_truth.positions[tick])
        assert len(circles(axes, 6.0)) == 5
        assert max(len(line.get_xdata()) for line in axes.lines) == tick + 1


def test_the_ring_is_drawn_while_robots_encircle(runs, shown, tmp_path):
    recording = read_recording(runs("sim1"))
    last = ground_truth_of(recording).last_tick
    draw_snapshots(recording, [0, 5, last - 1, last], tmp_path / "fig3.png")
    first, encircling, shrinking, captured = (circles(axes, 4.0) for axes in shown[0].axes)
    assert first == [(0.0, 0.0)]  # only r1 detected the target: the ring is around its estimate
    assert (len(encircling), shrinking, captured) == (1, [], [])
    goals = [c.goal for c in commands_at(recording, 5)]
    assert len(goals) == 4
    # Robots whose prediction steps differ by one plan rings about 0.2 m apart.
    assert all(abs(dist(goal, encircling[0]) - 4.0) < 0.5 for goal in goals)


def test_a_move_by_hand_is_no_part_of_the_trail(runs, shown, tmp_path):
    draw_run(runs("sim3"), tmp_path / "t.png")
    assert "moved by hand" in legend_of(shown[0])
    for line in shown[0].axes[0].lines:
        if line.get_linestyle() != "None":
            steps = np.diff(np.transpose(line.get_data()), axis=0)
            assert np.hypot(*steps.T).max(initial=0.0) < 0.31


def test_execution_times_are_those_of_the_table(shown, tmp_path):
    mean = np.array([[30.0, 28.0, 33.0], [35.0, 34.0, 36.0]])
    table = [
        TimeCurve("one", (7.0, 9.0), mean, mean + 1.0, (0, 3)),
        TimeCurve("other", (7.0, 9.0), mean + 2.0, mean + 4.0, (0, 0)),
    ]
    draw_execution_times(table, tmp_path / "fig7.png")
    (figure,) = shown
    above, below = figure.axes
    assert legend_of(figure) == ["one", "other"]
    assert below.get_xlabel() == "initial x of R3 (m)"
    assert [axes.get_ylabel() for axes in figure.axes] == ["execution time (ticks)"] * 2
    for bars, row in zip(above.containers, (mean, mean + 2.0), strict=True):
        np.testing.assert_allclose(bars.lines[0].get_ydata(), row[:, 0])
        np.testing.assert_allclose(bars.lines[0].get_xdata(), (7.0, 9.0), atol=0.5)
        spans = [s[:, 1].tolist() for s in bars.lines[2][0].get_segments()]
        np.testing.assert_allclose(spans, row[:, 1:])
    for line, row in zip(below.lines, (mean + 1.0, mean + 4.0), strict=True):
        np.testing.assert_allclose(line.get_ydata(), row[:, 0])
    assert f"reach up to {(mean + 4.0)[:, 2].max():.0f} ticks" in below.get_title()
    assert [t.get_text() for t in below.texts] == ["3"]
    assert not above.texts


@pytest.mark.parametrize("name", ["sim1", "sim2"])
def test_who_sees_whom_and_gaps_agree_with_plain_geometry(runs, name):
    ground_truth = ground_truth_of(read_recording(runs(name)))
    fixed = [(o.position, o.radius_m) for o in ground_truth.scenario.obstacles]
    least = inf
    for row in range(0, len(ground_truth.ticks), 4):
        positions = ground_truth.positions[row].tolist()
        for i, a in enumerate(positions):
            for k, b in enumerate(positions):
                if i != k:
                    clear = all(_distance_to_segment(o, a, b) >= r for o, r in fixed)
                    assert ground_truth.visible[row, i, k] == (dist(a, b) <= 6.0 and clear)
                    assert ground_truth.gaps[row, i, k] == pytest.approx(dist(a, b) - 1.0)
    for positions in ground_truth.positions.tolist():
        bodies = [(p, 0.5) for p in positions]
        for i, (a, ra) in enumerate(bodies):
            for b, rb in [*bodies[:i], *fixed]:
                least = min(least, dist(a, b) - ra - rb)
    assert ground_truth.least_gap()[0] == pytest.approx(least, abs=1e-12)


def _distance_to_segment(point, a, b):
    """Distance from a segment, by sampling with steps smaller than the world's tolerance."""
    (ax, ay), (bx, by), (px, py) = a, b, point
    return min(
        hypot(ax + t * (bx - ax) - px, ay + t * (by - ay) - py) for t in np.linspace(0, 1, 2001)
    )


@pytest.mark.parametrize("points", [(0, 1, 2, 3), (2, 0), (3, 1)])
def test_a_rings_centre_is_found_from_its_points(points):
    centre = np.array([[3.0, -2.0]])
    ring = encirclement_points([(7.0, 5.0), (0.0, 1.0)] * 2, (2.5, -2.0), centre, 4.0)[0]
    plans = [command(f"r{q + 1}", q, tuple(ring[q].tolist()), (2.5, -2.0)) for q in points]
    np.testing.assert_allclose(ring_centre(plans, 4.0), centre[0], atol=1e-9)


def test_without_a_common_ring_its_centre_is_the_mean_estimate():
    alone = command("r1", 1, (4.0, 0.0), (1.0, 0.0))
    other = command("r2", 1, (-9.0, 5.0), (3.0, 4.0))
    assert ring_centre([alone], 4.0) == pytest.approx((1.0, 0.0))
    assert ring_centre([alone, other], 4.0) == pytest.approx((2.0, 2.0))
    assert ring_centre([], 4.0) is None


def test_facts_from_commands(runs):
    recording = read_recording(runs("sim3"))
    ground_truth = ground_truth_of(recording)
    (moved,) = ground_truth.moved_by_hand
    caught_up = estimates_agree(recording, ground_truth, moved, 0.5)
    assert moved < caught_up < moved + 20
    for tick in (moved, caught_up):
        off = [dist(c.estimate, ground_truth.target[tick]) for c in commands_at(recording, tick)]
        assert (max(off) <= 0.5) == (tick == caught_up)
    shared, ticks = points_shared(recording)
    encircling = [
        [c.goal for c in commands_at(recording, t) if c.mode == "encircle"]
        for t in range(ground_truth.last_tick)
    ]
    assert ticks == sum(len(goals) >= 2 for goals in encircling)
    assert shared == sum(
        min((dist(a, b) for a, b in combinations(goals, 2)), default=9.0) < 1.0
        for goals in encircling
    )


def test_headings_and_first_sight(runs):
    ground_truth = ground_truth_of(read_recording(runs("sim1")))
    step = ground_truth.target[4] - ground_truth.target[3]
    angle = ground_truth.heading_rad(3)
    np.testing.assert_allclose((0.2 * cos(angle), 0.2 * sin(angle)), step, atol=1e-5)
    near = [
        t
        for t in ground_truth.ticks
        if dist(ground_truth.robots[t, 2], ground_truth.target[t]) <= 6.0
    ]
    assert ground_truth.first_sight("r3") == near[0] > 0
    assert -pi / 4 < ground_truth.heading_rad(0) < pi / 4
