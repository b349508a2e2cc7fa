"""Where labels go: beside their places, over as little as can be, and never over others."""

from itertools import combinations
from math import hypot

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from encircle.figures.label_placement import (
    REACHES,
    Page,
    along,
    covers,
    free_corner,
    overlap,
    within,
)

FRAME = (0.0, 0.0, 100.0, 80.0)
NOTHING = np.zeros((0, 2))
places = st.tuples(st.floats(0.0, 100.0), st.floats(0.0, 80.0))
sizes = st.tuples(st.floats(1.0, 30.0), st.floats(1.0, 12.0))


def away_from(at, box):
    """Distance from a place to a box, by its nearest point."""
    nearest = [min(max(at[k], box[k]), box[k + 2]) for k in (0, 1)]
    return hypot(at[0] - nearest[0], at[1] - nearest[1])


@given(st.lists(st.tuples(places, sizes), max_size=40))
def test_labels_are_beside_their_places_within_the_frame_and_apart(wanted):
    page = Page(FRAME, NOTHING)
    boxes = [(at, size, page.put(at, size, 3.0)) for at, size in wanted]
    put = [(at, size, box) for at, size, box in boxes if box is not None]
    for at, (width, height), box in put:
        assert within(box, FRAME)
        assert abs(box[2] - box[0] - width) < 1e-6
        assert abs(box[3] - box[1] - height) < 1e-6
        assert 2.9 < away_from(at, box) < 1.5 * 3.0 * REACHES[-1]
    for (_, _, one), (_, _, other) in combinations(put, 2):
        assert not overlap(one, other)


def test_a_label_goes_where_it_covers_least():
    # A line to the right of the place, and one below it.
    ink = along(
        [np.array([[50.0, 40.0], [100.0, 40.0]]), np.array([[0.0, 34.0], [100.0, 34.0]])], 1
    )
    box = Page(FRAME, ink).put((50.0, 40.0), (10.0, 6.0), 3.0)
    assert covers(box, ink) == 0


def test_a_label_without_a_place_is_left_out():
    page = Page((0.0, 0.0, 10.0, 10.0), NOTHING)
    assert page.put((5.0, 5.0), (9.0, 9.0), 3.0) is None
    assert page.taken == []


def test_the_first_free_corner_is_found():
    upper_right, lower_right = np.array([[95.0, 75.0]]), np.array([[95.0, 5.0]])
    left = np.array([[5.0, 5.0], [5.0, 75.0]])
    size = (20.0, 20.0)
    assert free_corner(Page(FRAME, NOTHING), size) == "upper right"
    assert free_corner(Page(FRAME, upper_right), size) == "lower right"
    assert free_corner(Page(FRAME, np.vstack([upper_right, lower_right])), size) == "upper left"
    everywhere = np.vstack([upper_right, lower_right, left])
    assert free_corner(Page(FRAME, everywhere), size) is None
    assert free_corner(Page(FRAME, NOTHING), (101.0, 5.0)) is None
    taken = Page(FRAME, NOTHING, [(90.0, 60.0, 100.0, 80.0)])
    assert free_corner(taken, size) == "lower right"


@given(st.lists(places, min_size=1, max_size=10), st.floats(0.5, 20.0))
def test_points_along_a_line_are_close_together_and_on_it(corners, step):
    line = np.array(corners)
    found = along([line], step)
    gaps = np.hypot(*np.diff(found, axis=0).T)
    assert (gaps <= step + 1e-9).all()
    length = np.hypot(*np.diff(line, axis=0).T).sum()
    assert abs(gaps.sum() - length) < 1e-6 * (1.0 + length)
    assert all((np.hypot(*(found - corner).T) < 1e-9).any() for corner in line)
