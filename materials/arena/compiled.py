"""Decorator of Arena's scalar functions: inlined always, since calls would pass dozens of parameters."""

import numba

from periporo.core.jit import FASTMATH

inlined = numba.njit(fastmath=FASTMATH, error_model="numpy", forceinline=True)
