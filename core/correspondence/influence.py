"""Influence functions w(r/horizon): polynomials in u = 1 - r/horizon and in x = max(2 u - 1, 0).

`cubic` (the B-spline), `conical` (1 - s) and `constant` are exact in this form; `gaussian`, shifted to vanish
at the horizon, is interpolated in each half to the third derivative, which is as good a weight as the exponential. All
but `constant` vanish at the horizon, so a bond that enters or leaves does not make the force jump; `constant` is
there for redrawing figures of the literature. No function needs a branch, so that the compiler can use vectors.
"""

import numpy as np

from periporo.core.numerics.jit import inlined, kernel

NAMES = ("cubic", "conical", "gaussian", "constant")
_TERMS = 8


def influence_table(name: str) -> np.ndarray:
    """Coefficients (2, 8) of the polynomials in u and in x = max(2 u - 1, 0), from the constant term on.

    In u the functions keep their relative accuracy, and so stay positive, up to the horizon.

    Raises ValueError for a name that is not in `NAMES`.
    """
    table = np.zeros((2, _TERMS))
    if name == "cubic":
        table[0, 3], table[1, 3] = 2.0, -1.0
    elif name == "conical":
        table[0, 1] = 1.0
    elif name == "constant":
        table[0, 0] = 1.0
    elif name == "gaussian":
        table[0] = _interpolated(_gaussian_slopes(0.0), _gaussian_slopes(0.5), 0.5)
        table[1, 4:] = _remainder(table[0])
    else:
        raise ValueError(f"influence: no function '{name}'; allowed: {', '.join(NAMES)}")
    return table


_WIDTH = 0.4  # of the Gaussian, in horizons
_SHIFT = np.exp(-1.0 / _WIDTH**2)


def _gaussian_slopes(u):
    """Value and three derivatives of the shifted Gaussian."""
    s, a = 1.0 - u, 1.0 / _WIDTH**2
    bell = np.exp(-a * s**2) / (1.0 - _SHIFT)
    value = bell - _SHIFT / (1.0 - _SHIFT)
    return np.array(
        [value, 2 * a * s * bell, (4 * a**2 * s**2 - 2 * a) * bell, (8 * a**3 * s**3 - 12 * a**2 * s) * bell]
    )


def _derivatives(u):
    """Rows of the value and of three derivatives at u of the powers 0, 1, ... of u."""
    powers = np.arange(_TERMS)
    rows, factor = [], np.ones(_TERMS)
    for order in range(4):
        rows.append(factor * u ** np.maximum(powers - order, 0.0))
        factor = factor * (powers - order)
    return np.array(rows)


def _interpolated(left, right, u):
    """The polynomial with value and derivatives `left` at 0 and `right` at u."""
    return np.linalg.solve(np.concatenate([_derivatives(0.0), _derivatives(u)]), np.concatenate([left, right]))


def _remainder(below):
    """Coefficients of x^4 ... x^7 that continue the Gaussian beyond u = 1/2 from the polynomial `below`."""
    missing = (_gaussian_slopes(1.0) - _derivatives(1.0) @ below) / 2.0 ** np.arange(4)  # d/dx = d/du / 2
    return np.linalg.solve(_derivatives(1.0)[:, 4:], missing)


CLOSED = 1.0 + 1e-9  # rounding must not decide whether a lattice point at the horizon belongs


def support(name: str, horizon: float) -> float:
    """Distance (m) below which the function `name` counts: one that does not vanish at the horizon includes it."""
    return horizon * CLOSED if name == "constant" else horizon


@inlined
def influence(u, table):
    """w at u = 1 - r/horizon, 0 unless u is positive."""
    x = max(2.0 * u - 1.0, 0.0)
    below = above = 0.0
    for k in range(_TERMS - 1, -1, -1):
        below = below * u + table[0, k]
        above = above * x + table[1, k]
    return below + above if u > 0.0 else 0.0


def influences(u: np.ndarray, table: np.ndarray) -> np.ndarray:
    """w (n,) at each u (n,)."""
    w = np.empty(len(u))
    _fill_influences(u, table, w)
    return w


@kernel  # what is only inlined would be compiled anew in every process that calls it from Python
def _fill_influences(u, table, w):
    for k in range(u.shape[0]):
        w[k] = influence(u[k], table)
