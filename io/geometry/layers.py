"""Soil between a ground and a surface that are rasters: where it is, and columns of points that stand on the ground."""

from functools import cached_property, lru_cache

import numpy as np

from periporo.core.numerics.heights import height_gap
from periporo.io.geometry.rasters import Raster, read_raster
from periporo.io.schema.bodies import Raster as RasterShape

_TRIES = 100


class Layer:
    """What a shape of type `raster` holds: `ground` heights m, and `thickness` m above them where soil is."""

    def __init__(self, shape: RasterShape, ground: Raster, top: Raster):
        self.ground, self.top = ground, top
        self.top_is_height = shape.surface is not None
        self.conform = shape.conform

    def thickness(self, place: np.ndarray) -> np.ndarray:
        """Height (n,) m of the soil above the ground at places (n, 2|3); 0 where there is no value."""
        inside = ((place[:, :2] >= self.top.corner) & (place[:, :2] <= self.top.far_corner)).all(axis=1)
        above = np.where(inside, self.top.at(place), np.nan)
        if self.top_is_height:
            above = above - self.ground.at(place)
        return np.where(np.isnan(above), 0.0, above)

    def foot(self, place: np.ndarray, spacing: float) -> np.ndarray:
        """Height (n,) m at places (n, 2|3) at which a cell of one spacing stands on the ground.

        Its middle is half a spacing from the ground, wherever that is nearest. NaN where there is no ground.
        """
        half = 0.5 * spacing
        position = np.column_stack([place[:, :2], self.ground.at(place) + half])
        gap, normal = np.empty(len(place)), np.empty((len(place), 3))
        raster = self.ground
        holes = bool(np.isnan(raster.level).any())
        for _ in range(_TRIES):
            height_gap(raster.level, raster.corner, raster.cell, holes, position, half, 2.0 * spacing, gap, normal)
            lift = np.where(np.isfinite(gap), half - gap, 0.0)
            if not np.abs(lift).max(initial=0.0) > 1e-9 * spacing:
                break
            position[:, 2] += lift / np.maximum(normal[:, 2], 0.1)
        return position[:, 2]

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner (3,) m of the box around the soil; infinite, the wrong way round, if there is none."""
        places = self.places()
        thickness, base = self.thickness(places), self.ground.at(places)
        soil = (thickness > 0.0) & ~np.isnan(base)
        if not soil.any():
            return np.full(3, np.inf), np.full(3, -np.inf)
        lower = np.maximum(places[soil].min(axis=0) - self.top.cell, self.top.corner)
        upper = np.minimum(places[soil].max(axis=0) + self.top.cell, self.top.far_corner)
        return np.append(lower, base[soil].min()), np.append(upper, (base + thickness)[soil].max())

    @cached_property
    def thickest(self) -> float:
        """Largest thickness, m."""
        return float(self.thickness(self.places()).max(initial=0.0))

    def places(self) -> np.ndarray:
        """Places (n, 2) m of the values of the upper raster."""
        ny, nx = self.top.level.shape
        x = self.top.corner[0] + np.arange(nx) * self.top.cell[0]
        y = self.top.corner[1] + np.arange(ny) * self.top.cell[1]
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def layer_of(shape: RasterShape) -> Layer:
    """The layer of a shape, made once. Raises GroundFileError."""
    top = shape.thickness or shape.surface
    assert top is not None  # one of both is given
    return _layer(shape, read_raster(shape.ground), read_raster(top))


@lru_cache(maxsize=8)
def _layer(shape: RasterShape, ground: Raster, top: Raster) -> Layer:
    return Layer(shape, ground, top)
