"""From rows of arrays to tuples and back."""

from periporo.core.numerics.jit import overload


def difference(rows, i, j, dim):
    """rows[j] - rows[i] of an (n, d) array."""


@overload(difference)
def _difference(rows, i, j, dim):
    if len(dim) == 2:
        return lambda rows, i, j, dim: (rows[j, 0] - rows[i, 0], rows[j, 1] - rows[i, 1])
    return lambda rows, i, j, dim: (
        rows[j, 0] - rows[i, 0],
        rows[j, 1] - rows[i, 1],
        rows[j, 2] - rows[i, 2],
    )


def matrix_at(rows, i, start, dim):
    """The matrix in columns `start` ... of row i."""


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


def mean_matrix(rows, i, j, dim):
    """Mean of the matrices in the rows i and j of an (n, d*d) array."""


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


def symmetric_at(rows, i, start, dim):
    """The symmetric tensor (4|6) in columns `start` ... of row i."""


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


def shape_at(rows, i, start, dim):
    """The symmetric d x d matrix in columns `start` ... of row i."""


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


def store(rows, i, start, value):
    """Write a tuple to columns `start` ... of row i."""


@overload(store)
def _store(rows, i, start, value):
    if len(value) == 0:
        return lambda rows, i, start, value: None

    def write(rows, i, start, value):
        rows[i, start] = value[0]
        store(rows, i, start + 1, value[1:])

    return write
