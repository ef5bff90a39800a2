"""What shapes hold: bounds, and which places lie inside or on the edge."""

import numpy as np

from periporo.core.numerics.meshes import mesh_gap
from periporo.io.geometry.layers import layer_of
from periporo.io.geometry.meshes import Mesh as Surface
from periporo.io.geometry.meshes import read_mesh
from periporo.io.geometry.points import PointTable, read_points
from periporo.io.schema.bodies import Box, Cylinder, Disc, Mesh, Points, Polygon, Raster, Shape, Sphere


def table(shape: Points, dimension: int) -> PointTable:
    """The points of a shape from a file. Raises PointFileError."""
    return read_points(shape.file, dimension, shape._origin, cells=shape.cells)


def surface(shape: Mesh) -> Surface:
    """The closed surface around a shape from a file. Raises GroundFileError."""
    return read_mesh(shape.file, shape._origin, closed=True)


def bounds(shape: Shape, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner (d,) m of the box around a shape. Raises PointFileError, GroundFileError."""
    match shape:
        case Box():
            return np.array(shape.lower), np.array(shape.upper)
        case Disc() | Sphere():
            return np.array(shape.center) - shape.radius, np.array(shape.center) + shape.radius
        case Cylinder():
            base, along = np.array(shape.base), np.arange(3) == "xyz".index(shape.axis)
            lower = base - np.where(along, 0.0, shape.radius)
            return lower, base + np.where(along, shape.height, shape.radius)
        case Polygon():
            corners, extrude = np.array(shape.vertices), [[z] for z in shape.extrude or ()]
            sides = np.concatenate(
                [[corners.min(axis=0), corners.max(axis=0)], np.array(extrude or [[], []])], axis=1
            )
            return sides[0], sides[1]
        case Points():
            positions = table(shape, dimension).positions
            return positions.min(axis=0), positions.max(axis=0)
        case Raster():
            return layer_of(shape).bounds
        case Mesh():
            corners = surface(shape).tree.corners
            return corners.min(axis=0), corners.max(axis=0)


def inside(shape: Shape, positions: np.ndarray) -> np.ndarray:
    """Which of `positions` (n, d), centres of cells within the bounds of a shape, lie inside it, (n,) bool."""
    match shape:
        case Disc() | Sphere():
            return np.sum((positions - shape.center) ** 2, axis=1) <= shape.radius**2
        case Cylinder():
            across = [axis for axis in range(3) if "xyz"[axis] != shape.axis]
            return np.sum((positions - shape.base)[:, across] ** 2, axis=1) <= shape.radius**2
        case Polygon():
            return inside_polygon(np.array(shape.vertices), positions)
        case Raster():
            layer = layer_of(shape)
            above = positions[:, 2] - layer.ground.at(positions)
            return (above >= 0.0) & (above <= layer.thickness(positions))
        case Mesh():
            return surface(shape).inside(positions)
        case _:
            return np.ones(len(positions), dtype=bool)


def holds(shape: Shape, positions: np.ndarray, margin: float) -> np.ndarray:
    """Which of `positions` (n, d) lie inside a shape that is larger by `margin` m all around (smaller if negative)."""
    lower, upper = bounds(shape, positions.shape[1])
    within = np.all((positions >= lower - margin) & (positions <= upper + margin), axis=1)
    match shape:
        case Disc() | Sphere():
            return within & (np.sum((positions - shape.center) ** 2, axis=1) <= (shape.radius + margin) ** 2)
        case Cylinder():
            across = [axis for axis in range(3) if "xyz"[axis] != shape.axis]
            square = np.sum((positions - shape.base)[:, across] ** 2, axis=1)
            return within & (square <= (shape.radius + margin) ** 2)
        case Polygon():
            corners = np.array(shape.vertices)
            edge = near_polygon(corners, positions, abs(margin))
            return within & ((inside_polygon(corners, positions) | edge) if margin > 0.0 else
                             inside_polygon(corners, positions) & ~edge)  # fmt: skip
        case Raster():
            layer = layer_of(shape)
            above = positions[:, 2] - layer.ground.at(positions)
            return within & (above >= -margin) & (above <= layer.thickness(positions) + margin)
        case Mesh():
            edge = _near_mesh(surface(shape), positions, abs(margin))
            held = inside(shape, positions)
            return within & ((held | edge) if margin > 0.0 else held & ~edge)
        case _:
            return within


def inside_polygon(corners: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Even-odd rule: a ray along x from an inner point crosses an odd number of edges."""
    x, y = positions[:, 0], positions[:, 1]
    result = np.zeros(len(positions), dtype=bool)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        # from below, so that an edge that is gone both ways, or by two polygons, is crossed at one place
        (ya, xa), (yb, xb) = sorted([(start[1], start[0]), (end[1], end[0])])
        if ya != yb:
            spans = (ya > y) != (yb > y)
            result ^= spans & (x < xa + (y - ya) * ((xb - xa) / (yb - ya)))
    return result


def near_polygon(corners: np.ndarray, positions: np.ndarray, distance: float) -> np.ndarray:
    """Which of `positions` (n, d) lie within `distance` m of an edge of a polygon."""
    near = np.zeros(len(positions), dtype=bool)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge, relative = end - start, positions[:, :2] - start
        if not edge.any():
            continue  # the polygon is closed by its first corner
        share = np.clip((relative * edge).sum(axis=1) / (edge**2).sum(), 0.0, 1.0)
        near |= ((relative - share[:, None] * edge) ** 2).sum(axis=1) <= distance**2
    return near


def _near_mesh(mesh: Surface, positions: np.ndarray, distance: float) -> np.ndarray:
    """Which of `positions` (n, 3) lie within `distance` m of a surface of triangles."""
    gap, normal = np.empty(len(positions)), np.empty((len(positions), 3))
    tree = mesh.tree
    mesh_gap(
        tree.corners, tree.triangles, tree.borders, tree.boxes, np.ascontiguousarray(positions), distance,
        distance, gap, normal,
    )  # fmt: skip
    return np.isfinite(gap)
