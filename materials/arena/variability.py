"""Weibull-distributed strength with a size effect, drawn from global ids (Arena manual, appendix F)."""

import math

import numpy as np

from periporo.core.numerics.random_numbers import INCREMENT, splitmix64


def uniform_draws(ids: np.ndarray, seed: int) -> np.ndarray:
    """One number in (0, 1) per global id, the same on every rank count (splitmix64 of id and seed)."""
    with np.errstate(over="ignore"):
        words = splitmix64((ids.astype(np.uint64) + np.uint64(seed) * np.uint64(0xD1342543DE82EF95)) * INCREMENT)
    return ((words >> np.uint64(11)).astype(float) + 0.5) / 2.0**53


def exponential_draws(ids: np.ndarray, seed: int) -> np.ndarray:
    """Unit-exponential number of each row with the end ids (n, 2).

    A point (equal ids) takes its own draw. A bond is two halves of which the weaker decides: twice the
    smaller of two unit-exponential numbers is unit-exponential again, so bonds and points have exactly the
    same distribution (Weibull's weakest link).
    """
    first = -np.log(uniform_draws(ids[:, 0], seed))
    second = -np.log(uniform_draws(ids[:, 1], seed))
    return np.where(ids[:, 0] == ids[:, 1], first, 2.0 * np.minimum(first, second))


def strength_factors(
    ids: np.ndarray, volume: np.ndarray, modulus: float, exponent: float, reference_volume: float, seed: int
) -> np.ndarray:
    """Factor (n,) on a strength: size effect (V_ref/V)^(1/`exponent`) times a Weibull number of mean 1 (eq. 284).

    `ids` (n, 2), `volume` (n,) m^3. Seed 0 draws nothing: the size effect alone.
    """
    size = (reference_volume / volume) ** (1.0 / exponent)
    if seed == 0:
        return size
    draws = exponential_draws(ids, seed)
    return size * draws ** (1.0 / modulus) / math.gamma(1.0 + 1.0 / modulus)
