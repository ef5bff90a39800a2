"""Rasters of heights, thickness or friction: ESRI ASCII grids, NumPy arrays, and what the package rasterio reads.

What a raster means differs among formats and programs: which row comes first, whether a value stands in the middle or
at a corner of its cell, what stands for no value. A file that tells is believed, one that does not must be explained.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from periporo.core.numerics.heights import height_at
from periporo.io.geometry.points import counted_from
from periporo.io.schema.errors import is_number
from periporo.io.schema.ground import RasterFile

MAX_VALUES = 500_000_000
_DEEPEST = -9999.0  # m, at and below which heights stand for none: -9999, -32768, -3.4e38
_STEEPEST = 50.0  # mean slope beyond which cells must be degrees
_GEOTIFF = (".tif", ".tiff")


class GroundFileError(ValueError):
    """A file of a ground cannot be used; the message says why, and where in it."""


@dataclass(frozen=True, eq=False)
class Raster:
    """`level` (ny, nx) rows from the lowest y on, NaN without value; `corner` (2,) m is the place of the first value,
    `cell` (2,) m the distance of neighbours. `north_first`: the file has its rows the other way round."""

    level: np.ndarray
    corner: np.ndarray
    cell: np.ndarray
    north_first: bool

    @property
    def far_corner(self) -> np.ndarray:
        """Place (2,) m of the last value."""
        return self.corner + (np.array(self.level.shape[::-1]) - 1) * self.cell

    def at(self, place: np.ndarray) -> np.ndarray:
        """Values (n,) at places (n, 2|3) m, linear on two triangles in each cell; NaN where there is none."""
        return height_at(self.level, self.corner, self.cell, place)

    def place(self, i: int, j: int) -> np.ndarray:
        """Place (2,) m of the value in column `i` and row `j` of `level`."""
        return self.corner + np.array([i, j]) * self.cell

    def row_and_column(self, place) -> str:
        """Where in the file the value next to a place (2|3,) m stands, for people."""
        i, j = np.rint((np.asarray(place)[:2] - self.corner) / self.cell).astype(int)
        row = self.level.shape[0] - j if self.north_first else j + 1
        return f"row {row}, column {i + 1}"

    def describe(self) -> str:
        """What the file was taken to mean, in a line."""
        ny, nx = self.level.shape
        none = int(np.isnan(self.level).sum())
        return (
            f"{nx} x {ny} values at distances of {self.cell[0]:g} x {self.cell[1]:g} m, the first at "
            f"({self.corner[0]:.9g}, {self.corner[1]:.9g}) m, {'northern' if self.north_first else 'southern'} row "
            f"first, {none:,} without value"
        )


_kept: dict[tuple, Raster] = {}


def read_raster(model: RasterFile) -> Raster:
    """The raster that an entry of a scene names, its places counted from the scene's origin; read once.

    Raises GroundFileError.
    """
    key = _key(model)
    if key not in _kept:
        raster = _read(model)
        if model._origin:
            x, y, z = model._origin
            level = raster.level
            if model.of_heights:
                level = counted_from(level.reshape(-1, 1), (z,)).reshape(level.shape)
            corner = np.array([counted_from(float(raster.corner[0]), x), counted_from(float(raster.corner[1]), y)])
            raster = replace(raster, level=level, corner=corner)
        keep_raster(model, raster)
    return _kept[key]


def keep_raster(model: RasterFile, raster: Raster) -> None:
    """Have `read_raster` give this one, for instance from memory that several processes share."""
    raster.level.setflags(write=False)
    _kept[_key(model)] = raster


def forget_rasters() -> None:
    """Free the memory of all that was read."""
    _kept.clear()


def _key(model: RasterFile) -> tuple:
    try:
        changed = Path(model.file).stat().st_mtime_ns
    except OSError:
        changed = 0  # whoever reads it will say why
    return (
        model.file, changed, model.corner, model.cell, model.first_row, model.registration, model.nodata,
        model.of_heights and model._origin, model._origin[:2],
    )  # fmt: skip


def _read(model: RasterFile) -> Raster:
    path = Path(model.file)
    try:
        match path.suffix.lower():
            case ".asc":
                raster = _from_ascii(path)
            case ".npy":
                raster = _from_numpy(model)
            case _:
                raster = _from_rasterio(path)
    except OSError as error:
        raise GroundFileError(f"the file cannot be read: {error.strerror or error}") from None
    if min(raster.level.shape) < 2:
        raise GroundFileError(f"it has {raster.level.shape[1]} x {raster.level.shape[0]} values; a surface needs 2 x 2")
    if np.isinf(raster.level).any():
        j, i = np.argwhere(np.isinf(raster.level))[0]
        at = raster.row_and_column(raster.corner + np.array([i, j]) * raster.cell)
        raise GroundFileError(f"the value at {at} is infinite")
    if np.isnan(raster.level).all():
        raise GroundFileError("it has no values, only what stands for none")
    if model.of_heights:
        _refuse_stand_ins(raster)
        _refuse_degrees(path, raster)
    return raster


def _refuse_stand_ins(raster: Raster) -> None:
    """Raise GroundFileError if a height must stand for none, though the file does not say so."""
    deepest = np.nanmin(raster.level)
    if deepest <= _DEEPEST:
        j, i = np.argwhere(raster.level == deepest)[0]
        at = raster.row_and_column(raster.place(i, j))
        raise GroundFileError(
            f"the height {deepest:g} at {at} is that of no ground; if it stands for none, say so: NODATA_value of a "
            "grid, nodata of an array, gdal_edit -a_nodata"
        )


_DEGREES = (
    "its cells are degrees, not metres: a degree of longitude is shorter than one of latitude (at 36.5 north .807 of "
    "it); project it first, for instance with gdalwarp -t_srs to the zone's UTM"
)


def _refuse_degrees(path: Path, raster: Raster) -> None:
    """Raise GroundFileError if the distances of the values must be degrees, by its slopes, or a file."""
    beside = path.with_suffix(".prj")
    if beside.is_file() and beside.read_text(errors="replace").lstrip().upper().startswith(("GEOGCS", "GEOGCRS")):
        raise GroundFileError(_DEGREES)
    around = [*raster.corner, *raster.far_corner]
    steps = [np.nanmean(np.abs(np.diff(raster.level, axis=a))) / raster.cell[1 - a] for a in (0, 1)]
    if max(map(abs, around)) <= 360.0 and min(steps) > _STEEPEST:
        raise GroundFileError(f"its mean slope would be {min(steps):.3g}: {_DEGREES}")


def _from_ascii(path: Path) -> Raster:
    """ESRI ASCII grid: a header of names and numbers, then rows from the north."""
    header: dict[str, float] = {}
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        while True:
            before = file.tell()
            words = file.readline().split()
            if len(words) != 2 or not words[0][0].isalpha():
                break
            try:
                header[words[0].lower()] = float(words[1])
            except ValueError:
                raise GroundFileError(f"its header says {words[0]} {words[1]!r}, which is not a number") from None
        if words and words[0][0].isalpha() and words[0].lower() != "nan":
            raise GroundFileError(f"its header says '{' '.join(words):.40}'; a name and one number are needed")
        file.seek(before)
        nx, ny = (_count(header, name) for name in ("ncols", "nrows"))
        values = file.read().split()
    try:
        level = np.array(values, float)
    except ValueError:
        wrong = next(k for k, value in enumerate(values) if not is_number(value))
        at = f"row {wrong // nx + 1}, column {wrong % nx + 1}"
        raise GroundFileError(f"the value at {at} is {values[wrong]!r:.40}, not a number") from None
    if len(level) != nx * ny:
        raise GroundFileError(f"its header promises {nx} x {ny} values, it has {len(level):,}")
    side = header.get("cellsize")
    cell = np.array([header.get("dx", side), header.get("dy", side)], dtype=float)
    if not np.all(cell > 0.0):
        raise GroundFileError("its header has no cellsize, nor dx and dy")
    corner = np.array([_corner(header, "x", cell[0]), _corner(header, "y", cell[1])])
    level = level.reshape(ny, nx)[::-1]
    return Raster(_without(level, header.get("nodata_value", -9999.0)), corner, cell, True)


def _count(header: dict[str, float], name: str) -> int:
    count = header.get(name, 0.0)
    if not (count >= 1.0 and count == int(count) and count <= MAX_VALUES):
        raise GroundFileError(f"its header has no valid {name}: it is no ESRI ASCII grid")
    return int(count)


def _corner(header: dict[str, float], axis: str, side: float) -> float:
    """Place of the first value: the header names it, or the corner of its cell."""
    if any(name.endswith("llcenter") for name in header) and any(name.endswith("llcorner") for name in header):
        raise GroundFileError("its header has llcorner and llcenter: which of them holds for both axes?")
    if f"{axis}llcenter" in header:
        return header[f"{axis}llcenter"]
    if f"{axis}llcorner" in header:
        return header[f"{axis}llcorner"] + 0.5 * side
    raise GroundFileError(f"its header has neither {axis}llcorner nor {axis}llcenter")


def _from_numpy(model: RasterFile) -> Raster:
    assert model.corner is not None and model.cell is not None  # what the schema demands
    try:
        level = np.load(model.file, allow_pickle=False)
    except ValueError as error:
        raise GroundFileError(f"it is no array of numbers: {error}") from None
    if level.ndim != 2 or not np.issubdtype(level.dtype, np.number) or np.iscomplexobj(level):
        raise GroundFileError(f"it is an array {level.shape} of {level.dtype}; rows and columns of numbers are needed")
    cell = np.array(model.cell)
    corner = np.array(model.corner) + (0.5 * cell if model.registration == "centre" else 0.0)
    north = model.first_row == "north"
    return Raster(_without(np.array(level[::-1] if north else level, float), model.nodata), corner, cell, north)


def _from_rasterio(path: Path) -> Raster:
    try:
        import rasterio
    except ImportError:
        raise GroundFileError("GeoTIFF needs rasterio (pip install 'periporo[terrain]'); or use .asc") from None
    try:
        with rasterio.open(path) as file:
            if file.count != 1:
                raise GroundFileError(f"it has {file.count} bands; take the right one with gdal_translate -b")
            level, at, crs = file.read(1, masked=True), file.transform, file.crs
    except rasterio.errors.RasterioError as error:
        raise GroundFileError(f"it cannot be read: {error}") from None
    if at.b or at.d or at.a <= 0.0 or at.e == 0.0:
        raise GroundFileError("its rows do not run along x from west to east; warp it with gdalwarp")
    if crs is not None and crs.is_geographic:
        raise GroundFileError(_DEGREES)
    if crs is not None and not math.isclose(crs.linear_units_factor[1], 1.0):
        raise GroundFileError(f"its unit of length is '{crs.linear_units}', not the metre; warp it with gdalwarp")
    level = np.ma.filled(level.astype(float), np.nan)
    north = at.e < 0.0
    first = at.f + (level.shape[0] - 0.5) * at.e if north else at.f + 0.5 * at.e  # middle of the southern row
    corner, cell = np.array([at.c + 0.5 * at.a, first]), np.array([at.a, abs(at.e)])
    return Raster(np.ascontiguousarray(level[::-1] if north else level), corner, cell, north)


def _without(level: np.ndarray, nodata: float | None) -> np.ndarray:
    """A copy of the values with NaN in place of what stands for none."""
    level = np.ascontiguousarray(level, float)
    if nodata is not None:
        level[level == nodata] = np.nan
    return level
