"""Rows of each point, and averages of stress and state over them, from which newborn rows begin."""

import numpy as np

from periporo.core.numerics.jit import kernel


@kernel
def incidence_of(first, second, points):
    """Rows of each point in ascending order: start (points + 1,) and row numbers; both ends may be the same."""
    start = np.zeros(points + 1, np.int64)
    for r in range(first.shape[0]):
        start[first[r] + 1] += 1
        if second[r] != first[r]:
            start[second[r] + 1] += 1
    for i in range(points):
        start[i + 1] += start[i]
    filled = start.copy()
    rows = np.empty(start[points], np.int32)
    for r in range(first.shape[0]):
        i, j = first[r], second[r]
        rows[filled[i]] = r
        filled[i] += 1
        if j != i:
            rows[filled[j]] = r
            filled[j] += 1
    return start, rows


@kernel
def average_points(
    points, start, incidence, begin, end, pair, first, second, weight, active, volume, stress, state, logs, average
):
    """Means over the active rows `begin` ... `end` of each of the `points`, weights w V of the other end; 1 first."""
    components = stress.shape[1]
    for n in range(points.shape[0]):
        i = points[n]
        for c in range(average.shape[1]):
            average[i, c] = 0.0
        total = 0.0
        last = 0
        for k in range(start[i], start[i + 1]):
            r = incidence[k] - begin
            if r < 0 or r >= end - begin or not active[r]:
                continue
            b = pair[r]
            other = second[b] if first[b] == i else first[b]
            w = weight[b] * volume[other]
            total += w
            for c in range(components):
                average[i, 1 + c] += w * stress[r, c]
            for c in range(state.shape[1]):
                value = state[r, c]
                average[i, 1 + components + c] += w * (np.log(abs(value)) if logs[c] else value)
            last = r
        if total > 0.0:
            for c in range(1, average.shape[1]):
                average[i, c] /= total
            for c in range(state.shape[1]):
                if logs[c]:  # such a field keeps its sign, so any row tells it
                    magnitude = np.exp(average[i, 1 + components + c])
                    average[i, 1 + components + c] = -magnitude if state[last, c] < 0.0 else magnitude
            average[i, 0] = 1.0


def merged(first, second, has_first, has_second, components, block):
    """Mean of two points' averages; logarithmic columns by the mean of ln|value|."""
    logs = np.concatenate([np.zeros(components, bool), block.log_columns])
    weight = np.maximum(has_first + has_second, 1.0)
    result = (has_first * first + has_second * second) / weight
    if logs.any():
        with np.errstate(divide="ignore", invalid="ignore"):
            total = np.where(has_first > 0, np.log(np.abs(first[:, logs])), 0.0) + np.where(
                has_second > 0, np.log(np.abs(second[:, logs])), 0.0
            )
        result[:, logs] = np.sign(result[:, logs]) * np.exp(total / weight)
    return result
