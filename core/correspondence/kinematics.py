"""Objective kinematics of one step: midpoint strain increment, and the rotation of stress.

With G' = dt L evaluated on the configuration at the end of the step, the gradient referred to the midpoint is
G = G' (I - G'/2)^-1: its symmetric part is the strain increment (exactly zero in a rigid rotation), its skew
part the spin increment dW. Stress is turned by Q = (I - dW/2)^-1 (I + dW/2), exact in a rigid rotation (Hughes
& Winget 1980); the strain increment, made at the midpoint, is turned to the end of the step by half of that,
H = (I - dW/4)^-1 (I + dW/4), which makes the update second order.
"""

import numpy as np

from periporo.core.numerics import algebra as la
from periporo.core.numerics.algebra import LANES
from periporo.core.numerics.jit import inlined, kernel, overload


def midpoint_gradient(g):
    """G' (I - G'/2)^-1 of a matrix tuple."""


def strain_of(g):
    """Symmetric part of a matrix tuple as a tensor row (4|6)."""


def spin_of(g):
    """Axial vector of the skew part of a matrix tuple: 1 component in the plane, 3 in space."""


def rotation(spin, fraction):
    """(I - f dW/2)^-1 (I + f dW/2) for f = `fraction` of the spin increment dW (its axial vector).

    In the plane as (cos 2a, sin 2a) of its angle a, in space as a 3 x 3 matrix.
    """


def rotated(s, h):
    """H s H^T of a symmetric tensor row (4|6)."""


@inlined
def new_tile(dim):
    """Scratch of `LANES` rows for `turn_tile`, with room for three vectors more."""
    return np.zeros(LANES * (len(dim) * len(dim) + 2 * len(la.zero_symmetric(dim)) + 3 + 3 * len(dim)))


@inlined
def extra_quantity(dim):
    """Number of the first quantity in a tile that a scheme may use for itself."""
    return len(dim) * len(dim) + 2 * len(la.zero_symmetric(dim)) + 3


@inlined
def load_lane(tile, rows, lane, r, gradient, stress, dim):
    """Put row r, with its velocity gradient (a matrix tuple) and its stress, into a lane."""
    rows[lane] = r
    la.to_lane(tile, 0, lane, gradient)
    la.to_lane(tile, len(dim) * len(dim), lane, la.symmetric_at(stress, r, 0, dim))


@inlined
def turn_tile(tile, rows, used, dt, stress, strain_increment, state, tensors, spins, peak, dim):
    """Strain increment over `dt` of the `used` rows in a tile; their stress and tensor state turn to the end.

    `spins` (rows, 1|3) of the step are kept, if there is room for them.

    All lanes are worked on, in vectors, so that a row's bits do not depend on its lane. `peak` is as in `Block`.
    """
    n = len(dim) * len(dim)
    symmetric = la.zero_symmetric(dim)
    c = len(symmetric)
    for k in range(LANES):
        g = midpoint_gradient(la.scaled(la.from_lane(tile, 0, k, la.zero_matrix(dim)), dt))
        spin = spin_of(g)
        la.to_lane(tile, n + c, k, rotated(strain_of(g), rotation(spin, 0.5)))
        la.to_lane(tile, n, k, rotated(la.from_lane(tile, n, k, symmetric), rotation(spin, 1.0)))
        la.to_lane(tile, n + 2 * c, k, spin)
    for k in range(used):
        r = rows[k]
        la.store(stress, r, 0, la.from_lane(tile, n, k, symmetric))
        strain = la.from_lane(tile, n + c, k, symmetric)
        la.store(strain_increment, r, 0, strain)
        square = 0.0
        for e in range(c):
            square += strain[e] * strain[e]
        if square > peak[0]:
            peak[0], peak[1] = square, r
        if spins.shape[0] > 0:
            la.store(spins, r, 0, la.from_lane(tile, n + 2 * c, k, la.zero_spin(dim)))
        for t in range(tensors.shape[0]):
            spin = la.from_lane(tile, n + 2 * c, k, la.zero_spin(dim))
            turned = rotated(la.symmetric_at(state, r, tensors[t], dim), rotation(spin, 1.0))
            la.store(state, r, tensors[t], turned)


@kernel
def strain_rows(source, active, gradient, dt, stress, strain_increment, state, tensors, spins, peak, dim):
    """Strain increment over `dt` of rows that have the velocity gradient in row source[r] of `gradient`.

    Stress and tensor state of active rows turn to the end of the step; inactive rows have no strain.
    """
    tile, rows, used = new_tile(dim), np.zeros(LANES, np.int64), 0
    for r in range(active.shape[0]):
        if active[r]:
            load_lane(tile, rows, used, r, la.matrix_at(gradient, source[r], 0, dim), stress, dim)
            used += 1
        else:
            la.store(strain_increment, r, 0, la.zero_symmetric(dim))
        if used == LANES or r == active.shape[0] - 1:
            turn_tile(tile, rows, used, dt, stress, strain_increment, state, tensors, spins, peak, dim)
            used = 0


@overload(midpoint_gradient)
def _midpoint_gradient(g):
    if len(g) == 4:

        def midpoint(g):
            a = 1.0 - 0.5 * g[0]
            b = -0.5 * g[1]
            c = -0.5 * g[2]
            d = 1.0 - 0.5 * g[3]
            f = 1.0 / (a * d - b * c)
            return (
                (g[0] * d - g[1] * c) * f,
                (g[1] * a - g[0] * b) * f,
                (g[2] * d - g[3] * c) * f,
                (g[3] * a - g[2] * b) * f,
            )

        return midpoint

    def midpoint(g):
        a00, a01, a02 = 1.0 - 0.5 * g[0], -0.5 * g[1], -0.5 * g[2]
        a10, a11, a12 = -0.5 * g[3], 1.0 - 0.5 * g[4], -0.5 * g[5]
        a20, a21, a22 = -0.5 * g[6], -0.5 * g[7], 1.0 - 0.5 * g[8]
        i00 = a11 * a22 - a12 * a21
        i10 = a12 * a20 - a10 * a22
        i20 = a10 * a21 - a11 * a20
        f = 1.0 / (a00 * i00 + a01 * i10 + a02 * i20)
        # (I - G'/2)^-1 = I + G/2, hence G = 2 ((I - G'/2)^-1 - I): the off-diagonal terms come without
        # cancellation, the diagonal ones are formed from the product to keep that, too.
        i01 = a02 * a21 - a01 * a22
        i02 = a01 * a12 - a02 * a11
        i11 = a00 * a22 - a02 * a20
        i12 = a02 * a10 - a00 * a12
        i21 = a01 * a20 - a00 * a21
        i22 = a00 * a11 - a01 * a10
        return (
            (g[0] * i00 + g[1] * i10 + g[2] * i20) * f,
            2.0 * i01 * f,
            2.0 * i02 * f,
            2.0 * i10 * f,
            (g[3] * i01 + g[4] * i11 + g[5] * i21) * f,
            2.0 * i12 * f,
            2.0 * i20 * f,
            2.0 * i21 * f,
            (g[6] * i02 + g[7] * i12 + g[8] * i22) * f,
        )

    return midpoint


@overload(strain_of)
def _strain_of(g):
    if len(g) == 4:
        return lambda g: (g[0], g[3], 0.0, 0.5 * (g[1] + g[2]))
    return lambda g: (g[0], g[4], g[8], 0.5 * (g[1] + g[3]), 0.5 * (g[5] + g[7]), 0.5 * (g[2] + g[6]))


@overload(spin_of)
def _spin_of(g):
    if len(g) == 4:
        return lambda g: (0.5 * (g[2] - g[1]),)
    return lambda g: (0.5 * (g[7] - g[5]), 0.5 * (g[2] - g[6]), 0.5 * (g[3] - g[1]))


@overload(rotation)
def _rotation(spin, fraction):
    if len(spin) == 1:

        def rotate(spin, fraction):
            t = 0.5 * fraction * spin[0]  # tangent of half the angle
            f = 1.0 / (1.0 + t * t)
            c = (1.0 - t * t) * f
            s = 2.0 * t * f
            return (c * c - s * s, 2.0 * c * s)

        return rotate

    def rotate(spin, fraction):
        # I + 2/(1 + |t|^2) (T + T T), T = t x
        x = 0.5 * fraction * spin[0]
        y = 0.5 * fraction * spin[1]
        z = 0.5 * fraction * spin[2]
        f = 2.0 / (1.0 + x * x + y * y + z * z)
        return (
            1.0 - f * (y * y + z * z),
            f * (x * y - z),
            f * (x * z + y),
            f * (x * y + z),
            1.0 - f * (x * x + z * z),
            f * (y * z - x),
            f * (x * z - y),
            f * (y * z + x),
            1.0 - f * (x * x + y * y),
        )

    return rotate


@overload(rotated)
def _rotated(s, h):
    if len(s) == 4:

        def rotate(s, h):
            centre = 0.5 * (s[0] + s[1])
            half = 0.5 * (s[0] - s[1])
            turned = h[0] * half - h[1] * s[3]
            return (centre + turned, centre - turned, s[2], h[1] * half + h[0] * s[3])

        return rotate

    def rotate(s, h):
        m00 = h[0] * s[0] + h[1] * s[3] + h[2] * s[5]
        m01 = h[0] * s[3] + h[1] * s[1] + h[2] * s[4]
        m02 = h[0] * s[5] + h[1] * s[4] + h[2] * s[2]
        m10 = h[3] * s[0] + h[4] * s[3] + h[5] * s[5]
        m11 = h[3] * s[3] + h[4] * s[1] + h[5] * s[4]
        m12 = h[3] * s[5] + h[4] * s[4] + h[5] * s[2]
        m20 = h[6] * s[0] + h[7] * s[3] + h[8] * s[5]
        m21 = h[6] * s[3] + h[7] * s[1] + h[8] * s[4]
        m22 = h[6] * s[5] + h[7] * s[4] + h[8] * s[2]
        return (
            m00 * h[0] + m01 * h[1] + m02 * h[2],
            m10 * h[3] + m11 * h[4] + m12 * h[5],
            m20 * h[6] + m21 * h[7] + m22 * h[8],
            m00 * h[3] + m01 * h[4] + m02 * h[5],
            m10 * h[6] + m11 * h[7] + m12 * h[8],
            m00 * h[6] + m01 * h[7] + m02 * h[8],
        )

    return rotate
