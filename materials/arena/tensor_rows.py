"""Tensors of one row as six numbers, and the plane of deviators in which a step stays."""

import math

from periporo.core.numerics.jit import inlined


@inlined
def split(values, row, first, components):
    """Trace and deviator (six numbers) of the tensor in the columns from `first` of one row.

    Written out: loops over four or six components would cost more than the arithmetic.
    """
    xx, yy, zz = values[row, first], values[row, first + 1], values[row, first + 2]
    yz = xz = 0.0
    if components == 6:
        yz, xz = values[row, first + 4], values[row, first + 5]
    trace = xx + yy + zz
    mean = trace / 3.0
    return trace, (xx - mean, yy - mean, zz - mean, values[row, first + 3], yz, xz)


@inlined
def product(a, b):
    """a:b of two tensors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + 2.0 * (a[3] * b[3] + a[4] * b[4] + a[5] * b[5])


@inlined
def combine(trace, s, s_share, e, e_share):
    """trace/3 I + s_share s + e_share e, six numbers."""
    mean = trace / 3.0
    return (
        mean + s_share * s[0] + e_share * e[0],
        mean + s_share * s[1] + e_share * e[1],
        mean + s_share * s[2] + e_share * e[2],
        s_share * s[3] + e_share * e[3],
        s_share * s[4] + e_share * e[4],
        s_share * s[5] + e_share * e[5],
    )


@inlined
def store(values, row, first, components, tensor):
    """Write six numbers into the columns from `first` of one row, four in plane strain."""
    values[row, first] = tensor[0]
    values[row, first + 1] = tensor[1]
    values[row, first + 2] = tensor[2]
    values[row, first + 3] = tensor[3]
    if components == 6:
        values[row, first + 4] = tensor[4]
        values[row, first + 5] = tensor[5]


@inlined
def plus(a, b):
    """Sum of two tensors of six numbers."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


@inlined
def basis(ss, se, ee):
    """Coordinates of the deviators s = (u, 0) and e = (e1, e2) in an orthonormal basis of their plane."""
    u = math.sqrt(ss)
    if u == 0.0:
        return 0.0, math.sqrt(ee), 0.0
    e1 = se / u
    rest = ee - e1 * e1
    return u, e1, math.sqrt(rest) if rest > 1e-20 * ee else 0.0


@inlined
def shares(u, w, u0, e1, e2):
    """Shares of s = (u0, 0) and e = (e1, e2) that make up the deviator (u, w)."""
    if u0 == 0.0:
        return 0.0, u / e1 if e1 != 0.0 else 0.0
    if e2 == 0.0:
        return u / u0, 0.0
    return (u - w * e1 / e2) / u0, w / e2
