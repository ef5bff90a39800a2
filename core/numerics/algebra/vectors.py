"""Vectors as tuples."""

from periporo.core.numerics.jit import overload

DIMENSION = {2: (0, 0), 3: (0, 0, 0)}
"""`dim` of plane strain and of three dimensions."""


def zero_vector(dim):
    """A vector of zeros."""


@overload(zero_vector)
def _zero_vector(dim):
    if len(dim) == 2:
        return lambda dim: (0.0, 0.0)
    return lambda dim: (0.0, 0.0, 0.0)


def dot(a, b):
    """a . b"""


@overload(dot)
def _dot(a, b):
    if len(a) == 2:
        return lambda a, b: a[0] * b[0] + a[1] * b[1]
    return lambda a, b: a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def minus(a, b):
    """a - b of vectors."""


@overload(minus)
def _minus(a, b):
    if len(a) == 2:
        return lambda a, b: (a[0] - b[0], a[1] - b[1])
    return lambda a, b: (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scaled(a, factor):
    """factor * a, of a vector or a matrix."""


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
