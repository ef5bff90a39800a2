"""Values of fields at places: each place has its own, whatever others are asked for in the same call."""

import csv
import math
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np

from periporo.io.geometry.points import counted_from
from periporo.io.geometry.rasters import read_raster
from periporo.io.schema.fields import DepthField, LevelField, ParameterField, PointsField, RandomField, RasterField

_CHUNK = 4_000_000  # distances at once
_FLAT = 1e-6  # of the largest extent: places that differ less in a direction tell no slope along it
_MODES = 1000  # waves of which a random field is the sum


class FieldError(ValueError):
    """A field cannot be evaluated; the message says why."""


Heights = Callable[[np.ndarray], np.ndarray]


def field_values(field: ParameterField, position: np.ndarray, depth: Heights, level: Heights) -> np.ndarray:
    """Values (n,) of a field at positions (n, d) m, of which `depth` and `level` give (n,) m.

    Raises FieldError where there is none.
    """
    match field:
        case DepthField():
            return np.interp(depth(position), field.at, field.values)
        case LevelField():
            return np.interp(level(position), field.at, field.values)
        case RasterField():
            return _of_raster(field, position)
        case PointsField():
            return _of_points(field, position)
        case RandomField():
            if isinstance(field.mean, float | int):
                return _random(field, position, np.full(len(position), float(field.mean)))
            return _random(field, position, field_values(field.mean, position, depth, level))


def typical_value(field: ParameterField) -> float:
    """A value of the field, for what asks a law before it has points. Raises FieldError."""
    match field:
        case DepthField() | LevelField():
            return float(field.values[len(field.values) // 2])
        case RasterField():
            return float(np.nanmedian(_raster(field).level))
        case PointsField():
            return float(np.median(column_of(field.file, field.column)[1]))
        case RandomField():
            return float(field.mean) if isinstance(field.mean, float | int) else typical_value(field.mean)


def typical_place(field: ParameterField) -> str:
    """Where the field has its typical value, for a message; empty if that is nowhere in particular."""
    match field:
        case DepthField() | LevelField():
            what = "depth" if isinstance(field, DepthField) else "level"
            return f" at the {what} {field.at[len(field.at) // 2]:g} m"
        case RandomField(mean=DepthField() | LevelField() as mean):
            return typical_place(mean)
    return ""


def _raster(field: RasterField):
    try:
        return read_raster(field)
    except ValueError as error:
        raise FieldError(f"{field.file}: {error}") from None


def _of_raster(field, position):
    raster = _raster(field)
    values = raster.at(position)
    none = np.isnan(values)
    edge = 0.5 * raster.cell
    outside = ((position[:, :2] < raster.corner - edge) | (position[:, :2] > raster.far_corner + edge)).any(axis=1)
    bad = np.flatnonzero(none | outside)
    if len(bad):
        place = ", ".join(f"{x:.6g}" for x in position[bad[0]])
        raise FieldError(f"{field.file}: it has no value at ({place}) m")
    return values


def column_of(name: str, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Places (m, d) and values (m,) of a column of a CSV file headed x,y[,z] and other names; read once.

    Raises FieldError.
    """
    return _points(name, column, Path(name).stat().st_mtime_ns)


@lru_cache(maxsize=8)
def _points(name: str, column: str, _modified: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (m, d) and values (m,) of a column."""
    with open(name, encoding="utf-8-sig", newline="") as file:
        header = [cell.strip() for cell in next(csv.reader([file.readline()]), [])]
        axes = [axis for axis in "xyz" if axis in header]
        if len(axes) < 2 or column not in header:
            raise FieldError(f"{name}: its first line must hold x, y and '{column}', not {', '.join(header)[:60]}")
        try:
            table = np.loadtxt(file, delimiter=",", ndmin=2)
        except ValueError as error:
            raise FieldError(f"{name}: below the header: {str(error).partition(';')[0]}") from None
    if table.shape[1] != len(header) or not np.isfinite(table).all():
        raise FieldError(f"{name}: every line must have {len(header)} finite numbers")
    return table[:, [header.index(axis) for axis in axes]], table[:, header.index(column)]


def _of_points(field, position):
    places, values = column_of(field.file, field.column)
    if places.shape[1] != position.shape[1]:
        raise FieldError(f"{field.file}: its points have {places.shape[1]} coordinates, the scene {position.shape[1]}")
    if field._origin:
        places = counted_from(places, field._origin)
    nearest = [np.argmin(square, axis=1) for square in _squares(position, places)]
    return values[np.concatenate([np.empty(0, np.int64), *nearest])]


def distances(position: np.ndarray, places: np.ndarray) -> np.ndarray:
    """How far positions (n, d) m are from the nearest of the `places` (m, d), (n,) m."""
    nearest = [np.sqrt(square.min(axis=1)) for square in _squares(position, places)]
    return np.concatenate([np.empty(0), *nearest])


def linear_around(places: np.ndarray, values: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Values (n,) at positions (n, d) m from those (m,) at `places` (m, d): that of the nearest place, and linear.

    The slope suits the 2 d places that are near besides, by least squares: exact for linear values, also at places
    themselves for any; there is none in directions in which these places do not differ.
    """
    d, found, done = position.shape[1], np.empty(len(position)), 0
    count = min(1 + 2 * d, len(places))
    for square in _squares(position, places):
        near = np.argpartition(square, count - 1, axis=1)[:, :count]
        near = np.take_along_axis(near, np.lexsort((near, np.take_along_axis(square, near, 1)), axis=1), 1)
        first, others = near[:, 0], near[:, 1:]
        arms, rises = places[others] - places[first][:, None], values[others] - values[first][:, None]
        slope = np.linalg.pinv(arms, rcond=_FLAT) @ rises[:, :, None]
        rows = slice(done, done + len(square))
        found[rows] = values[first] + ((position[rows] - places[first]) * slope[:, :, 0]).sum(axis=1)
        done += len(square)
    return found


def _squares(position, places):
    """Squares of the distances from a number of positions to all places, (k, m) m^2, piece by piece."""
    rows = max(1, _CHUNK // len(places))
    for k in range(0, len(position), rows):
        part = position[k : k + rows]
        yield sum((part[:, None, a] - places[None, :, a]) ** 2 for a in range(part.shape[1]))


def _random(field, position, means):
    """Numbers of mean 0 and deviation 1, made into the distribution."""
    d = position.shape[1]
    lengths = field.length if isinstance(field.length, tuple) else (field.length,) * d
    if len(lengths) != d:
        raise FieldError(f"length must have {d} components, one along each axis, not {len(lengths)}")
    absolute = position + np.array(field._origin) if field._origin else position
    z = _generator(field.correlation, tuple(map(float, lengths)), field.seed)(absolute)
    deviation = field.deviation if field.deviation is not None else field.variation * means
    if field.distribution == "normal":
        values = means + deviation * z
    else:
        variance = np.log1p((deviation / means) ** 2)
        values = means * np.exp(np.sqrt(variance) * z - 0.5 * variance)
    lowest = -math.inf if field.lowest is None else field.lowest
    return np.clip(values, lowest, math.inf if field.highest is None else field.highest)


@lru_cache(maxsize=16)
def _generator(correlation: str, lengths: tuple[float, ...], seed: int) -> Heights:
    try:
        import gstools
    except ImportError:
        raise FieldError("random fields need gstools (pip install 'periporo[fields]')") from None
    model = {"exponential": gstools.Exponential, "gaussian": gstools.Gaussian}[correlation]
    field = gstools.SRF(model(dim=len(lengths), var=1.0, len_scale=list(lengths)), seed=seed, mode_no=_MODES)

    def values(position):
        if not len(position):
            return np.empty(0)
        return np.array(field(list(np.ascontiguousarray(position.T)), mesh_type="unstructured"), dtype=float)

    return values
