"""The water table in a result: where, going up, the pressure of the pore water falls to zero."""

import numpy as np

_SAME = 1e-6  # spacings: on which side of the edge of a column a point of a lattice stands


def water_table(position, pressure, spacing: float, axis: int, sense: float, weight: float) -> np.ndarray:
    """Places (m, 3) m of zero pressure, one for each column of soil that has them, in the order of the columns.

    Columns are a `spacing` m wide, and run along `axis`, up being its `sense` (1 or -1). In each of them the lowest
    place counts below which pores are under `pressure` (n,) Pa >= 0 and above which they are not, linear between the
    two points at `position` (n, 3) m. Where the uppermost point is under pressure water stands above it by the
    pressure over `weight` N/m^3, at most half a spacing: up to the surface.
    """
    level = sense * position[:, axis]
    across = np.delete(position, axis, axis=1)
    column = np.floor((across - across.min(axis=0)) / spacing + 0.5 + _SAME).astype(np.int64)
    order = np.lexsort((level, *column.T[::-1]))
    column, level, pressure, across = column[order], level[order], pressure[order], across[order]
    top = np.append((column[1:] != column[:-1]).any(axis=1), True)
    above = np.minimum(np.arange(1, len(order) + 1), len(order) - 1)
    wet = (pressure >= 0.0) & (top | (pressure[above] < 0.0))
    rise = level[above] - level
    fall = np.where(wet & ~top, pressure - pressure[above], 1.0)
    height = level + np.where(top, np.minimum(pressure / weight, 0.5 * spacing), rise * pressure / fall)
    rows = np.flatnonzero(wet)
    first = np.ones(len(rows), bool)  # of its column
    first[1:] = (column[rows[1:]] != column[rows[:-1]]).any(axis=1)
    rows = rows[first]
    middle = across.min(axis=0) + column[rows] * spacing
    return np.insert(middle, axis, sense * height[rows], axis=1)
