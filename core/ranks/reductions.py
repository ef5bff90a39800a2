"""Reductions over ranks whose result does not depend on how the values are distributed."""

import math

import numpy as np
from mpi4py import MPI

from periporo.core.numerics.jit import kernel

_MAGNITUDE = np.int64(2**63 - 1)  # all bits of a float64 but that of its sign


def maximum(comm: MPI.Comm, value: float) -> float:
    """Largest value over ranks; NaN on any rank gives NaN."""
    if comm.size == 1:
        return float(value)
    local = np.array([value, 1.0 if math.isnan(value) else 0.0])
    if local[1]:
        local[0] = -math.inf
    comm.Allreduce(MPI.IN_PLACE, local, MPI.MAX)
    return math.nan if local[1] else float(local[0])


def maxima(comm: MPI.Comm, values: np.ndarray) -> np.ndarray:
    """Largest of each of the `values` (n,) over ranks, as `maximum`."""
    if comm.size == 1:
        return values
    both = np.stack([np.where(np.isnan(values), -np.inf, values), np.isnan(values)])
    comm.Allreduce(MPI.IN_PLACE, both, MPI.MAX)
    return np.where(both[1] > 0.0, np.nan, both[0])


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
    return exact_sums(comm, [values])[0]


def exact_sums(comm: MPI.Comm, tables: list[np.ndarray]) -> list[np.ndarray]:
    """`exact_sum` of each of the `tables`, which may differ in rows and columns, with the messages of one."""
    tables = [np.ascontiguousarray(t if t.ndim == 2 else t[:, None], np.float64) for t in map(np.asarray, tables)]
    ends = np.cumsum([t.shape[1] for t in tables])
    parts = [slice(end - t.shape[1], end) for end, t in zip(ends, tables, strict=True)]
    largest = np.zeros(ends[-1], np.int64)
    for part, values in zip(parts, tables, strict=True):
        _largest_bits(values.view(np.int64), largest[part])
    comm.Allreduce(MPI.IN_PLACE, largest, MPI.MAX)
    largest = largest.view(np.float64)
    spoiled = ~np.isfinite(largest)
    if spoiled.any():
        tables = [np.where(spoiled[part], 0.0, values) for part, values in zip(parts, tables, strict=True)]
        largest = np.where(spoiled, 0.0, largest)
    counts = np.array([len(t) for t in tables])
    comm.Allreduce(MPI.IN_PLACE, counts, MPI.SUM)
    exponent = np.frexp(largest)[1]
    bits = np.concatenate([np.full(t.shape[1], 61 - max(int(n), 1).bit_length())
                           for t, n in zip(tables, counts, strict=True)])  # fmt: skip
    shift = bits - exponent
    factors = np.ldexp(1.0, [shift // 2, shift - shift // 2])  # by halves: the whole one may not be a number
    words = np.zeros((2, ends[-1]), np.int64)
    for part, values in zip(parts, tables, strict=True):
        own = np.zeros((2, values.shape[1]), np.int64)
        _add_words(values, np.ascontiguousarray(factors[:, part]), 2.0 ** float(bits[part.start]), own)
        words[:, part] = own
    comm.Allreduce(MPI.IN_PLACE, words, MPI.SUM)
    result = np.empty(ends[-1])
    for c in range(ends[-1]):
        whole = (int(words[0, c]) << int(bits[c])) + int(words[1, c])  # exact, rounded once below
        result[c] = math.nan if spoiled[c] else _to_float(whole, int(exponent[c]) - 2 * int(bits[c]))
    return [result[part] for part in parts]


def inner(comm: MPI.Comm, a: np.ndarray, b: np.ndarray) -> float:
    """Sum of a b over all components of all rows of all ranks."""
    return float(exact_sum(comm, (a * b).ravel())[0])


@kernel
def _largest_bits(bits, largest):
    """Largest magnitude of each column of float64, all as integers: these are ordered alike, and NaN is above all."""
    for c in range(bits.shape[1]):
        found = np.int64(0)
        for r in range(bits.shape[0]):
            found = max(found, bits[r, c] & _MAGNITUDE)
        largest[c] = found


@kernel
def _add_words(values, factors, scale, words):
    """Add the two integers of every value; a column at a time, which a machine vector holds eight rows of."""
    for c in range(values.shape[1]):
        high_sum, low_sum = np.int64(0), np.int64(0)
        for r in range(values.shape[0]):
            scaled = values[r, c] * factors[0, c] * factors[1, c]
            high = np.rint(scaled)
            high_sum += np.int64(high)
            low_sum += np.int64(np.rint((scaled - high) * scale))
        words[0, c] += high_sum
        words[1, c] += low_sum


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
