"""Round sections as rings of points, that follow the outline which a lattice cuts in steps.

Rings are a spacing wide, or as nearly as the radius allows, and ring k has 3, 9, 15, ... 6 k + 3 points: each with the
same part of the section, a twentieth longer along the ring than across, so that the area is exact. A point stands at
the mean radius of its part. Rings are symmetric about the second axis, whose lower end lies between two points of each:
that is where a body touches the ground.
"""

import numpy as np

from periporo.io.geometry.points import PointTable
from periporo.io.schema.bodies import Cylinder, Disc


def number(shape: Disc | Cylinder, spacing: float) -> int:
    """How many points there are."""
    return 3 * _rings(shape.radius, spacing) ** 2 * _levels(shape, spacing)


def table_of(shape: Disc | Cylinder, spacing: float) -> PointTable:
    """The points of a disc, or of a cylinder that is made of sections one spacing (m) high, or nearly."""
    places, levels = section(shape.radius, spacing), _levels(shape, spacing)
    volumes = np.full(len(places) * levels, np.pi * shape.radius**2 / len(places))
    if isinstance(shape, Disc):
        return PointTable(np.array(shape.center) + places, volumes)
    along = "xyz".index(shape.axis)
    positions = np.empty((len(places), levels, 3))
    positions[:, :, [a for a in range(3) if a != along]] = places[:, None]
    positions[:, :, along] = (np.arange(levels) + 0.5) * shape.height / levels
    positions += shape.base
    return PointTable(positions.reshape(-1, 3), volumes * shape.height / levels)


def section(radius: float, spacing: float) -> np.ndarray:
    """Places (n, 2) m about the middle of points on rings."""
    count = _rings(radius, spacing)
    places = []
    for ring in range(count):
        angle = 2.0 * np.pi * (np.arange(6 * ring + 3) + 0.5) / (6 * ring + 3)
        middle = 2.0 / 3.0 * ((ring + 1) ** 3 - ring**3) / (2 * ring + 1) * radius / count
        places.append(middle * np.stack([np.sin(angle), -np.cos(angle)], axis=1))
    return np.concatenate(places)


def columns(shape: Disc | Cylinder, spacing: float, index: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Columns along an axis that the points `index` (n,) of the table are in, and the areas (n,) m^(d-1) of these.

    Columns are numbers (n, d), of which that along the axis says nothing. Across a section they are as wide as a ring.
    """
    width, levels = shape.radius / _rings(shape.radius, spacing), _levels(shape, spacing)
    places = section(shape.radius, spacing)
    cell = np.floor((places + shape.radius) / width).astype(np.int64)[index // levels]
    if isinstance(shape, Disc):
        return cell, np.full(len(index), width)
    along, area = "xyz".index(shape.axis), width * shape.height / levels
    if axis == along:
        cell[:, 0], cell[:, 1], area = index // levels, 0, np.pi * shape.radius**2 / len(places)
    return np.insert(cell, along, index % levels, axis=1), np.full(len(index), area)


def _rings(radius, spacing):
    return max(1, round(radius / spacing))


def _levels(shape, spacing):
    return max(1, round(shape.height / spacing)) if isinstance(shape, Cylinder) else 1
