"""Two estimates of one target made one, although nobody knows how their errors are correlated.

Estimates that robots tell each other contain each other's information, by ways that nobody keeps
account of. Covariance intersection (Julier, Uhlmann 1997, "A non-divergent estimation algorithm in
the presence of unknown correlations", Proc. American Control Conference) weighs the two inverse
covariances, with 0 <= w <= 1:

    P^-1   = w P1^-1 + (1 - w) P2^-1
    P^-1 x = w P1^-1 x1 + (1 - w) P2^-1 x2

If both estimates are consistent, P - E[e e'] is positive semidefinite for the result's error e,
whatever the correlation. The price is that independent estimates are not used in full.

w is the one that minimises det P. Unlike the trace, the determinant does not depend on the units of
position and velocity. The two axes are the same filter run twice
(``encircle.agents.estimation.kalman``), so one 2 x 2 covariance serves both, and the determinant of
the whole is the square of its determinant. With A = P1^-1, B = P2^-1 and D = A - B,

    det(B + w D) = det B + w tr(adj(B) D) + w^2 det D,

so w is had in closed form: the vertex of this parabola if it opens downwards and lies between 0 and
1, else the better end. An end means that one estimate is no worse than the other in any direction,
or hardly. Where the covariances are equal every w is as good, and w is 1/2.

Beside it, for comparison, ``product``: the product of the two Gaussians, both with weight 1. It is
right for independent errors only, and counts twice what both estimates contain.
"""

from encircle.agents.estimation.kalman import Estimate

SAME_SHARE = 1e-6
"""Covariances closer than this, relative to each other in every direction, count as equal.

There w hangs on the last bits, and with it the mean; a weight of 1/2 does not.
"""

Matrix = tuple[float, float, float]
"""A symmetric 2 x 2 matrix: upper left, off the diagonal, lower right."""


def intersection(first: Estimate, second: Estimate) -> Estimate:
    """The covariance intersection of two estimates, of the least determinant.

    Their covariances are positive definite; so is the result's. Neither order nor units matter.
    """
    a, b = _inverse(first.covariance), _inverse(second.covariance)
    weight = _weight(a, b)
    return _combined(first, second, _scaled(a, weight), _scaled(b, 1.0 - weight))


def product(first: Estimate, second: Estimate) -> Estimate:
    """The two estimates fused as if their errors were independent; covariances as above."""
    return _combined(first, second, _inverse(first.covariance), _inverse(second.covariance))


def weight_of_first(first: Matrix, second: Matrix) -> float:
    """w, the weight of the first of two covariances, from 0 to 1."""
    return _weight(_inverse(first), _inverse(second))


def _weight(a: Matrix, b: Matrix) -> float:
    d00, d01, d11 = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    determinant_b = b[0] * b[2] - b[1] * b[1]
    # In units of det B: s + t and s t for the relative differences s, t along the two common axes.
    total = (b[2] * d00 - 2.0 * b[1] * d01 + b[0] * d11) / determinant_b
    both = (d00 * d11 - d01 * d01) / determinant_b
    if total * total - 2.0 * both <= SAME_SHARE * SAME_SHARE:
        return 0.5
    if both < 0.0:
        return min(1.0, max(0.0, -total / (2.0 * both)))
    return 1.0 if total > 0.0 else 0.0


def _combined(first: Estimate, second: Estimate, a: Matrix, b: Matrix) -> Estimate:
    """The mean of two estimates weighted by a and b, with the covariance (a + b)^-1."""
    p00, p01, p11 = _inverse((a[0] + b[0], a[1] + b[1], a[2] + b[2]))
    # The gain P b of the second: exact where both means agree, whatever the weights.
    g00, g01 = p00 * b[0] + p01 * b[1], p00 * b[1] + p01 * b[2]
    g10, g11 = p01 * b[0] + p11 * b[1], p01 * b[1] + p11 * b[2]
    dx, dy = second.x - first.x, second.y - first.y
    dvx, dvy = second.vx - first.vx, second.vy - first.vy
    return Estimate(
        first.x + g00 * dx + g01 * dvx,
        first.y + g00 * dy + g01 * dvy,
        first.vx + g10 * dx + g11 * dvx,
        first.vy + g10 * dy + g11 * dvy,
        (p00, p01, p11),
    )


def _inverse(matrix: Matrix) -> Matrix:
    m00, m01, m11 = matrix
    determinant = m00 * m11 - m01 * m01
    return m11 / determinant, -m01 / determinant, m00 / determinant


def _scaled(matrix: Matrix, factor: float) -> Matrix:
    return factor * matrix[0], factor * matrix[1], factor * matrix[2]
