"""Where water enters and leaves: faces of points at the surface, under a pressure, a flux, or rain."""

from collections.abc import Callable

import numpy as np

from periporo.core.water.flow import CONTENT, ENTERED, LEFT, RAN_OFF, FlowingWater
from periporo.core.water.retention import conductivities

PRESSURE, HEAD, FLUX, RAIN = "pressure", "head", "flux", "rain"
SHAPE_PAIRS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}
_FACE = 0.5  # of the face of a cell: a smaller area on the side that is meant belongs to another side


class WaterBoundary:
    """A condition on the faces of the points `ids` (sorted) that are at the surface, of a `kind` with a `value`(time).

    - `pressure` Pa at the faces, or `head` m: that of water which would stand up to this level
    - `flux` m/s into the faces, along their normal
    - `rain` m/s on a horizontal area: it enters as long as the pressure at the face would not exceed 0, the rest runs
      off; where water comes out it does so freely (a seepage face). Below the level of free water that is what counts

    `side` (d,) is the normal of the faces that are meant; without it all faces are. A flow goes through half a cell.
    """

    def __init__(self, ids: np.ndarray, kind: str, value: Callable[[float], float], side: np.ndarray | None = None):
        self.ids = ids
        self.kind = kind
        self.value = value
        self.side = side
        self._found: tuple[np.ndarray | None, np.ndarray] = None, ids  # ids of the points, and the rows among them

    def rows(self, p) -> np.ndarray:
        """Owned rows of the points that have such a face now."""
        if self._found[0] is not p.id:
            self._found = p.id, np.flatnonzero(np.isin(p.id[: p.owned], self.ids, assume_unique=True))
        rows = self._found[1]
        present = p.volume[rows] * p.pore_dilation[rows]
        return rows[self._faces(p, rows)[0] > _FACE * present ** (1.0 - 1.0 / p.dimension)]

    def _faces(self, p, rows):
        """Area (n,) m^2, outward normal (n, d), and distance (n,) m of the faces of the points as large as they are."""
        d, ratio = p.dimension, p.pore_dilation[rows]
        vector, tensor = p.outer_face[rows, :d], p.outer_face[rows, d:]
        if self.side is None:
            area = np.sqrt((vector * vector).sum(axis=1))
            normal = vector / np.where(area > 0.0, area, 1.0)[:, None]
        else:
            area, normal = (vector * self.side).sum(axis=1), np.tile(self.side, (len(rows), 1))
        square = np.zeros(len(rows))
        for c, (a, b) in enumerate(SHAPE_PAIRS[d]):
            square += (1.0 if a == b else 2.0) * tensor[:, c] * normal[:, a] * normal[:, b]
        return ratio * area, normal, 0.5 * square / np.where(area > 0.0, area, 1.0)

    def conducted(self, p, rows, water: FlowingWater) -> np.ndarray:
        """What the faces conduct, (n,) m^3/(Pa s)."""
        area, normal, distance = self._faces(p, rows)
        mobility = p.flow_state[rows, 2] / p.pore_dilation[rows] * (normal**2 * water.permeability.factors).sum(axis=1)
        return 0.0 * area if self.kind == FLUX else area / distance * mobility

    def add(self, p, rows, time: float, water: FlowingWater, flow: np.ndarray) -> None:
        """Add what enters, leaves and runs off per second to the columns of `flow` (total, 4), m^3/s."""
        value = self.value(time)
        area, normal, distance = self._faces(p, rows)
        if self.kind == FLUX:
            entering = value * area
        else:
            way = normal * distance[:, None]
            pressure = self._pressure(p.position[rows] + way, value, time, water)
            entering = self._entering(p, rows, way, pressure, water)
        if self.kind == RAIN:
            open_to_rain = pressure <= 0.0
            level_area = area * np.maximum((normal * -water.permeability.direction).sum(axis=1), 0.0)
            falling = value * level_area * open_to_rain
            entering = np.where(open_to_rain, np.minimum(entering, falling), entering)
            flow[rows, RAN_OFF] += falling - np.clip(entering, 0.0, falling)
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

    def _entering(self, p, rows, way, pressure, water):
        """Flow (n,) m^3/s from faces under `pressure` into their points, half a cell away."""
        weight = water.pores.density * water.permeability.gravity
        driven = pressure - p.pore_pressure[rows] - (way * weight).sum(axis=1)
        outside = conductivities(water.curves, p.material[rows], -pressure, p.porosity[rows], p.pore_dilation[rows])
        return self.conducted(p, rows, water) * driven * np.where(driven > 0.0, outside, p.flow_state[rows, 1])
