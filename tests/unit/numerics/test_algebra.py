"""Every operation on tuples against NumPy, in the plane and in space, from one kernel source."""

import numpy as np
import pytest

from periporo.core.numerics import algebra as la
from periporo.core.numerics.jit import kernel
from periporo.core.numerics.tensors import from_matrix, to_matrix


@kernel
def _operate(rows, matrices, tensors, shapes, out, scalars, dim):
    """Result of each operation in a row of `out`, numbers in `scalars`."""
    x = la.difference(rows, 0, 1, dim)
    y = la.difference(rows, 0, 2, dim)
    a = la.matrix_at(matrices, 1, 2, dim)
    s = la.symmetric_at(tensors, 1, 1, dim)
    k = la.shape_at(shapes, 1, 1, dim)
    inverse, determinant = la.inverse_shape(k)
    la.store(out, 0, 0, x)
    la.store(out, 1, 0, la.minus(x, y))
    la.store(out, 2, 0, la.apply(a, x))
    la.store(out, 3, 0, la.square(x))
    la.store(out, 4, 0, la.dyad(x, y))
    la.store(out, 5, 0, la.plus_dyad(a, x, y))
    la.store(out, 6, 0, la.full(s))
    la.store(out, 7, 0, la.scaled(x, 3.0))
    la.store(out, 8, 0, la.scaled(a, -2.0))
    la.store(out, 9, 0, la.mean_matrix(matrices[:, 2:], 0, 1, dim))
    la.store(out, 10, 0, inverse)
    la.store(out, 11, 1, la.times_shape(a, k))
    la.store(out, 12, 0, la.plus_spherical(a, 0.7))
    scalars[0] = la.dot(x, y)
    scalars[1] = determinant
    scalars[2] = la.trace_shape(k)
    scalars[3] = la.largest_eigenvalue(k)
    scalars[4] = la.determinant_minus(a)


@kernel
def _largest(shapes, found, dim):
    for r in range(shapes.shape[0]):
        found[r] = la.largest_eigenvalue(la.shape_at(shapes, r, 0, dim))


def shape_row(matrix):
    """Row of a symmetric d x d matrix in the order xx, yy, (zz,) xy, (yz, xz)."""
    pairs = ((0, 0), (1, 1), (0, 1)) if len(matrix) == 2 else ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
    return np.array([matrix[p] for p in pairs])


@pytest.mark.parametrize("d", [2, 3])
def test_every_operation(d):
    rng = np.random.default_rng(d)
    rows = rng.normal(size=(3, d))
    matrices = rng.normal(size=(2, 2 + d * d))
    tensors = rng.normal(size=(2, 8))
    shape = rng.normal(size=(d, d))
    shape = shape @ shape.T + 0.3 * np.eye(d)
    shapes = np.zeros((2, 8))
    shapes[1, 1 : 1 + d * (d + 1) // 2] = shape_row(shape)
    out, scalars = np.full((13, 10), np.nan), np.empty(5)
    _operate(rows, matrices, tensors, shapes, out, scalars, la.DIMENSION[d])

    x, y = rows[1] - rows[0], rows[2] - rows[0]
    a = matrices[1, 2 : 2 + d * d].reshape(d, d)
    s = to_matrix(tensors[1:, 1 : 1 + (4 if d == 2 else 6)])[0][:d, :d]
    expected = [
        x, x - y, a @ x, shape_row(np.outer(x, x)), np.outer(x, y).ravel(), (a + np.outer(x, y)).ravel(),
        s.ravel(), 3 * x, -2 * a.ravel(), matrices[:, 2 : 2 + d * d].mean(axis=0), shape_row(np.linalg.inv(shape)),
    ]  # fmt: skip
    for found, row in zip(out, expected, strict=False):
        assert found[: len(row)] == pytest.approx(row, rel=1e-12, abs=1e-13)
        assert np.isnan(found[len(row) :]).all()  # nothing is written beyond
    assert np.isnan(out[11, 0]) and out[11, 1 : 1 + d * d] == pytest.approx((a @ shape).ravel(), rel=1e-13)
    assert out[12, : d * d] == pytest.approx((a + 0.7 * np.eye(d)).ravel(), rel=1e-13)
    eigenvalues = np.linalg.eigvalsh(shape)
    expected = [x @ y, np.linalg.det(shape), np.trace(shape), eigenvalues[-1], np.linalg.det(np.eye(d) - a)]
    assert scalars == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_largest_eigenvalue_also_where_eigenvalues_coincide(d):
    rng = np.random.default_rng(5)
    eigenvalues = [[1.0] * d, [2.0, *[1.0] * (d - 1)], [*[2.0] * (d - 1), 1.0], [0.0] * d, [3.0, *[0.0] * (d - 1)]]
    matrices = []
    for values in eigenvalues:
        q, _ = np.linalg.qr(rng.normal(size=(d, d)))
        matrices += [np.diag(values), q @ np.diag(values) @ q.T]
    found = np.empty(len(matrices))
    _largest(np.array([shape_row(m) for m in matrices]), found, la.DIMENSION[d])
    assert found == pytest.approx(np.repeat([max(v) for v in eigenvalues], 2), rel=1e-7)


def test_largest_eigenvalue_shows_nan():
    found = np.empty(1)
    _largest(np.full((1, 6), np.nan), found, la.DIMENSION[3])
    assert np.isnan(found[0])


def test_tensor_rows_and_matrices_are_inverse():
    rows = np.random.default_rng(1).normal(size=(5, 6))
    assert (from_matrix(to_matrix(rows), 6) == rows).all()
    assert (from_matrix(to_matrix(rows[:, :4]), 4) == rows[:, :4]).all()
