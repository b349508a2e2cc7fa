"""The camera: everybody is seen, and what stands still is not moved."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.exports.pictures.camera import RADIUS_PX_MAX, Camera, camera_path

BOX = (10.0, 20.0, 810.0, 620.0)
RADIUS_M, AROUND_M = 0.5, 1.0


def path_of(positions, tick_s=0.1):
    return camera_path(positions, RADIUS_M, AROUND_M, tick_s, BOX, 1.0)


@settings(max_examples=40)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 120),
    st.floats(0.0, 0.6),
    st.sampled_from([0.001, 0.02, 0.1, 1.0]),
)
def test_every_body_is_in_the_picture_at_every_tick(seed, ticks, step_m, tick_s):
    """Bodies that walk as they like, as far in a tick as fast robots go."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-step_m, step_m, (ticks + 1, 4, 2))
    drift = rng.uniform(-step_m, step_m, (1, 1, 2))
    positions = rng.uniform(-10, 10, (1, 4, 2)) + np.cumsum(steps + drift, axis=0)
    path = path_of(positions, tick_s)
    for row in range(ticks + 1):
        pixels = path.at(row).all_at(positions[row])
        assert (pixels >= (BOX[0], BOX[1])).all()
        assert (pixels <= (BOX[2], BOX[3])).all()


def test_a_team_that_stays_where_it_is_has_a_still_camera():
    rng = np.random.default_rng(1)
    corners = np.array([[0.0, 0.0], [12.0, 0.0], [0.0, 9.0]])
    positions = corners + rng.uniform(-0.2, 0.2, (80, 3, 2))
    path = path_of(positions)
    assert np.ptp(path.scales) == 0.0
    assert np.ptp(path.centres, axis=0).max() == 0.0


def test_a_team_that_closes_in_is_seen_from_nearer_but_not_too_near():
    far = np.array([[-20.0, 0.0], [20.0, 0.0], [0.0, 20.0]])
    shares = np.linspace(1.0, 0.02, 150)
    path = path_of(shares[:, None, None] * far)
    assert path.scales[-1] > 3.0 * path.scales[0]
    assert path.scales.max() * RADIUS_M <= RADIUS_PX_MAX * (1.0 + 1e-9)


def test_places_and_pixels():
    camera = Camera(BOX, (3.0, 4.0), 10.0)
    assert camera.at((3.0, 4.0)) == (410.0, 320.0)
    assert camera.at((4.0, 6.0)) == (420.0, 300.0)
    np.testing.assert_allclose(camera.all_at([(3.0, 4.0), (4.0, 6.0)]), [(410, 320), (420, 300)])
    assert camera.span_m() == (3.0 - 40.0, 4.0 - 30.0, 3.0 + 40.0, 4.0 + 30.0)


@pytest.mark.parametrize(("pixels", "length_m"), [(60, 10.0), (15, 2.0), (9, 1.0), (30, 5.0)])
def test_a_round_length_is_the_shortest_that_is_long_enough(pixels, length_m):
    assert Camera(BOX, (0.0, 0.0), 10.0).round_length_m(pixels) == pytest.approx(length_m)
