"""Vectors and small matrices as tuples, for use inside kernels.

A kernel takes `dim`, a tuple of two or three zeros: its length is a compile-time constant, so one source
serves plane strain and three dimensions and the loops unroll into registers. Matrices are tuples in row
order (4 or 9 numbers), symmetric tensors follow `periporo.core.numerics.tensors` (4 or 6), symmetric d x d matrices
such as the shape tensor are (xx, yy, xy) or (xx, yy, zz, xy, yz, xz).
"""

import numpy as np
from numba.extending import overload

DIMENSION = {2: (0, 0), 3: (0, 0, 0)}

def difference(rows, i, j, dim):
    """rows[j] - rows[i] of an (n, d) array."""


def dot(a, b):
    """a . b"""


def zero_matrix(dim):
    """A matrix of zeros."""


def zero_spin(dim):
    """An axial vector (1|3) of zeros."""


def zero_symmetric(dim):
    """A symmetric tensor (4|6) of zeros."""


def zero_vector(dim):
    """A vector of zeros."""


def minus(a, b):
    """a - b of vectors."""


def apply(a, x):
    """Matrix times vector."""


def square(x):
    """x (x) x as a symmetric d x d matrix."""


def dyad(x, y):
    """x (x) y"""


def plus_dyad(a, x, y):
    """a + x (x) y"""


def plus_spherical(a, number):
    """a + number I"""


def full(s):
    """In-space part of a symmetric tensor (4|6) as a matrix."""


def scaled(a, factor):
    """factor * a, of a vector or a matrix."""


def matrix_at(rows, i, start, dim):
    """The matrix in columns `start` ... of row i."""


def mean_matrix(rows, i, j, dim):
    """Mean of the matrices in the rows i and j of an (n, d*d) array."""


def symmetric_at(rows, i, start, dim):
    """The symmetric tensor (4|6) in columns `start` ... of row i."""


def store(rows, i, start, value):
    """Write a tuple to columns `start` ... of row i."""


LANES = 64
"""Rows that are worked on together: a tile is a flat array in which quantity q of lane k is tile[q * LANES + k].

The constant stride lets the compiler see that lanes do not touch each other, and vectorise.
"""


def to_lane(tile, start, lane, value):
    """Write a tuple to the quantities `start` ... of a lane."""


def from_lane(tile, start, lane, like):
    """Quantities `start` ... of a lane as a tuple as long as `like`."""


def shape_at(rows, i, start, dim):
    """The symmetric d x d matrix in columns `start` ... of row i."""


def inverse_shape(k):
    """Inverse of a symmetric d x d matrix, and its determinant."""


def trace_shape(k):
    """Trace of a symmetric d x d matrix."""


def largest_eigenvalue(k):
    """Largest eigenvalue of a symmetric d x d matrix."""


def times_shape(a, k):
    """Matrix times symmetric d x d matrix."""


def determinant_minus(g):
    """det(I - g)"""


@overload(difference)
def _difference(rows, i, j, dim):
    if len(dim) == 2:
        return lambda rows, i, j, dim: (rows[j, 0] - rows[i, 0], rows[j, 1] - rows[i, 1])
    return lambda rows, i, j, dim: (
        rows[j, 0] - rows[i, 0],
        rows[j, 1] - rows[i, 1],
        rows[j, 2] - rows[i, 2],
    )


@overload(dot)
def _dot(a, b):
    if len(a) == 2:
        return lambda a, b: a[0] * b[0] + a[1] * b[1]
    return lambda a, b: a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@overload(zero_matrix)
def _zero_matrix(dim):
    if len(dim) == 2:
        return lambda dim: (0.0, 0.0, 0.0, 0.0)
    return lambda dim: (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@overload(zero_symmetric)
def _zero_symmetric(dim):
    if len(dim) == 2:
        return lambda dim: (0.0, 0.0, 0.0, 0.0)
    return lambda dim: (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@overload(zero_spin)
def _zero_spin(dim):
    if len(dim) == 2:
        return lambda dim: (0.0,)
    return lambda dim: (0.0, 0.0, 0.0)


@overload(zero_vector)
def _zero_vector(dim):
    if len(dim) == 2:
        return lambda dim: (0.0, 0.0)
    return lambda dim: (0.0, 0.0, 0.0)


@overload(minus)
def _minus(a, b):
    if len(a) == 2:
        return lambda a, b: (a[0] - b[0], a[1] - b[1])
    return lambda a, b: (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@overload(apply)
def _apply(a, x):
    if len(x) == 2:
        return lambda a, x: (a[0] * x[0] + a[1] * x[1], a[2] * x[0] + a[3] * x[1])
    return lambda a, x: (
        a[0] * x[0] + a[1] * x[1] + a[2] * x[2],
        a[3] * x[0] + a[4] * x[1] + a[5] * x[2],
        a[6] * x[0] + a[7] * x[1] + a[8] * x[2],
    )


@overload(square)
def _square(x):
    if len(x) == 2:
        return lambda x: (x[0] * x[0], x[1] * x[1], x[0] * x[1])
    return lambda x: (x[0] * x[0], x[1] * x[1], x[2] * x[2], x[0] * x[1], x[1] * x[2], x[0] * x[2])


@overload(dyad)
def _dyad(x, y):
    if len(x) == 2:
        return lambda x, y: (x[0] * y[0], x[0] * y[1], x[1] * y[0], x[1] * y[1])
    return lambda x, y: (
        x[0] * y[0],
        x[0] * y[1],
        x[0] * y[2],
        x[1] * y[0],
        x[1] * y[1],
        x[1] * y[2],
        x[2] * y[0],
        x[2] * y[1],
        x[2] * y[2],
    )


@overload(plus_dyad)
def _plus_dyad(a, x, y):
    if len(x) == 2:
        return lambda a, x, y: (
            a[0] + x[0] * y[0],
            a[1] + x[0] * y[1],
            a[2] + x[1] * y[0],
            a[3] + x[1] * y[1],
        )
    return lambda a, x, y: (
        a[0] + x[0] * y[0],
        a[1] + x[0] * y[1],
        a[2] + x[0] * y[2],
        a[3] + x[1] * y[0],
        a[4] + x[1] * y[1],
        a[5] + x[1] * y[2],
        a[6] + x[2] * y[0],
        a[7] + x[2] * y[1],
        a[8] + x[2] * y[2],
    )


@overload(plus_spherical)
def _plus_spherical(a, number):
    if len(a) == 4:
        return lambda a, number: (a[0] + number, a[1], a[2], a[3] + number)
    return lambda a, number: (a[0] + number, a[1], a[2], a[3], a[4] + number, a[5], a[6], a[7], a[8] + number)


@overload(full)
def _full(s):
    if len(s) == 4:
        return lambda s: (s[0], s[3], s[3], s[1])
    return lambda s: (s[0], s[3], s[5], s[3], s[1], s[4], s[5], s[4], s[2])


@overload(scaled)
def _scaled(a, factor):
    n = len(a)
    if n == 2:
        return lambda a, factor: (factor * a[0], factor * a[1])
    if n == 3:
        return lambda a, factor: (factor * a[0], factor * a[1], factor * a[2])
    if n == 4:
        return lambda a, factor: (factor * a[0], factor * a[1], factor * a[2], factor * a[3])
    return lambda a, factor: (
        factor * a[0],
        factor * a[1],
        factor * a[2],
        factor * a[3],
        factor * a[4],
        factor * a[5],
        factor * a[6],
        factor * a[7],
        factor * a[8],
    )


@overload(matrix_at)
def _matrix_at(rows, i, start, dim):
    if len(dim) == 2:
        return lambda rows, i, start, dim: (
            rows[i, start],
            rows[i, start + 1],
            rows[i, start + 2],
            rows[i, start + 3],
        )
    return lambda rows, i, start, dim: (
        rows[i, start],
        rows[i, start + 1],
        rows[i, start + 2],
        rows[i, start + 3],
        rows[i, start + 4],
        rows[i, start + 5],
        rows[i, start + 6],
        rows[i, start + 7],
        rows[i, start + 8],
    )


@overload(mean_matrix)
def _mean_matrix(rows, i, j, dim):
    if len(dim) == 2:
        return lambda rows, i, j, dim: (
            0.5 * (rows[i, 0] + rows[j, 0]),
            0.5 * (rows[i, 1] + rows[j, 1]),
            0.5 * (rows[i, 2] + rows[j, 2]),
            0.5 * (rows[i, 3] + rows[j, 3]),
        )
    return lambda rows, i, j, dim: (
        0.5 * (rows[i, 0] + rows[j, 0]),
        0.5 * (rows[i, 1] + rows[j, 1]),
        0.5 * (rows[i, 2] + rows[j, 2]),
        0.5 * (rows[i, 3] + rows[j, 3]),
        0.5 * (rows[i, 4] + rows[j, 4]),
        0.5 * (rows[i, 5] + rows[j, 5]),
        0.5 * (rows[i, 6] + rows[j, 6]),
        0.5 * (rows[i, 7] + rows[j, 7]),
        0.5 * (rows[i, 8] + rows[j, 8]),
    )


@overload(symmetric_at)
def _symmetric_at(rows, i, start, dim):
    if len(dim) == 2:
        return lambda rows, i, start, dim: (
            rows[i, start],
            rows[i, start + 1],
            rows[i, start + 2],
            rows[i, start + 3],
        )
    return lambda rows, i, start, dim: (
        rows[i, start],
        rows[i, start + 1],
        rows[i, start + 2],
        rows[i, start + 3],
        rows[i, start + 4],
        rows[i, start + 5],
    )


@overload(store)
def _store(rows, i, start, value):
    if len(value) == 0:
        return lambda rows, i, start, value: None

    def write(rows, i, start, value):
        rows[i, start] = value[0]
        store(rows, i, start + 1, value[1:])

    return write


@overload(to_lane)
def _to_lane(tile, start, lane, value):
    if len(value) == 0:
        return lambda tile, start, lane, value: None

    def write(tile, start, lane, value):
        tile[start * LANES + lane] = value[0]
        to_lane(tile, start + 1, lane, value[1:])

    return write


@overload(from_lane)
def _from_lane(tile, start, lane, like):
    if len(like) == 1:
        return lambda tile, start, lane, like: (tile[start * LANES + lane],)

    def read(tile, start, lane, like):
        return (tile[start * LANES + lane],) + from_lane(tile, start + 1, lane, like[1:])

    return read


@overload(shape_at)
def _shape_at(rows, i, start, dim):
    if len(dim) == 2:
        return lambda rows, i, start, dim: (rows[i, start], rows[i, start + 1], rows[i, start + 2])
    return lambda rows, i, start, dim: (
        rows[i, start],
        rows[i, start + 1],
        rows[i, start + 2],
        rows[i, start + 3],
        rows[i, start + 4],
        rows[i, start + 5],
    )


@overload(trace_shape)
def _trace_shape(k):
    if len(k) == 3:
        return lambda k: k[0] + k[1]
    return lambda k: k[0] + k[1] + k[2]


@overload(inverse_shape)
def _inverse_shape(k):
    if len(k) == 3:

        def inverse(k):
            determinant = k[0] * k[1] - k[2] * k[2]
            f = 1.0 / determinant
            return (k[1] * f, k[0] * f, -k[2] * f), determinant

        return inverse

    def inverse(k):
        c_xx = k[1] * k[2] - k[4] * k[4]
        c_xy = k[5] * k[4] - k[3] * k[2]
        c_xz = k[3] * k[4] - k[1] * k[5]
        determinant = k[0] * c_xx + k[3] * c_xy + k[5] * c_xz
        f = 1.0 / determinant
        return (
            c_xx * f,
            (k[0] * k[2] - k[5] * k[5]) * f,
            (k[0] * k[1] - k[3] * k[3]) * f,
            c_xy * f,
            (k[3] * k[5] - k[0] * k[4]) * f,
            c_xz * f,
        ), determinant

    return inverse


@overload(times_shape)
def _times_shape(a, k):
    if len(k) == 3:
        return lambda a, k: (
            a[0] * k[0] + a[1] * k[2],
            a[0] * k[2] + a[1] * k[1],
            a[2] * k[0] + a[3] * k[2],
            a[2] * k[2] + a[3] * k[1],
        )
    return lambda a, k: (
        a[0] * k[0] + a[1] * k[3] + a[2] * k[5],
        a[0] * k[3] + a[1] * k[1] + a[2] * k[4],
        a[0] * k[5] + a[1] * k[4] + a[2] * k[2],
        a[3] * k[0] + a[4] * k[3] + a[5] * k[5],
        a[3] * k[3] + a[4] * k[1] + a[5] * k[4],
        a[3] * k[5] + a[4] * k[4] + a[5] * k[2],
        a[6] * k[0] + a[7] * k[3] + a[8] * k[5],
        a[6] * k[3] + a[7] * k[1] + a[8] * k[4],
        a[6] * k[5] + a[7] * k[4] + a[8] * k[2],
    )


@overload(determinant_minus)
def _determinant_minus(g):
    if len(g) == 4:
        return lambda g: (1.0 - g[0]) * (1.0 - g[3]) - g[1] * g[2]
    return lambda g: (
        (1.0 - g[0]) * ((1.0 - g[4]) * (1.0 - g[8]) - g[5] * g[7])
        - g[1] * (g[3] * (1.0 - g[8]) + g[5] * g[6])
        - g[2] * (g[3] * g[7] + (1.0 - g[4]) * g[6])
    )


@overload(largest_eigenvalue)
def _largest_eigenvalue(k):
    if len(k) == 3:
        return lambda k: 0.5 * (k[0] + k[1]) + np.sqrt(0.25 * (k[0] - k[1]) ** 2 + k[2] * k[2])

    def eigenvalue(k):  # trigonometric solution of the characteristic equation
        q = (k[0] + k[1] + k[2]) / 3.0
        a, b, c = k[0] - q, k[1] - q, k[2] - q
        off = k[3] * k[3] + k[4] * k[4] + k[5] * k[5]
        p = np.sqrt((a * a + b * b + c * c + 2.0 * off) / 6.0)
        if p == 0.0:
            return q
        half = (
            a * (b * c - k[4] * k[4]) - k[3] * (k[3] * c - k[4] * k[5]) + k[5] * (k[3] * k[4] - b * k[5])
        ) / (2.0 * p * p * p)
        return q + 2.0 * p * np.cos(np.arccos(min(max(half, -1.0), 1.0)) / 3.0)

    return eigenvalue
