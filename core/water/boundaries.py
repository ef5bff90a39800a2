"""Where water enters and leaves: faces of points at the surface, under a pressure, a flux, or rain."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from periporo.core.points.particles import symmetric
from periporo.core.water.flow import CONTENT, DISSIPATED, ENTERED, LEFT, RAN_OFF, FlowingWater
from periporo.core.water.retention import conductivities

PRESSURE, HEAD, FLUX, RAIN = "pressure", "head", "flux", "rain"
_TOUCHING = 0.75  # cells between a point and the obstacle that its face touches: half of one, and what it may stretch
_FACE = 0.5  # of the face of a cell: a smaller area on the side that is meant belongs to another side


class Obstacle(Protocol):
    """What soil touches."""

    def gap(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances (n,) m of positions (n, d) to its surface where it is now, and normals (n, d) out of it."""


class Faces(NamedTuple):
    """Owned `rows` (n,) of points with a face at the surface, and its `area` m^2, `normal` (n, d), `distance` m."""

    rows: np.ndarray
    area: np.ndarray
    normal: np.ndarray
    distance: np.ndarray


class WaterBoundary:
    """A condition on the faces of the points `ids` (sorted) that are at the surface, of a `kind` with a `value`(time).

    - `pressure` Pa at the faces, or `head` m: that of water which would stand up to this level
    - `flux` m/s into the faces, along their normal
    - `rain` m/s on a horizontal area: it enters as long as the pressure at the face would not exceed 0, the rest runs
      off; where water comes out it does so freely (a seepage face). Below the level of free water that is what counts

    `side` (d,) is the normal of the faces that are meant, or `obstacle` what they touch, wherever points and obstacle
    have come; without both all faces are. A flow goes through half a cell.
    """

    def __init__(
        self, ids: np.ndarray, kind: str, value: Callable[[float], float], side: np.ndarray | None = None,
        obstacle: Obstacle | None = None,
    ):  # fmt: skip
        self.ids = ids
        self.kind = kind
        self.value = value
        self.side = side
        self.obstacle = obstacle
        self._found: tuple[np.ndarray | None, np.ndarray] = None, ids  # ids of the points, and the rows among them

    def faces(self, p, outer: np.ndarray) -> Faces:
        """The faces of the owned points that have one now, given those of all (`FlowingWater.outer_faces`)."""
        if self._found[0] is not p.id:
            self._found = p.id, np.flatnonzero(np.isin(p.id[: p.owned], self.ids, assume_unique=True))
        d, rows, side = p.dimension, self._found[1], self.side
        if self.obstacle is not None:
            rows, side = self._touching(p, rows)
        vector = outer[rows, :d]
        if side is None:
            area = np.sqrt((vector * vector).sum(axis=1))
            normal = vector / np.where(area > 0.0, area, 1.0)[:, None]
        else:
            area, normal = (vector * side).sum(axis=1), np.broadcast_to(side, vector.shape)
        ratio = p.pore_dilation[rows]
        there = np.flatnonzero(ratio * area > _FACE * (p.volume[rows] * ratio) ** (1.0 - 1.0 / d))
        rows, area, normal, tensor = rows[there], area[there], normal[there], outer[rows[there], d:]
        square = np.zeros(len(rows))
        for c, (a, b) in enumerate(symmetric(d)):
            square += (1.0 if a == b else 2.0) * tensor[:, c] * normal[:, a] * normal[:, b]
        return Faces(rows, ratio[there] * area, normal, 0.5 * square / area)

    def _touching(self, p, rows):
        """Those of the `rows` that are at the obstacle, and the ways (n, d) into it."""
        assert self.obstacle is not None
        gap, normal = self.obstacle.gap(p.position[rows])
        near = gap < _TOUCHING * (p.volume[rows] * p.pore_dilation[rows]) ** (1.0 / p.dimension)
        return rows[near], -normal[near]

    def conducted(self, p, faces: Faces, water: FlowingWater) -> np.ndarray:
        """What the faces conduct, (n,) m^3/(Pa s)."""
        if self.kind == FLUX:
            return np.zeros(len(faces.rows))
        mobility = p.flow_state[faces.rows, 2] / p.pore_dilation[faces.rows]
        along = (faces.normal**2 * water.permeability.factors).sum(axis=1)
        return faces.area / faces.distance * mobility * along

    def add(self, p, faces: Faces, time: float, water: FlowingWater, flow: np.ndarray) -> None:
        """Add what enters, leaves and runs off per second to the columns of `flow` (total, 4), m^3/s."""
        value, rows, area = self.value(time), faces.rows, faces.area
        if self.kind == FLUX:
            entering = value * area
        else:
            way = faces.normal * faces.distance[:, None]
            pressure = self._pressure(p.position[rows] + way, value, time, water)
            entering, driven = self._entering(p, faces, way, pressure, water)
            could = entering
        if self.kind == RAIN:
            open_to_rain = pressure <= 0.0
            level_area = area * np.maximum((faces.normal * -water.permeability.direction).sum(axis=1), 0.0)
            falling = value * level_area * open_to_rain
            entering = np.where(open_to_rain, np.minimum(entering, falling), entering)
            flow[rows, RAN_OFF] += falling - np.clip(entering, 0.0, falling)
        if self.kind != FLUX:
            part = np.divide(entering, could, out=np.ones(len(rows)), where=could != 0.0)  # the rest did not enter
            flow[rows, DISSIPATED] += entering * driven * part
        flow[rows, CONTENT] += entering
        flow[rows, ENTERED] += np.maximum(entering, 0.0)
        flow[rows, LEFT] += np.maximum(-entering, 0.0)

    def _pressure(self, place, value, time, water):
        """Pressure (n,) Pa that holds at faces at a `place` (n, d), or could at most."""
        weight = water.pores.density * water.permeability.gravity
        if self.kind == PRESSURE:
            return np.full(len(place), value)
        if self.kind == HEAD:
            return float(np.sqrt((weight**2).sum())) * value + (place * weight).sum(axis=1)
        if water.free is None:
            return np.zeros(len(place))
        return np.maximum(water.free.weight * water.free.level(time) + (place * weight).sum(axis=1), 0.0)

    def _entering(self, p, faces, way, pressure, water):
        """Flow (n,) m^3/s from faces under `pressure` into their points, half a cell away, and what drives it, Pa."""
        weight, rows = water.pores.density * water.permeability.gravity, faces.rows
        driven = pressure - p.pore_pressure[rows] - (way * weight).sum(axis=1)
        porosity = water.porosity(p, rows)
        outside = conductivities(water.curves, p.material[rows], -pressure, porosity, p.pore_dilation[rows])
        relative = np.where(driven > 0.0, outside, p.flow_state[rows, 1])
        return self.conducted(p, faces, water) * driven * relative, driven
