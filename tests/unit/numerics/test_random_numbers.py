"""Random numbers by ids: their distribution, and the published generator."""

import numpy as np

from periporo.core.numerics.random_numbers import INCREMENT, splitmix64, uniform


def test_random_numbers_are_uniform_and_independent():
    u = uniform(np.arange(20_000), 3, seed=0)
    assert u.min() >= 0 and u.max() < 1
    counts = np.histogram(u.ravel(), bins=20, range=(0, 1))[0]
    chi_square = ((counts - 3000) ** 2 / 3000).sum()
    assert 4 < chi_square < 50  # 19 degrees of freedom
    correlation = np.corrcoef(np.concatenate([u[:-1].T, u[1:].T]))
    assert np.abs(correlation - np.eye(6)).max() < 0.03
    np.testing.assert_array_equal(u[5:7], uniform(np.array([5, 6]), 3, seed=0))


def test_random_numbers_are_those_of_the_published_generator():
    """First outputs of splitmix64 from the state 0: Vigna's reference program (2015)."""
    first, second = 0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4
    words = splitmix64(np.array([0, INCREMENT], dtype=np.uint64))
    assert [int(w) for w in words] == [first, second]
