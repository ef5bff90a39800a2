"""How far the points of a body are below its surface, and which way out: the faces of a shape near its points.

A lattice cuts a shape in steps. What lies beyond its outermost points is known only here, where the shape is: contact
between bodies acts on the faces of the shape, not on the steps.
"""

import numpy as np

from periporo.io.schema.bodies import Box, Cylinder, Disc, Mesh, Points, Polygon, Raster, Shape, Sphere

_SAME = 0.9  # cosine between normals of faces that are one


def find_faces(shape: Shape, position: np.ndarray, most: int, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Depths (n, most) m below the nearest faces within `reach` m, and their outward normals (n, most, d).

    The nearest comes first; zero where there is none. Points from a file have no shape, hence no
    faces, and what rasters and triangles bound has too many.
    """
    depths, normals = np.full((len(position), most), np.inf), np.zeros((len(position), most, position.shape[1]))
    if not isinstance(shape, Points | Raster | Mesh) and len(position):
        candidates = _candidates(shape, position, reach * (1.0 - 1e-6))
        for k in range(most):
            _take_nearest(candidates, depths, normals, k)
    return np.where(np.isfinite(depths), np.maximum(depths, 0.0), 0.0), normals


def _take_nearest(candidates, depths, normals, k):
    """Fill slot k of every point with the nearest candidate that is not nearly parallel to one taken before."""
    for depth, normal in candidates:
        nearer = depth < depths[:, k]
        for before in range(k):
            nearer &= (normal * normals[:, before]).sum(axis=1) < _SAME
        depths[nearer, k], normals[nearer, k] = depth[nearer], normal[nearer]


def _candidates(shape, position, reach):
    """Depth (n,) below, and normal (n, d) of, each face of a shape; infinite beyond `reach`."""
    match shape:
        case Box():
            found = _slabs(position, shape.lower, shape.upper, range(position.shape[1]))
        case Disc() | Sphere():
            found = [_round(position, np.array(shape.center), shape.radius, range(position.shape[1]))]
        case Cylinder():
            along = "xyz".index(shape.axis)
            base = np.array(shape.base)
            found = [_round(position, base, shape.radius, [a for a in range(3) if a != along])]
            found += _slabs(position, base, base + shape.height, [along])
        case Polygon():
            found = _edges(position, np.array(shape.vertices), reach)
            if shape.extrude:
                found += _slabs(position, [0, 0, shape.extrude[0]], [0, 0, shape.extrude[1]], [2])
    return [(np.where(depth < reach, depth, np.inf), normal) for depth, normal in found]


def _slabs(position, lower, upper, axes):
    found = []
    for axis in axes:
        out = np.zeros_like(position)
        out[:, axis] = 1.0
        found += [(position[:, axis] - lower[axis], -out), (upper[axis] - position[:, axis], out)]
    return found


def _round(position, center, radius, axes):
    out = np.zeros_like(position)
    out[:, axes] = position[:, axes] - center[axes]
    distance = np.sqrt((out**2).sum(axis=1))
    known = distance > 0.0
    return np.where(known, radius - distance, np.inf), out / np.where(known, distance, 1.0)[:, None]


def _edges(position, corners, reach):
    """Faces through the edges of a polygon, and round ones about its re-entrant corners."""
    ahead = np.roll(corners, -1, axis=0) - corners
    if (corners[:, 0] * np.roll(corners[:, 1], -1) - np.roll(corners[:, 0], -1) * corners[:, 1]).sum() < 0.0:
        return _edges(position, corners[::-1], reach)  # counterclockwise from here on
    turn = np.roll(ahead, 1, axis=0)
    convex = turn[:, 0] * ahead[:, 1] - turn[:, 1] * ahead[:, 0] >= 0.0
    flat = position[:, :2]
    found = []
    for k, (start, edge) in enumerate(zip(corners, ahead, strict=True)):
        along = np.clip(((flat - start) @ edge) / (edge @ edge), 0.0, 1.0)
        foot = start + along[:, None] * edge
        away = foot - flat
        near = (away**2).sum(axis=1) < reach**2
        if not near.any():
            continue
        out = np.array([edge[1], -edge[0]]) / np.sqrt(edge @ edge)
        beyond = (along == 0.0) & ~convex[k] | (along == 1.0) & ~convex[(k + 1) % len(corners)]
        distance = np.sqrt((away**2).sum(axis=1))
        round_off = beyond & (distance > 0.0)
        normal = np.zeros_like(position)
        normal[:, :2] = np.where(round_off[:, None], away / np.where(round_off, distance, 1.0)[:, None], out)
        depth = np.where(beyond, distance, (start - flat) @ out)
        found.append((np.where(near, depth, np.inf), normal))
    return found
