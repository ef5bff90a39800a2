"""Profiles: a field of points along a line."""

import numpy as np

_REACH = 1.5  # spacings, within which points have a say at a place
_SOIL = 0.53  # of the diagonal of a cell from the nearest point, beyond which there is no soil


def along_line(
    positions: np.ndarray, values: np.ndarray, start: np.ndarray, end: np.ndarray, spacing: float, count: int,
    dimension: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Distances (count,) m from `start` to `end`, (3,) m each, and there the `values` (n, ...) of points.

    By weighted least squares of first order around each place, so that linear fields are exact; NaN without soil.
    """
    line = np.asarray(end, float) - start
    part = np.linspace(0.0, 1.0, count)
    found = np.full((count, *values.shape[1:]), np.nan)
    farthest = _SOIL * np.sqrt(dimension) * spacing
    for k, place in enumerate(start + part[:, None] * line):
        way = positions - place
        length = np.sqrt((way**2).sum(axis=1))
        near = length < _REACH * spacing
        if not length.min(initial=np.inf) <= farthest:
            continue
        weight = (1.0 - length[near] / (_REACH * spacing)) ** 2
        weight /= weight.sum()
        own = values[near].reshape(len(weight), -1)
        middle, mean = weight @ way[near], weight @ own
        root = np.sqrt(weight)[:, None]
        slope = np.linalg.lstsq(root * (way[near] - middle), root * (own - mean), rcond=1e-6)[0]  # 0 across a plane
        found[k] = (mean - middle @ slope).reshape(values.shape[1:])
    return part * float(np.sqrt((line**2).sum())), found
