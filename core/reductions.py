"""Reductions over ranks whose result does not depend on how the values are distributed."""

import math

import numpy as np
from mpi4py import MPI

from periporo.core.jit import kernel


def maximum(comm: MPI.Comm, value: float) -> float:
    """Largest value over ranks; NaN on any rank gives NaN."""
    local = np.array([value, 1.0 if math.isnan(value) else 0.0])
    if local[1]:
        local[0] = -math.inf
    comm.Allreduce(MPI.IN_PLACE, local, MPI.MAX)
    return math.nan if local[1] else float(local[0])


def minimum(comm: MPI.Comm, value: float) -> float:
    """Smallest value over ranks; NaN on any rank gives NaN."""
    return -maximum(comm, -value)


def any_rank(comm: MPI.Comm, flag: bool) -> bool:
    """Whether `flag` holds on at least one rank."""
    return bool(comm.allreduce(bool(flag), MPI.LOR))


def exact_sum(comm: MPI.Comm, values: np.ndarray) -> np.ndarray:
    """Column sums of `values` (n,) or (n, k) over all rows of all ranks, (k,).

    Every value is split into two integers on a grid given by the largest magnitude, so that adding them is
    exact and the result the same for any distribution; its relative error is below 1e-25 of the largest
    value times the count. NaN or infinity in a column makes its sum NaN.
    """
    values = np.asarray(values, dtype=np.float64)
    if values.ndim == 1:
        values = values[:, None]
    columns = values.shape[1]
    head = np.zeros((2, columns))  # largest magnitude, and whether all are finite
    _look_over(values, head)
    comm.Allreduce(MPI.IN_PLACE, head, MPI.MAX)
    count = comm.allreduce(len(values))
    bits = 61 - max(count, 1).bit_length()
    exponent = np.frexp(head[0])[1]
    shift = bits - exponent
    factors = np.ldexp(1.0, [shift // 2, shift - shift // 2])  # by halves: the whole one may not be a number
    words = np.zeros((2, columns), np.int64)
    _add_words(values, factors, head[1], 2.0**bits, words)
    comm.Allreduce(MPI.IN_PLACE, words, MPI.SUM)
    result = np.empty(columns)
    for c in range(columns):
        whole = (int(words[0, c]) << bits) + int(words[1, c])  # exact, rounded once below
        result[c] = math.nan if head[1, c] else _to_float(whole, int(exponent[c]) - 2 * bits)
    return result


def inner(comm: MPI.Comm, a: np.ndarray, b: np.ndarray) -> float:
    """Sum of a b over all components of all rows of all ranks."""
    return float(exact_sum(comm, (a * b).ravel())[0])


@kernel
def _look_over(values, head):
    for r in range(values.shape[0]):
        for c in range(values.shape[1]):
            size = abs(values[r, c])
            if not size < np.inf:
                head[1, c] = 1.0
            elif size > head[0, c]:
                head[0, c] = size


@kernel
def _add_words(values, factors, spoiled, scale, words):
    """Add the two integers of every value of the columns that are not `spoiled`."""
    for r in range(values.shape[0]):
        for c in range(values.shape[1]):
            if spoiled[c] == 0.0:
                scaled = values[r, c] * factors[0, c] * factors[1, c]
                high = np.rint(scaled)
                words[0, c] += np.int64(high)
                words[1, c] += np.int64(np.rint((scaled - high) * scale))


def _to_float(mantissa: int, exponent: int) -> float:
    """mantissa * 2**exponent, correctly rounded."""
    excess = max(mantissa.bit_length() - 64, 0)
    sticky = 1 if mantissa & ((1 << excess) - 1) else 0
    return math.ldexp(float((mantissa >> excess) | sticky), exponent + excess)


def quantile(comm: MPI.Comm, values: np.ndarray, share: float) -> float:
    """Smallest value that at least `share` of all values of all ranks do not exceed; NaN if there are none."""
    count = comm.allreduce(len(values))
    if count == 0:
        return math.nan
    low, high = minimum(comm, float(values.min(initial=math.inf))), maximum(comm, float(values.max(initial=-math.inf)))
    while True:  # by bisection down to neighbouring numbers
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if comm.allreduce(int((values <= middle).sum())) >= share * count:
            high = middle
        else:
            low = middle
    return low if comm.allreduce(int((values <= low).sum())) >= share * count else high
