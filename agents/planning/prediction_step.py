"""How far ahead to look: the prediction step xi* with the smallest weighted variance (Eq. 2-3)."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from encircle.agents.planning.assignment import whole_quanta


@lru_cache(maxsize=64)
def deviation_weights(xi_grid: tuple[float, ...], xi_weight: float) -> NDArray[np.float64]:
    """f(xi) = exp(k xi), the deviation weighting function, for each xi."""
    return np.exp(xi_weight * np.array(xi_grid))


def variances(distances: NDArray[np.float64]) -> NDArray[np.float64]:
    """V(xi) of Eq. 2 for each row of ``distances`` (G, N) in m; (G,) in m^2."""
    count = distances.shape[1]
    # About the first: of whole numbers the sums are exact, in whatever order they come.
    away = distances - distances[:, :1]
    total = np.add.reduce(away, axis=1)
    away *= away
    result: NDArray[np.float64] = np.add.reduce(away, axis=1) * count - total * total
    result /= count**2
    return result


def best_step(distances: NDArray[np.float64], xi_grid: tuple[float, ...], xi_weight: float) -> int:
    """Index into ``xi_grid`` of xi* (Eq. 3). Ties go to the smaller xi.

    Distances count in whole microns, as in ``encircle.agents.planning.assignment``: rounding noise
    must not decide.
    """
    microns = whole_quanta(distances)
    return int((variances(microns) * deviation_weights(xi_grid, xi_weight)).argmin())
