"""Sums by machine vectors against sums written out."""

import numpy as np
import pytest

from periporo.core.algebra import DIMENSION
from periporo.core.jit import kernel
from periporo.core.vectors import WIDTH, add_moments, add_row, add_scaled, add_tuple


@kernel
def add_a_tuple(target, i, value):
    add_tuple(target, i, value)


@kernel
def add_a_multiple(target, i, source, j, factor, like):
    add_scaled(target, i, source, j, factor, like)


@kernel
def add_a_term(target, i, terms, k, dim):
    add_row(target, i, terms, k, dim)


@kernel
def add_a_pair(sums, i, j, pairs, k, factor, dim):
    add_moments(sums, i, j, pairs, k, factor, dim)


@pytest.fixture
def random():
    return np.random.default_rng(4)


@pytest.mark.parametrize("count", (2, 3, 4, 9))
def test_a_tuple_goes_to_the_start_of_its_row_and_nowhere_else(random, count):
    target, value = random.normal(size=(5, 11)), tuple(random.normal(size=count))
    expected = target.copy()
    expected[3, :count] += value
    add_a_tuple(target, 3, value)
    np.testing.assert_array_equal(target, expected)


@pytest.mark.parametrize("count", (4, 8, 9, 16))
def test_a_multiple_of_a_row(random, count):
    target, source = random.normal(size=(4, count + 1)), random.normal(size=(6, count))
    expected = target.copy()
    expected[1, :count] += -0.3 * source[5]
    add_a_multiple(target, 1, source, 5, -0.3, (0.0,) * count)
    np.testing.assert_allclose(target, expected, rtol=1e-15, atol=1e-16)


@pytest.mark.parametrize("d", (2, 3))
def test_a_row_of_terms(random, d):
    target, terms = random.normal(size=(4, d * d)), random.normal(size=7 * d * d)
    expected = target.copy()
    expected[2] += terms[5 * d * d : 6 * d * d]
    add_a_term(target, 2, terms, 5, DIMENSION[d])
    np.testing.assert_array_equal(target, expected)


@pytest.mark.parametrize("d", (2, 3))
def test_moments_of_a_pair_go_to_both_ends(random, d):
    xi, dv, factor = random.normal(size=d), random.normal(size=d), 0.7
    pairs = np.zeros(3 * WIDTH)
    pairs[2 * WIDTH : 2 * WIDTH + 1 + 2 * d] = [1.0, *xi, *dv]
    order = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}[d]
    term = factor * np.array([1.0, *(xi[a] * xi[b] for a, b in order), *np.outer(dv, xi).ravel()])
    sums = random.normal(size=(5, len(term)))
    expected = sums.copy()
    expected[[0, 3]] += term
    add_a_pair(sums, 0, 3, pairs, 2, factor, DIMENSION[d])
    np.testing.assert_allclose(sums, expected, rtol=1e-14, atol=1e-15)


def test_nan_stays_visible():
    target = np.zeros((2, 4))
    add_a_tuple(target, 1, (0.0, np.nan, 0.0, 1.0))
    assert np.isnan(target[1, 1]) and np.isnan(target).sum() == 1
