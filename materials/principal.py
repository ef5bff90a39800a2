"""Principal stresses of many rows at once, without branches, and the way back to components.

One principal direction is always apart from the other two: that of zz in plane strain; in space the one whose
deviatoric value has the largest size. Its projection P, the mean m of the other two values and their half difference r
make the tensor z P + m (1 - P) + W with W : W = 2 r^2. Isotropic functions need no more: W is scaled, and equal values
are no special case. Quantities of a tile's lanes (`periporo.core.numerics.algebra`): the components come first.
"""

import math

from periporo.core.numerics import algebra as la
from periporo.core.numerics.algebra import LANES
from periporo.core.numerics.jit import inlined

_SHAPE = 1.5 * math.sqrt(3.0)  # J3 over J2^1.5 is at most 1 over this
_GUESS = (
    0.8660260610588322, 0.16661885651505143, -0.04752501393250109, 0.021899627345236372, -0.008966451200187464,
    0.0019473016104048686,
)  # cos(acos(x)/3) in 0 <= x <= 1 to 7e-7

VALUES = 8
"""Quantities from 3 times the number of components on: z, m + r, m - r, and room for others."""


@inlined
def _third_of_angle(x):
    """cos(acos(x)/3) of 0 <= x <= 1, the largest root of 4 c^3 - 3 c = x: two steps with the slope of the first."""
    a = _GUESS
    c = a[0] + x * (a[1] + x * (a[2] + x * (a[3] + x * (a[4] + x * a[5]))))
    part = 1.0 / (12.0 * c * c - 3.0)
    c -= (c * (4.0 * c * c - 3.0) - x) * part
    return c - (c * (4.0 * c * c - 3.0) - x) * part


@inlined
def _apart(s):
    """Deviatoric value that is apart from the other two, and its projection, of a tensor of six components."""
    p = (s[0] + s[1] + s[2]) / 3.0
    x, y, z, u, v, w = s[0] - p, s[1] - p, s[2] - p, s[3], s[4], s[5]
    j2 = 0.5 * (x * x + y * y + z * z) + u * u + v * v + w * w
    j3 = x * (y * z - v * v) - u * (u * z - v * w) + w * (u * v - y * w)
    size = math.sqrt(j2)
    cube = size * j2
    share = _SHAPE * abs(j3) / (cube if cube != 0.0 else 1.0)
    value = 2.0 / math.sqrt(3.0) * size * _third_of_angle(1.0 if share > 1.0 else share)
    value = -value if j3 < 0.0 else value
    x, y, z = x - value, y - value, z - value
    a, b, c = y * z - v * v, x * z - w * w, x * y - u * u  # the adjugate, which is P times the product of the gaps
    d, e, f = w * v - u * z, u * w - x * v, u * v - y * w
    gaps = a + b + c
    part = 1.0 / (gaps if gaps != 0.0 else 1.0)
    return p + value, (a * part, b * part, c * part, d * part, e * part, f * part)


@inlined
def take_apart(tile, like):
    """Fill projections, in-plane deviators W and values of all lanes, whose tensors as long as `like` come first."""
    n = len(like)
    for k in range(LANES):
        s = la.from_lane(tile, 0, k, like)
        if n == 4:
            mean, x = 0.5 * (s[0] + s[1]), 0.5 * (s[0] - s[1])
            radius = math.sqrt(x * x + s[3] * s[3])
            la.to_lane(tile, 2 * n, k, (x, -x, 0.0, s[3]))
            la.to_lane(tile, 3 * n, k, (s[2], mean + radius, mean - radius))
        else:
            value, p = _apart(s)
            mean = 0.5 * (s[0] + s[1] + s[2] - value)
            part = value - mean
            w = (
                s[0] - mean - part * p[0], s[1] - mean - part * p[1], s[2] - mean - part * p[2],
                s[3] - part * p[3], s[4] - part * p[4], s[5] - part * p[5],
            )  # fmt: skip
            square = 0.5 * (w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) + w[3] * w[3] + w[4] * w[4] + w[5] * w[5]
            radius = math.sqrt(square)
            la.to_lane(tile, n, k, p)
            la.to_lane(tile, 2 * n, k, w)
            la.to_lane(tile, 3 * n, k, (value, mean + radius, mean - radius))


@inlined
def put_together(tile, like, column):
    """Components from the values z, m + r, m - r in the quantities `column` ... of all lanes, in the axes of before."""
    n = len(like)
    for k in range(LANES):
        w = la.from_lane(tile, 2 * n, k, like)
        before = la.from_lane(tile, 3 * n, k, (0.0, 0.0, 0.0))
        value, high, low = la.from_lane(tile, column, k, (0.0, 0.0, 0.0))
        mean, wide = 0.5 * (high + low), before[1] - before[2]
        scale = (high - low) / (wide if wide != 0.0 else 1.0)
        if n == 4:
            la.to_lane(tile, 0, k, (mean + scale * w[0], mean + scale * w[1], value, scale * w[3]))
        else:
            p = la.from_lane(tile, n, k, like)
            part = value - mean
            for c in range(n):
                tile[c * LANES + k] = (mean if c < 3 else 0.0) + part * p[c] + scale * w[c]
