"""Symmetric d x d matrices such as the shape tensor: (xx, yy, xy) or (xx, yy, zz, xy, yz, xz)."""

import numpy as np

from periporo.core.numerics.jit import overload


def square(x):
    """x (x) x as a symmetric d x d matrix."""


@overload(square)
def _square(x):
    if len(x) == 2:
        return lambda x: (x[0] * x[0], x[1] * x[1], x[0] * x[1])
    return lambda x: (x[0] * x[0], x[1] * x[1], x[2] * x[2], x[0] * x[1], x[1] * x[2], x[0] * x[2])


def trace_shape(k):
    """Trace of a symmetric d x d matrix."""


@overload(trace_shape)
def _trace_shape(k):
    if len(k) == 3:
        return lambda k: k[0] + k[1]
    return lambda k: k[0] + k[1] + k[2]


def inverse_shape(k):
    """Inverse of a symmetric d x d matrix, and its determinant."""


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


def times_shape(a, k):
    """Matrix times symmetric d x d matrix."""


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


def largest_eigenvalue(k):
    """Largest eigenvalue of a symmetric d x d matrix."""


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
