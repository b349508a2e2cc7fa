"""Boxes of a picture, whatever its size."""

from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from encircle.exports.pictures.layout import layout_of, size_problem


@given(st.integers(240, 1200), st.integers(240, 1200))
def test_boxes_lie_in_the_picture_and_beside_each_other(half_width, half_height):
    width, height = 2 * half_width, 2 * half_height
    if size_problem(width, height):
        return
    layout = layout_of(width, height)
    boxes = [layout.title, layout.arena, layout.panel, layout.caption]
    for left, top, right, bottom in boxes:
        assert 0.0 <= left < right <= width
        assert 0.0 <= top < bottom <= height
    for one, other in combinations(boxes, 2):
        beside = one[2] <= other[0] or other[2] <= one[0]
        above = one[3] <= other[1] or other[3] <= one[1]
        assert beside or above
    wide, tall = layout.arena[2] - layout.arena[0], layout.arena[3] - layout.arena[1]
    assert wide * tall >= 0.3 * width * height


@pytest.mark.parametrize(
    ("size", "word"),
    [((480, 268), "480x270"), ((3842, 2160), "3840x2160"), ((1281, 720), "even")],
)
def test_sizes_that_cannot_be(size, word):
    assert word in size_problem(*size)


@pytest.mark.parametrize("size", [(480, 270), (270, 480), (3840, 2160), (1280, 720)])
def test_sizes_that_can_be(size):
    assert size_problem(*size) is None
