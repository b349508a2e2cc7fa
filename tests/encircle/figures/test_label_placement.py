"""Label placement: labels lie near their points, cover little, and never cover each other."""

from itertools import combinations
from math import hypot

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from encircle.figures.label_placement import (
    GAP_MULTIPLES,
    LabelCanvas,
    boxes_overlap,
    free_corner,
    is_inside,
    points_along,
    points_covered,
)

FRAME = (0.0, 0.0, 100.0, 80.0)
NOTHING = np.zeros((0, 2))
places = st.tuples(st.floats(0.0, 100.0), st.floats(0.0, 80.0))
sizes = st.tuples(st.floats(1.0, 30.0), st.floats(1.0, 12.0))


def away_from(at, box):
    """Distance from a point to the nearest point of a box."""
    nearest = [min(max(at[k], box[k]), box[k + 2]) for k in (0, 1)]
    return hypot(at[0] - nearest[0], at[1] - nearest[1])


@given(st.lists(st.tuples(places, sizes), max_size=40))
def test_labels_are_beside_their_places_within_the_frame_and_apart(requests):
    canvas = LabelCanvas(FRAME, NOTHING)
    boxes = [(at, size, canvas.place(at, size, 3.0)) for at, size in requests]
    put = [(at, size, box) for at, size, box in boxes if box is not None]
    for at, (width, height), box in put:
        assert is_inside(box, FRAME)
        assert abs(box[2] - box[0] - width) < 1e-6
        assert abs(box[3] - box[1] - height) < 1e-6
        assert 2.9 < away_from(at, box) < 1.5 * 3.0 * GAP_MULTIPLES[-1]
    for (_, _, one), (_, _, other) in combinations(put, 2):
        assert not boxes_overlap(one, other)


def test_a_label_goes_where_it_covers_least():
    # A line to the right of the point, and one below it.
    ink = points_along(
        [np.array([[50.0, 40.0], [100.0, 40.0]]), np.array([[0.0, 34.0], [100.0, 34.0]])], 1
    )
    box = LabelCanvas(FRAME, ink).place((50.0, 40.0), (10.0, 6.0), 3.0)
    assert points_covered(box, ink) == 0


def test_a_label_without_a_place_is_left_out():
    canvas = LabelCanvas((0.0, 0.0, 10.0, 10.0), NOTHING)
    assert canvas.place((5.0, 5.0), (9.0, 9.0), 3.0) is None
    assert canvas.occupied == []


def test_the_first_free_corner_is_found():
    upper_right, lower_right = np.array([[95.0, 75.0]]), np.array([[95.0, 5.0]])
    left = np.array([[5.0, 5.0], [5.0, 75.0]])
    size = (20.0, 20.0)
    assert free_corner(LabelCanvas(FRAME, NOTHING), size) == "upper right"
    assert free_corner(LabelCanvas(FRAME, upper_right), size) == "lower right"
    assert (
        free_corner(LabelCanvas(FRAME, np.vstack([upper_right, lower_right])), size) == "upper left"
    )
    everywhere = np.vstack([upper_right, lower_right, left])
    assert free_corner(LabelCanvas(FRAME, everywhere), size) is None
    assert free_corner(LabelCanvas(FRAME, NOTHING), (101.0, 5.0)) is None
    occupied = LabelCanvas(FRAME, NOTHING, [(90.0, 60.0, 100.0, 80.0)])
    assert free_corner(occupied, size) == "lower right"


@given(st.lists(places, min_size=1, max_size=10), st.floats(0.5, 20.0))
def test_points_along_a_line_are_close_together_and_on_it(corners, step):
    line = np.array(corners)
    points = points_along([line], step)
    gaps = np.hypot(*np.diff(points, axis=0).T)
    assert (gaps <= step + 1e-9).all()
    length = np.hypot(*np.diff(line, axis=0).T).sum()
    assert abs(gaps.sum() - length) < 1e-6 * (1.0 + length)
    assert all((np.hypot(*(points - corner).T) < 1e-9).any() for corner in line)
