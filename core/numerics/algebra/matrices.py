"""Square matrices as tuples in row order, and their kin: symmetric tensors (4|6) and spins (1|3)."""

from periporo.core.numerics.jit import overload


def zero_matrix(dim):
    """A matrix of zeros."""


@overload(zero_matrix)
def _zero_matrix(dim):
    if len(dim) == 2:
        return lambda dim: (0.0, 0.0, 0.0, 0.0)
    return lambda dim: (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def zero_symmetric(dim):
    """A symmetric tensor (4|6) of zeros."""


@overload(zero_symmetric)
def _zero_symmetric(dim):
    if len(dim) == 2:
        return lambda dim: (0.0, 0.0, 0.0, 0.0)
    return lambda dim: (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def zero_spin(dim):
    """An axial vector (1|3) of zeros."""


@overload(zero_spin)
def _zero_spin(dim):
    if len(dim) == 2:
        return lambda dim: (0.0,)
    return lambda dim: (0.0, 0.0, 0.0)


def full(s):
    """In-space part of a symmetric tensor (4|6) as a matrix."""


@overload(full)
def _full(s):
    if len(s) == 4:
        return lambda s: (s[0], s[3], s[3], s[1])
    return lambda s: (s[0], s[3], s[5], s[3], s[1], s[4], s[5], s[4], s[2])


def apply(a, x):
    """Matrix times vector."""


@overload(apply)
def _apply(a, x):
    if len(x) == 2:
        return lambda a, x: (a[0] * x[0] + a[1] * x[1], a[2] * x[0] + a[3] * x[1])
    return lambda a, x: (
        a[0] * x[0] + a[1] * x[1] + a[2] * x[2],
        a[3] * x[0] + a[4] * x[1] + a[5] * x[2],
        a[6] * x[0] + a[7] * x[1] + a[8] * x[2],
    )


def dyad(x, y):
    """x (x) y"""


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


def plus_dyad(a, x, y):
    """a + x (x) y"""


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


def plus_spherical(a, number):
    """a + number I"""


@overload(plus_spherical)
def _plus_spherical(a, number):
    if len(a) == 4:
        return lambda a, number: (a[0] + number, a[1], a[2], a[3] + number)
    return lambda a, number: (a[0] + number, a[1], a[2], a[3], a[4] + number, a[5], a[6], a[7], a[8] + number)


def determinant_minus(g):
    """det(I - g)"""


@overload(determinant_minus)
def _determinant_minus(g):
    if len(g) == 4:
        return lambda g: (1.0 - g[0]) * (1.0 - g[3]) - g[1] * g[2]
    return lambda g: (
        (1.0 - g[0]) * ((1.0 - g[4]) * (1.0 - g[8]) - g[5] * g[7])
        - g[1] * (g[3] * (1.0 - g[8]) + g[5] * g[6])
        - g[2] * (g[3] * g[7] + (1.0 - g[4]) * g[6])
    )
