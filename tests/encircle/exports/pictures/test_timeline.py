"""Moments of a video: as many as the run is long, and the end for a second."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from encircle.exports.pictures.timeline import timeline_of


@pytest.mark.parametrize(
    ("ticks", "tick_s", "fps", "speed", "count"),
    [
        (100, 0.1, 30.0, 1.0, 300 + 30),
        (100, 0.1, 30.0, 2.0, 150 + 30),
        (100, 0.1, 12.0, 0.5, 240 + 12),
        (34, 0.1, 12.0, 1.0, 41 + 12),
        (0, 0.1, 30.0, 1.0, 30),
        (7, 0.25, 23.976, 1.0, 42 + 24),
    ],
)
def test_a_video_is_as_long_as_its_run_and_a_second(ticks, tick_s, fps, speed, count):
    timeline = timeline_of(0, ticks, tick_s, fps, speed)
    moments = list(timeline.moments())
    assert len(moments) == timeline.count == count
    assert moments[-1] == ticks
    assert len(timeline.times_s()) == count + 1


def test_ticks_of_a_tenth_of_a_second_are_three_pictures_each_exactly():
    moments = list(timeline_of(0, 100, 0.1, 30.0, 1.0).moments())
    assert moments[::3][:101] == [float(k) for k in range(101)]


@given(
    st.integers(0, 400),
    st.sampled_from([0.01, 0.05, 0.1, 0.3]),
    st.sampled_from([1.0, 12.0, 25.0, 29.97]),
    st.floats(0.05, 20.0),
)
def test_moments_never_go_back_nor_leave_the_run(ticks, tick_s, fps, speed):
    timeline = timeline_of(5, 5 + ticks, tick_s, fps, speed)
    moments = list(timeline.moments())
    assert moments == sorted(moments)
    assert moments[0] >= 5.0
    assert moments[-1] == 5.0 + ticks
    moving_s = Fraction(timeline.moving) / timeline.fps
    assert float(moving_s) == pytest.approx(ticks * tick_s / speed, abs=1.001 / fps)
