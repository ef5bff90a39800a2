"""A power that is fast enough for Arena's scalar functions."""

import math

from periporo.core.numerics.jit import inlined


@inlined
def power(x, exponent):
    """`x` > 0 to a power, to 1e-16 (1 + |exponent ln x|): a quarter faster than pow, which is exact to the last bit."""
    return math.exp(exponent * math.log(x))
