"""Reductions on one rank against exact arithmetic; tests/mpi repeats them on several."""

import math
from fractions import Fraction

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.ranks.reductions import any_rank, exact_sum, maximum, minimum, quantile

COMM = MPI.COMM_SELF


def wild(n=3000, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=n) * 10.0 ** rng.uniform(-6, 6, n)


def test_sum_equals_fsum():
    for seed in range(20):
        values = wild(seed=seed)
        assert exact_sum(COMM, values)[0] == math.fsum(values)


def test_sum_does_not_depend_on_the_order():
    values = wild()
    expected = exact_sum(COMM, values)[0]
    for seed in range(10):
        assert exact_sum(COMM, np.random.default_rng(seed).permutation(values))[0] == expected
    assert len({float(np.sum(np.random.default_rng(s).permutation(values))) for s in range(10)}) > 1  # NumPy's does


def test_sum_survives_cancellation():
    values = wild()
    both = np.concatenate([values, [1e-3], -values[::-1]])
    assert exact_sum(COMM, both)[0] == pytest.approx(1e-3, rel=1e-12)


def test_sum_is_exact_to_1e_25_of_the_largest_value():
    values = np.array([1e20, 3.0, 1e-3, -1e20])
    error = Fraction(exact_sum(COMM, values)[0]) - sum(map(Fraction, values))
    assert abs(error) <= len(values) * 1e-25 * 1e20


def test_columns_are_summed_on_their_own():
    values = np.stack([wild(100), 1e-12 * wild(100, 1), np.zeros(100)], axis=1)
    assert exact_sum(COMM, values).tolist() == [math.fsum(c) for c in values.T]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_shows_in_its_column_only(bad):
    values = np.ones((5, 2))
    values[3, 1] = bad
    result = exact_sum(COMM, values)
    assert result[0] == 5.0 and math.isnan(result[1])


def test_sum_of_nothing_is_zero():
    assert exact_sum(COMM, np.zeros((0, 3))).tolist() == [0.0, 0.0, 0.0]
    assert exact_sum(COMM, np.zeros(0)).tolist() == [0.0]


@pytest.mark.parametrize("size", [5e-324, 1e-300, 1e300])
def test_sum_of_extreme_values(size):
    assert exact_sum(COMM, np.array([size, size]))[0] == 2 * size


def test_maximum_and_minimum_show_nan():
    assert maximum(COMM, -3.0) == minimum(COMM, -3.0) == -3.0
    assert maximum(COMM, -math.inf) == -math.inf
    assert math.isnan(maximum(COMM, math.nan)) and math.isnan(minimum(COMM, math.nan))


def test_any_rank():
    assert any_rank(COMM, True) is True and any_rank(COMM, False) is False


def test_quantile_is_the_smallest_value_that_reaches_the_share():
    values = np.random.default_rng(3).normal(size=1000)
    ordered = np.sort(values)
    for share, rank in ((0.001, 1), (0.5, 500), (0.99, 990), (1.0, 1000)):
        assert quantile(COMM, values, share) == pytest.approx(ordered[rank - 1], rel=1e-15)
    assert quantile(COMM, np.array([4.0]), 0.99) == 4.0
    assert math.isnan(quantile(COMM, np.array([]), 0.5))
