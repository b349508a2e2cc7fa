"""What robots and target can sense: range, line of sight, noise, and the range scan.

Bodies are discs. Something is in sight if its centre is within the sensing range and no obstacle
lies on the line between the centres; other bodies do not hide anything. The scan is a ring of rays,
each reporting the nearest surface.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encircle.protocol.messages import Point
from encircle.world.arena.dynamics import quantised
from encircle.world.random_streams import Purpose, normal_pairs

FEW_PAIRS_MAX = 100
"""Up to so many pairs of bodies all rays of each are computed, which takes fewer calls."""
SLIM_SHARE = 0.99
"""Of half the angle between two rays: a body seen under less meets one ray at most."""


class Geometry(NamedTuple):
    """Relative positions of everything, computed once per tick.

    Rows are the B moving bodies (robots, then the target), columns those and the O obstacles.
    ``x``, ``y``: column minus row, in m; ``distances``: between centres; ``gaps``: between
    surfaces, infinite on the diagonal.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    distances: NDArray[np.float64]
    gaps: NDArray[np.float64]


def geometry(positions: NDArray[np.float64], radii: NDArray[np.float64], moving: int) -> Geometry:
    """Geometry of bodies at ``positions`` (B + O, 2) with ``radii`` (B + O,); B of them move."""
    px, py = positions[:, 0], positions[:, 1]
    x = px - px[:moving, None]
    y = py - py[:moving, None]
    distances = np.sqrt(x * x + y * y)
    gaps = distances - radii
    gaps -= radii[:moving, None]
    gaps[_diagonal(moving)] = np.inf
    return Geometry(x, y, distances, gaps)


@lru_cache(maxsize=64)
def _diagonal(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    rows = np.arange(count)
    return rows, rows


def in_sight(
    geo: Geometry, ranges: NDArray[np.float64], radii: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(B, B) whether row body senses column body: in range, and no obstacle between."""
    count = len(geo.x)
    visible: NDArray[np.bool_] = geo.distances[:, :count] <= ranges[:, None]
    visible[_diagonal(count)] = False
    if geo.x.shape[1] > count and visible.any():
        rows, columns = np.nonzero(visible)
        tx, ty = geo.x[rows, columns, None], geo.y[rows, columns, None]
        ox, oy = geo.x[rows, count:], geo.y[rows, count:]
        # The obstacle's centre projected onto the line of sight, kept between the two ends.
        along = np.clip((ox * tx + oy * ty) / (tx * tx + ty * ty), 0.0, 1.0)
        dx, dy = ox - along * tx, oy - along * ty
        hidden = (dx * dx + dy * dy < radii[count:] ** 2).any(axis=1)
        visible[rows[hidden], columns[hidden]] = False
    return visible


@lru_cache(maxsize=16)
def ray_directions(rays: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cosines and sines of a scan's rays, the first along +x, counter-clockwise."""
    bearings = np.arange(rays) * (2.0 * np.pi / rays)
    return np.cos(bearings), np.sin(bearings)


def scan(
    geo: Geometry, ranges: NDArray[np.float64], radii: NDArray[np.float64], rays: int
) -> NDArray[np.float64]:
    """(B, rays) distances in m from each body to the nearest surface, at most its range."""
    count = len(geo.x)
    near = geo.distances - radii < ranges[:, None]
    near[_diagonal(count)] = False
    if near.size <= FEW_PAIRS_MAX:
        return _scan_of_few(geo, near, ranges, radii, rays)
    result = np.repeat(ranges[:, None], rays, axis=1)
    rows, columns = np.nonzero(near)
    if len(rows) > FEW_PAIRS_MAX:
        slim = geo.distances[rows, columns] > radii[columns] / np.sin(SLIM_SHARE * np.pi / rays)
        _scan_slim(geo, radii, rows[slim], columns[slim], result)
        rows, columns = rows[~slim], columns[~slim]
    if len(rows) == 0:
        return result
    cos, sin = ray_directions(rays)
    x, y = geo.x[rows, columns, None], geo.y[rows, columns, None]
    reach = _reach(x, y, radii[columns, None], cos, sin)
    # Pairs come sorted by row, so each row's pairs are one run.
    starts = np.concatenate(([0], np.flatnonzero(rows[1:] != rows[:-1]) + 1))
    nearest = np.minimum.reduceat(reach, starts, axis=0)
    seen = rows[starts]
    result[seen] = np.minimum(result[seen], np.maximum(nearest, 0.0))
    return result


def _scan_of_few(
    geo: Geometry,
    near: NDArray[np.bool_],
    ranges: NDArray[np.float64],
    radii: NDArray[np.float64],
    rays: int,
) -> NDArray[np.float64]:
    """As ``scan``: to sort out the pairs that are ``near`` would take longer than all of them."""
    if not near.any():
        return np.repeat(ranges[:, None], rays, axis=1)
    cos, sin = ray_directions(rays)
    reach = _reach(geo.x[:, :, None], geo.y[:, :, None], radii[:, None], cos, sin)
    nearest = np.minimum.reduce(reach, axis=1, where=near[:, :, None], initial=np.inf)
    np.maximum(nearest, 0.0, out=nearest)
    return np.minimum(nearest, ranges[:, None], out=nearest)


def _scan_slim(
    geo: Geometry,
    radii: NDArray[np.float64],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    result: NDArray[np.float64],
) -> None:
    """Put the surfaces of bodies that one ray at most can meet into ``result``, row by row.

    Seen from afar a body is narrower than the angle between two rays. Of all rays only the one
    nearest to its bearing can meet it, so that a pair costs one ray and not all of them.
    """
    rays = result.shape[1]
    x, y = geo.x[rows, columns], geo.y[rows, columns]
    ray = np.rint(np.arctan2(y, x) * (rays / (2.0 * np.pi))).astype(np.intp) % rays
    cos, sin = ray_directions(rays)
    reach = _reach(x, y, radii[columns], cos[ray], sin[ray])
    met = reach < np.inf
    np.minimum.at(result, (rows[met], ray[met]), np.maximum(reach[met], 0.0))


def _reach(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    radii: NDArray[np.float64],
    cos: NDArray[np.float64],
    sin: NDArray[np.float64],
) -> NDArray[np.float64]:
    """How far along rays the surface of a disc at ``x``, ``y`` is, infinite where it is not met."""
    aside = x * sin
    aside -= y * cos
    ahead = x * cos
    ahead += y * sin
    aside *= aside
    half_squared = np.subtract(radii * radii, aside, out=aside)
    missed = half_squared < 0.0
    missed |= ahead <= 0.0
    np.maximum(half_squared, 0.0, out=half_squared)
    ahead -= np.sqrt(half_squared, out=half_squared)
    np.copyto(ahead, np.inf, where=missed)
    return ahead


def detected(
    target: NDArray[np.float64], noise_m_std: float, seed: int, tick: int, count: int
) -> list[Point]:
    """Where each of N robots takes the target at ``target`` (2,) to be, in m, were it in sight.

    Each with noise of its own, of that standard deviation per axis.
    """
    if noise_m_std == 0.0:
        return [tuple(target.tolist())] * count
    noise = noise_m_std * normal_pairs(seed, Purpose.DETECTION_NOISE, tick, count)
    return [tuple(p) for p in quantised(target + noise).tolist()]
