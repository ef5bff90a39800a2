"""Rasters of a result: depth of the soil, its largest depth and speed, and when it arrived, in the grid of a ground.

A point stands for a column of one spacing squared, which hands its volume to the cells that it covers: the sum over the
cells is the volume of the soil, whatever the cells.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from periporo.errors import OutputError
from periporo.io.geometry.rasters import GroundFileError, Raster, read_raster
from periporo.io.output.results import ResultError, Results, open_results
from periporo.io.schema.ground import RASTERS, RasterFile

NO_VALUE = -9999.0
NAMES = {
    "depth": ("m", "depth of the soil at the last output"),
    "largest_depth": ("m", "largest depth over all outputs"),
    "largest_speed": ("m/s", "largest speed over all outputs"),
    "arrival": ("s", "first output at which the depth exceeds the threshold"),
}
"""What is written: units and meanings."""


@dataclass(frozen=True)
class Grid:
    """`shape` (ny, nx) cells, rows from the south, of the sides `cell` (2,) m; `corner` (2,) m of the lowest one."""

    corner: np.ndarray
    cell: np.ndarray
    shape: tuple[int, int]

    @classmethod
    def of_raster(cls, raster: Raster) -> "Grid":
        """Cells around the values of a raster."""
        return cls(raster.corner - 0.5 * raster.cell, raster.cell, raster.level.shape)

    @classmethod
    def around(cls, results: Results, side: float) -> "Grid":
        """Square cells over all places that points have been at, from whole multiples of their side on."""
        places = [results.positions(k)[:, :2] for k in range(len(results))]
        ends = [x for x in places if len(x)]
        if not ends:
            raise ResultError(f"{results.path} has no points at any output, so there is nothing to spread over cells")
        lower = np.floor(np.min([x.min(axis=0) for x in ends], axis=0) / side) - 1.0
        upper = np.ceil(np.max([x.max(axis=0) for x in ends], axis=0) / side) + 1.0
        nx, ny = (upper - lower).astype(int)
        return cls(lower * side, np.array([side, side]), (int(ny), int(nx)))

    def spread(self, place: np.ndarray, amount: np.ndarray, side: float) -> np.ndarray:
        """What each cell gets of amounts (n,) that lie evenly in squares of a `side` m about places (n, 2)."""
        total = np.zeros(self.shape)
        first, shares = zip(*(self._overlaps(place, side, a) for a in (0, 1)), strict=True)
        for i in range(shares[0].shape[1]):
            for j in range(shares[1].shape[1]):
                column, row = first[0] + i, first[1] + j
                inside = (column >= 0) & (column < self.shape[1]) & (row >= 0) & (row < self.shape[0])
                part = amount * shares[0][:, i] * shares[1][:, j]
                np.add.at(total, (row[inside], column[inside]), part[inside])
        return total

    def _overlaps(self, place, side, axis):
        """First cell (n,) along an axis that a square reaches into, and its share (n, k) in it and those behind it."""
        low = (place[:, axis] - 0.5 * side - self.corner[axis]) / self.cell[axis]
        width = side / self.cell[axis]
        first = np.floor(low).astype(np.int64)
        edges = first[:, None] + np.arange(int(np.ceil(width)) + 2)
        covered = np.clip(edges, low[:, None], low[:, None] + width)
        return first, np.diff(covered, axis=1) / width


def rasters_of(results: Results, grid: Grid, threshold: float | None = None) -> dict[str, np.ndarray]:
    """The rasters `NAMES` (ny, nx), rows from the south; NaN in cells that the soil has not come to.

    It has come to a cell when its depth there exceeds `threshold` m, by default a tenth of a spacing. Raises
    ResultError for a result in two dimensions.
    """
    if results.dimension != 3:
        raise ResultError(f"{results.path} is a result in 2 dimensions: there is nothing to see from above")
    spacing = float(results.configuration["spacing"])
    limit = 0.1 * spacing if threshold is None else threshold
    made = {name: np.full(grid.shape, np.nan) for name in NAMES}
    for k, time in enumerate(results.times):
        depth, speed = _seen(results, k, grid, spacing)
        there = depth > limit
        made["depth"] = np.where(there, depth, np.nan)
        made["largest_depth"] = np.fmax(made["largest_depth"], made["depth"])
        made["largest_speed"] = np.fmax(made["largest_speed"], np.where(there, speed, np.nan))
        made["arrival"] = np.where(there & np.isnan(made["arrival"]), time, made["arrival"])
    return made


def _seen(results, k, grid, spacing):
    """Depth and largest speed (ny, nx) at an output."""
    place = results.positions(k)[:, :2]
    volume = results.field("volume", k) if "volume" in results.fields else np.full(len(place), spacing**3)
    depth = grid.spread(place, volume, spacing) / grid.cell.prod()
    fastest = np.zeros(grid.shape)
    if "velocity" in results.fields:
        speed = np.linalg.norm(results.field("velocity", k), axis=1)
        column, row = np.floor((place - grid.corner) / grid.cell).astype(np.int64).T
        inside = (column >= 0) & (column < grid.shape[1]) & (row >= 0) & (row < grid.shape[0])
        np.maximum.at(fastest, (row[inside], column[inside]), speed[inside])
    return depth, fastest


def write_raster(path: Path, grid: Grid, values: np.ndarray, crs=None) -> None:
    """Write values (ny, nx) as an ESRI ASCII grid or, by the name's ending, a GeoTIFF; `crs` goes into the latter."""
    filled = np.where(np.isnan(values), NO_VALUE, values)[::-1]
    if path.suffix.lower() == ".asc":
        (x, y), (dx, dy), (ny, nx) = grid.corner.tolist(), grid.cell.tolist(), grid.shape
        side = f"cellsize {dx!r}" if dx == dy else f"dx {dx!r}\ndy {dy!r}"
        head = f"ncols {nx}\nnrows {ny}\nxllcorner {x!r}\nyllcorner {y!r}\n{side}\nNODATA_value {NO_VALUE:g}"
        np.savetxt(path, filled, fmt="%.7g", header=head, comments="")
        return
    try:
        import rasterio
    except ImportError:
        raise OutputError("GeoTIFF needs rasterio (pip install 'periporo[terrain]'); or leave out --tif") from None
    north = grid.corner[1] + grid.shape[0] * grid.cell[1]
    place = rasterio.transform.from_origin(grid.corner[0], north, *grid.cell)
    with rasterio.open(
        path, "w", driver="GTiff", height=grid.shape[0], width=grid.shape[1], count=1, dtype="float64", crs=crs,
        transform=place, nodata=NO_VALUE,
    ) as file:  # fmt: skip
        file.write(filled, 1)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `periporo raster`."""
    parser.add_argument("file", type=Path, help="result file")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--like", metavar="FILE", help=f"raster whose grid is taken ({', '.join(RASTERS)})")
    where.add_argument("--cell", type=float, metavar="M", help="side of square cells (default: the spacing)")
    parser.add_argument("--threshold", type=float, metavar="M", help="depth from which on soil is there (.1 spacings)")
    parser.add_argument("--tif", action="store_true", help="write GeoTIFF in place of ESRI ASCII grids")
    parser.add_argument("-o", "--output", type=Path, default=Path(), metavar="FOLDER", help="where to write")


def run(arguments: argparse.Namespace) -> int:
    """Run `periporo raster`; the exit status."""
    with open_results(arguments.file) as results:
        grid = _grid(arguments, results)
        made = rasters_of(results, grid, arguments.threshold)
    arguments.output.mkdir(parents=True, exist_ok=True)
    for path, name in _paths(arguments):
        write_raster(path, grid, made[name], _crs(arguments.like))
        known = made[name][~np.isnan(made[name])]
        span = f"{known.min():.4g} to {known.max():.4g} {NAMES[name][0]}" if len(known) else "nothing"
        print(f"{path}: {NAMES[name][1]}, {span}")
    return 0


def _grid(arguments, results) -> Grid:
    if arguments.like is None:
        side = float(results.configuration["spacing"]) if arguments.cell is None else arguments.cell
        if not side > 0.0:
            raise OutputError(f"--cell must be greater than 0, not {side:g}")
        return Grid.around(results, side)
    try:
        return Grid.of_raster(read_raster(RasterFile(file=arguments.like)))
    except (GroundFileError, ValueError) as error:
        raise OutputError(f"{arguments.like}: {error}") from None


def _paths(arguments) -> Iterator[tuple[Path, str]]:
    for name in NAMES:
        yield arguments.output / f"{arguments.file.stem}_{name}{'.tif' if arguments.tif else '.asc'}", name


def _crs(like: str | None):
    """The reference of coordinates of a GeoTIFF; None of other files."""
    if like is None or Path(like).suffix.lower() not in (".tif", ".tiff"):
        return None
    import rasterio

    with rasterio.open(like) as file:
        return file.crs
