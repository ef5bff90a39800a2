"""Measures of a cloud of flowing points: its true area, its volumes, and the scatter of its stress."""

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Voronoi, cKDTree

_CONNECTED = 1.6  # spacings between neighbours of one body
_CLOSING = 1.3  # spacings: gaps between points that are narrower than twice this are not gaps
_FINE = 8  # cells of the raster per spacing
_SKIN = 2.5  # spacings beneath the outline
_HORIZON = 2.2  # spacings over which stress is compared
_FEWEST = 10  # neighbours of a point whose stress is compared


def connected(position: np.ndarray, spacing: float) -> np.ndarray:
    """Which points (n,) belong to the largest body of those closer than 1.6 spacings to one another."""
    pairs = cKDTree(position).query_pairs(_CONNECTED * spacing, output_type="ndarray")
    n = len(position)
    _, body = connected_components(coo_matrix((np.ones(len(pairs)), pairs.T), shape=(n, n)), directed=False)
    return body == np.bincount(body).argmax()


def covered_area(position: np.ndarray, spacing: float) -> float:
    """Area (m^2) above y = 0 that points (n, 2) cover: their outline with gaps closed, half a spacing outside them.

    Discs around the points grow by 1.3 spacings and what they cover shrinks by .8 again, on a raster of an eighth of a
    spacing. The floor counts as a mirror. A lattice block gives its area less its four rounded corners.
    """
    _, covered = _covered(position, spacing)
    return float(covered.sum() * (spacing / _FINE) ** 2)


def profile(position: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Places x (m) and the height (m) over y = 0 of what points (n, 2) cover there."""
    x, covered = _covered(position, spacing)
    return x, covered.sum(axis=1) * spacing / _FINE


def cells(position: np.ndarray, spacing: float) -> np.ndarray:
    """Area (n,) m^2 of the Voronoi cells of points (n, 2), NaN of those within 2.5 spacings of their outline.

    The floor, y = 0, is a mirror.
    """
    x, covered = _covered(position, spacing)
    below = covered.shape[1]
    depth = ndimage.distance_transform_edt(np.pad(np.hstack([covered[:, ::-1], covered]), 1))[1:-1, 1 + below : -1]
    column = np.rint((position[:, 0] - x[0]) * _FINE / spacing).astype(int)
    row = (position[:, 1] * _FINE / spacing).astype(int)
    cloud, area = Voronoi(np.vstack([position, position * [1, -1]])), np.full(len(position), np.nan)
    for i in np.flatnonzero(depth[column, row] > _SKIN * _FINE):
        a, b = cloud.vertices[cloud.regions[cloud.point_region[i]]].T
        area[i] = 0.5 * abs(a @ np.roll(b, 1) - b @ np.roll(a, 1))
    return area


def _covered(position, spacing):
    """Places x (k,) m of the columns of a raster, and which of its cells (k, l) above y = 0 are covered."""
    cell = spacing / _FINE
    low, high = position.min(axis=0) - 4 * spacing, position.max(axis=0) + 4 * spacing
    low[1] = -6 * spacing
    shape = np.ceil((high - low) / cell).astype(int)
    empty = np.ones(shape, bool)
    place = np.floor((np.vstack([position, position * [1, -1]]) - low) / cell).astype(int)
    place = place[((place >= 0) & (place < shape)).all(axis=1)]
    empty[place[:, 0], place[:, 1]] = False
    grown = ndimage.distance_transform_edt(empty) * cell < _CLOSING * spacing
    closed = ndimage.distance_transform_edt(grown) * cell > (_CLOSING - 0.5) * spacing
    x, height = (low[a] + (np.arange(shape[a]) + 0.5) * cell for a in range(2))
    return x, closed[:, height > 0]


def grown(first: np.ndarray, position: np.ndarray, spacing: float) -> np.ndarray:
    """Area (n,) over the first of the cross that a point and its neighbours of the lattice `first` (n, d) make.

    NaN for points with fewer; it says what soil has done that kept its neighbours.
    """
    area = np.full(len(first), np.nan)
    for i, near in enumerate(cKDTree(first).query_ball_point(first, 1.1 * spacing)):
        if len(near) == 1 + 2 * first.shape[1]:
            stretch, *_ = np.linalg.lstsq(first[near] - first[i], position[near] - position[i], rcond=None)
            area[i] = np.linalg.det(stretch)
    return area


def fluctuations(position: np.ndarray, values: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Deviation (n,) of `values` from a linear field through the neighbours of each point, and the neighbours' mean.

    NaN for points with fewer than ten neighbours within 2.2 spacings, themselves included.
    """
    deviation, mean = np.full(len(position), np.nan), np.full(len(position), np.nan)
    for i, near in enumerate(cKDTree(position).query_ball_point(position, _HORIZON * spacing)):
        if len(near) < _FEWEST:
            continue
        plane = np.c_[np.ones(len(near)), position[near] - position[i]]
        deviation[i] = values[i] - np.linalg.lstsq(plane, values[near], rcond=None)[0][0]
        mean[i] = values[near].mean()
    return deviation, mean


def scatter(position: np.ndarray, stress: np.ndarray, spacing: float, chosen: np.ndarray, least: float) -> float:
    """Standard deviation of `stress` (n,) from its local field over its mean, of the `chosen` points that bear `least`.

    `least` Pa is the compression, as a mean of the neighbours, from which a point counts. NaN for fewer than 5 points.
    """
    deviation, mean = fluctuations(position, stress, spacing)
    counted = chosen & np.isfinite(deviation) & (mean < -least)
    if counted.sum() < 5:
        return np.nan
    return float(deviation[counted].std() / -mean[counted].mean())
