"""Vectors in machine registers against NumPy, and that they touch nothing beyond their rows."""

import numpy as np
import pytest
from numba.core.errors import LoweringError

from periporo.core.numerics import vectors
from periporo.core.numerics.algebra import DIMENSION
from periporo.core.numerics.jit import kernel

SIZES = (2, 3, 4, 6, 8, 9, 16)


@kernel
def combine(rows, like, factor, out):
    a, b = vectors.row(rows, 0, like), vectors.row(rows, 1, like)
    vectors.put(out, 0, a + b)
    vectors.put(out, 1, a - b)
    vectors.put(out, 2, a * factor)
    vectors.put(out, 3, vectors.difference(rows, 0, 1, like))
    vectors.put(out, 4, vectors.zero(like))
    total = vectors.zero(like)
    total += a
    vectors.put(out, 5, total)


@kernel
def products(x, matrices, dim, matrix, out_x, out_matrix, numbers):
    a, y, z = vectors.row(matrices, 2, matrix), vectors.row(x, 0, dim), vectors.row(x, 1, dim)
    vectors.put(out_x, 0, vectors.apply(a, y))
    vectors.put(out_matrix, 0, vectors.dyad(y, z))
    numbers[0], numbers[1] = vectors.dot(y, z), vectors.trace(a)


@kernel
def squares(x, dim, out):
    vectors.put(out, 0, vectors.square(vectors.row(x, 0, dim)))


@kernel
def in_space(rows, like, out):
    vectors.put(out, 0, vectors.full(vectors.row(rows, 1, like)))


@kernel
def put_between(numbers, place, rows, like):
    vectors.put_at(numbers, place, vectors.row(rows, 0, like))


@kernel
def sum_of_ends(first, second, terms, like, sums):
    last, own = -1, vectors.zero(like)
    for b in range(first.shape[0]):
        term = vectors.row(terms, b, like)
        last, own = vectors.add_to_ends(sums, first[b], second[b], term, term * 2.0, last, own)


@kernel
def moments_of(pairs, k, dim, out):
    vectors.put(out, 0, vectors.moments(pairs, k, dim))


@pytest.fixture
def random():
    return np.random.default_rng(4)


@pytest.mark.parametrize("size", SIZES)
def test_sums_differences_and_multiples(random, size):
    rows, out = random.normal(size=(2, size)), np.zeros((6, size))
    combine(rows, (0.0,) * size, 0.3, out)
    a, b = rows
    np.testing.assert_array_equal(out, [a + b, a - b, 0.3 * a, b - a, 0.0 * a, a])


@pytest.mark.parametrize("d", (2, 3))
def test_products(random, d):
    x, matrices = random.normal(size=(2, d)), random.normal(size=(3, d * d))
    image, dyad, numbers = np.zeros((1, d)), np.zeros((1, d * d)), np.zeros(2)
    products(x, matrices, DIMENSION[d], (0.0,) * d**2, image, dyad, numbers)
    a = matrices[2].reshape(d, d)
    np.testing.assert_allclose(image[0], a @ x[0], rtol=1e-14)
    np.testing.assert_array_equal(dyad[0], np.outer(x[0], x[1]).ravel())
    np.testing.assert_allclose(numbers, [x[0] @ x[1], np.trace(a)], rtol=1e-14)


@pytest.mark.parametrize("d", (2, 3))
def test_the_square_of_a_vector(random, d):
    x, out = random.normal(size=(1, d)), np.zeros((1, d * (d + 1) // 2))
    squares(x, DIMENSION[d], out)
    order = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}[d]
    np.testing.assert_array_equal(out[0], [x[0, a] * x[0, b] for a, b in order])


@pytest.mark.parametrize("d", (2, 3))
def test_the_full_matrix_of_a_symmetric_tensor(random, d):
    rows, out = random.normal(size=(2, {2: 4, 3: 6}[d])), np.zeros((1, d * d))
    in_space(rows, tuple(rows[0]), out)
    xx, yy, zz, xy, *others = rows[1]
    yz, xz = others or (0.0, 0.0)
    np.testing.assert_array_equal(out[0].reshape(d, d), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[:d, :d])


@pytest.mark.parametrize("size", SIZES)
def test_nothing_beyond_a_vector_is_written(random, size):
    numbers, rows = random.normal(size=size + 9), random.normal(size=(1, size))
    expected = numbers.copy()
    expected[4 : 4 + size] = rows[0]
    put_between(numbers, 4, rows, (0.0,) * size)
    np.testing.assert_array_equal(numbers, expected)


@pytest.mark.parametrize("size", SIZES)
def test_ends_of_pairs_are_added_in_order(random, size):
    """To the bit: lower points first, as the sum written out adds them."""
    first, second = np.triu_indices(6, 1)
    terms, sums = random.normal(size=(len(first), size)), random.normal(size=(6, size))
    expected = sums.copy()
    for i, j, term in zip(first, second, terms, strict=True):
        expected[i] += term
        expected[j] += 2.0 * term
    sum_of_ends(first, second, terms, (0.0,) * size, sums)
    np.testing.assert_array_equal(sums, expected)


@pytest.mark.parametrize("d", (2, 3))
def test_moments_of_a_pair(random, d):
    xi, dv = random.normal(size=d), random.normal(size=d)
    pairs = np.zeros(3 * vectors.WIDTH)
    pairs[2 * vectors.WIDTH :][: 1 + 2 * d] = [1.0, *xi, *dv]
    order = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}[d]
    expected = [1.0, *(xi[a] * xi[b] for a, b in order), *np.outer(dv, xi).ravel()]
    out = np.zeros((1, len(expected)))
    moments_of(pairs, 2, DIMENSION[d], out)
    np.testing.assert_array_equal(out[0], expected)


def test_rows_that_do_not_follow_each_other_are_refused():
    rows = np.zeros((2, 8))[:, ::2]
    with pytest.raises(LoweringError, match="must follow each other in memory"):
        combine(rows, (0.0,) * 4, 1.0, np.zeros((6, 4)))


def test_nan_stays_visible_and_where_it_is():
    sums, terms = np.zeros((2, 4)), np.array([[0.0, np.nan, 0.0, 1.0]])
    sum_of_ends(np.array([0]), np.array([1]), terms, (0.0,) * 4, sums)
    assert np.isnan(sums[:, 1]).all() and np.isnan(sums).sum() == 2
