"""Decorator of Arena's scalar functions, and a fast power.

Functions are inlined always, since calls would pass dozens of parameters.
"""

import math

import numba

from periporo.core.jit import FASTMATH

inlined = numba.njit(fastmath=FASTMATH, error_model="numpy", forceinline=True)


@inlined
def power(x, exponent):
    """`x` > 0 to a power, to 1e-16 (1 + |exponent ln x|): a quarter faster than pow, which is exact to the last bit."""
    return math.exp(exponent * math.log(x))
