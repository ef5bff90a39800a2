"""Random numbers that depend on ids alone, so that they are the same on any number of ranks."""

import numpy as np

INCREMENT = np.uint64(0x9E3779B97F4A7C15)
"""Of the states of splitmix64."""


def uniform(ids: np.ndarray, columns: int, seed: int) -> np.ndarray:
    """Random numbers (n, columns) in [0, 1) that depend on `seed` and each row's id alone (splitmix64)."""
    start = splitmix64(np.array([seed], dtype=np.uint64))
    rows = splitmix64(ids.astype(np.uint64) + start)
    words = splitmix64(rows[:, None] + np.arange(columns, dtype=np.uint64))
    return (words >> np.uint64(11)) * 2.0**-53


def splitmix64(states: np.ndarray) -> np.ndarray:
    """The uint64 that splitmix64 (Steele, Lea & Flood 2014) gives from each of its `states`."""
    words = states + INCREMENT
    words = (words ^ (words >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    words = (words ^ (words >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return words ^ (words >> np.uint64(31))
