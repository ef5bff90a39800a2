"""Influence functions w(r/horizon) as tables of cubic pieces.

`cubic` (the B-spline), `conical` (1 - s) and `constant` are exact in this form; `gaussian`, shifted to vanish
at the horizon, is interpolated by cubic Hermite pieces, which is as good a weight as the exponential. All but
`constant` vanish at the horizon, so a bond that enters or leaves does not make the force jump; `constant` is
there for redrawing figures of the literature.
"""

import numpy as np

from periporo.core.jit import inlined

NAMES = ("cubic", "conical", "gaussian", "constant")


def influence_table(name: str) -> np.ndarray:
    """Coefficients (pieces, 4) of the cubic polynomial in u = 1 - r/horizon on each of equal pieces of [0, 1].

    In u the functions keep their relative accuracy, and so stay positive, up to the horizon.

    Raises ValueError for a name that is not in `NAMES`.
    """
    if name == "cubic":
        return np.array([[0.0, 0.0, 0.0, 2.0], [1.0, -6.0, 12.0, -6.0]])
    if name == "conical":
        return np.array([[0.0, 1.0, 0.0, 0.0]])
    if name == "constant":
        return np.array([[1.0, 0.0, 0.0, 0.0]])
    if name == "gaussian":
        return _hermite_pieces(_gaussian, _gaussian_slope, 32)
    raise ValueError(f"influence: no function '{name}'; allowed: {', '.join(NAMES)}")


_WIDTH = 0.4  # of the Gaussian, in horizons
_SHIFT = np.exp(-1.0 / _WIDTH**2)


def _gaussian(u):
    return (np.exp(-(((1.0 - u) / _WIDTH) ** 2)) - _SHIFT) / (1.0 - _SHIFT)


def _gaussian_slope(u):
    return 2.0 * (1.0 - u) / _WIDTH**2 * np.exp(-(((1.0 - u) / _WIDTH) ** 2)) / (1.0 - _SHIFT)


def _hermite_pieces(function, slope, pieces):
    h = 1.0 / pieces
    table = np.empty((pieces, 4))
    for k in range(pieces):
        a, b = k * h, (k + 1) * h
        values = [[1, a, a**2, a**3], [1, b, b**2, b**3]]
        slopes = [[0, 1, 2 * a, 3 * a**2], [0, 1, 2 * b, 3 * b**2]]
        conditions = np.array(values + slopes)
        table[k] = np.linalg.solve(conditions, [function(a), function(b), slope(a), slope(b)])
    return table


CLOSED = 1.0 + 1e-9  # rounding must not decide whether a lattice point at the horizon belongs


def support(name: str, horizon: float) -> float:
    """Distance (m) below which the function `name` counts: one that does not vanish at the horizon includes it."""
    return horizon * CLOSED if name == "constant" else horizon


@inlined
def influence(u, table):
    """w at u = 1 - r/horizon in (0, 1]."""
    piece = min(int(u * table.shape[0]), table.shape[0] - 1)
    return ((table[piece, 3] * u + table[piece, 2]) * u + table[piece, 1]) * u + table[piece, 0]
