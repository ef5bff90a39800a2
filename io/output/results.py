"""Reading of result files: NumPy arrays by field and time."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import h5py
import numpy as np
import yaml

from periporo.core.numerics.cells import Cells
from periporo.core.numerics.gravity import vertical_axis
from periporo.io.output.parts import Parts, damage
from periporo.io.output.profiles import along_line
from periporo.io.output.surface_loads import SurfaceLoad, along_axis, along_outline
from periporo.io.output.vtkhdf_layout import COUNTS, INDEX, Column, Index, folder_of, stored_columns
from periporo.io.output.water_table import water_table

if TYPE_CHECKING:
    import xarray


_WATER_DENSITY = 1000.0  # kg/m^3


class ResultError(Exception):
    """A result file cannot be read, or does not hold what is asked for."""


def open_results(path: str | Path) -> "Results":
    """Open a result file for reading, also while its run goes on; use it in a `with` statement.

    Returns a `Results`. Raises `ResultError` if the file is missing, damaged or not one of ours.
    """
    return Results(path)


class Results:
    """A result file open for reading, as it was when opened.

    Outputs are counted from 0, or from the last with -1. Arrays are in global-id order. Vectors have 3
    columns, symmetric tensors 6 (xx, yy, zz, xy, yz, xz), matrices 9, also in plane strain. All methods raise
    `ResultError` for a name, an output or a time that the file does not have.

    - `times` (outputs,) s, `steps` (outputs,), `point_counts` (outputs,); their number is `len(results)`
    - `fields` and `history_names`: what `field` and `history` may be asked for
    - `configuration`: the scene with all defaults; `attributes`: versions, ranks, run-out and so on
    - `dimension`: 2 or 3
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self._file, self._handle = _open(self.path)
        self._parts: Parts | None = None
        try:
            steps = self._file["VTKHDF/Steps"]
            count = int(steps.attrs["NSteps"])
            self.times: np.ndarray = steps["Values"][:count]  # s
            self.steps: np.ndarray = steps["StepNumbers"][:count]
            parts = steps["PartOffsets"][:count]  # the first is of points, a second one of obstacles
            self.point_counts = self._file["VTKHDF/NumberOfPoints"][: parts.max(initial=-1) + 1][parts]
            self._starts = steps["PointOffsets"][:count]
            self.attributes: dict[str, Any] = dict(self._file["Run"].attrs)
            self.dimension = int(self.attributes.pop("dimension"))
            self._parts, self._columns = self._rows_and_columns()
            origin = self.attributes.get("origin", np.zeros(3))
            self.origin = np.pad(origin, (0, 3 - len(origin)))  # that places in the file are counted from, m
        except ResultError:
            self.close()
            raise
        except (KeyError, OSError, RuntimeError) as error:
            self.close()
            raise ResultError(f"{self.path} is damaged or not a result file of periporo: {error}") from None

    def _rows_and_columns(self) -> tuple[Parts | None, dict[str, Column]]:
        """The parts that hold the rows of points, None if this file does; and what columns there are."""
        rows = Index(self._file).part_rows
        if rows is None:
            return None, stored_columns(self._file["VTKHDF"])
        index = folder_of(self.path) / INDEX
        if not index.is_file():
            raise ResultError(f"{self.path} is in parts, and {index} is missing")
        try:
            with index.open("rb") as handle, h5py.File(handle, "r") as file:
                columns = stored_columns(file)
        except (KeyError, OSError, RuntimeError):
            raise ResultError(f"{self.path} is in parts, and {index} is damaged") from None
        problem = damage(self.path, rows, columns)
        if problem is not None:
            raise ResultError(f"{self.path}: {problem}")
        return Parts(self.path, rows), columns

    def __enter__(self) -> "Results":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __len__(self) -> int:
        """Number of outputs."""
        return len(self.times)

    def close(self) -> None:
        """Close the file."""
        if self._parts is not None:
            self._parts.close()
        self._file.close()
        self._handle.close()

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the fields of points."""
        names = (name.removeprefix("PointData/") for name in self._columns if name != "Points")
        return tuple(name for name in names if name != "id")

    @property
    def history_names(self) -> tuple[str, ...]:
        """Names of the global figures."""
        return tuple(self._file["History"])

    @property
    def configuration(self) -> dict[str, Any]:
        """The configuration of the run as a dictionary; empty if the file holds none."""
        return yaml.safe_load(self.attributes.get("configuration", "")) or {}

    def field(self, name: str, step: int = -1, *, time: float | None = None) -> np.ndarray:
        """Field `name`, (n,), (n, 3) or (n, 6), at output `step`, or at the output nearest to `time` (s)."""
        if name not in self.fields:
            raise ResultError(f"{self.path} holds no field {name!r}; there are: {', '.join(self.fields)}")
        return self._rows(f"PointData/{name}", self.output(step, time))

    def positions(self, step: int = -1, *, time: float | None = None) -> np.ndarray:
        """Positions (n, 3) m, in the coordinates of the scene."""
        return self._rows("Points", self.output(step, time)) + self.origin

    def profile(
        self, name: str, start: Sequence[float], end: Sequence[float], step: int = -1, *, time: float | None = None,
        count: int = 101,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Field `name` along the line from `start` to `end`, in as many coordinates as the scene has, m.

        Distances (count,) m from the start, and values (count, ...), NaN where there is no soil.
        """
        ends = np.array([start, end], float)
        if ends.shape != (2, self.dimension):
            raise ResultError(f"a line begins and ends at {self.dimension} coordinates each, not {ends.shape[1]}")
        first, last = np.pad(ends, ((0, 0), (0, 3 - self.dimension)))
        places, values = self.positions(step, time=time), self.field(name, step, time=time)
        spacing = float(self.configuration["spacing"])
        return along_line(places, values, first, last, spacing, count, self.dimension)

    def obstacles(self, step: int = -1, *, time: float | None = None) -> list[tuple[int, int, np.ndarray]]:
        """Obstacles as they are drawn: number among the contacts, VTK's kind of cell, and corners (k, 3) m of each."""
        cells = self.cells(step, time=time)
        return [] if cells is None else cells.split()

    def cells(self, step: int = -1, *, time: float | None = None) -> Cells | None:
        """The same as cells that share their points; None where the scene has no obstacles."""
        k = self.output(step, time)
        file, steps = self._file["VTKHDF"], self._file["VTKHDF/Steps"]
        if steps["NumberOfParts"][k] == 1:
            return None
        part = int(steps["PartOffsets"][k]) + 1
        points, count, ids = (int(file[name][part]) for name in COUNTS)
        first = int(self.point_counts[k])
        cell = int(steps["CellOffsets"][k]) + first
        connection = int(steps["ConnectivityIdOffsets"][k]) + first
        return Cells(
            self._rows("Points", k, first, first + points) + self.origin,
            -1 - self._rows("PointData/id", k, first, first + points),
            file["Connectivity"][connection : connection + ids],
            file["Offsets"][cell + part : cell + part + count + 1],
            file["Types"][cell : cell + count],
        )

    def surface(
        self, name: str, step: int = -1, *, time: float | None = None, axis: str | None = None
    ) -> SurfaceLoad:
        """What the obstacle `name` bears along its outline (2D, Pa), or along an axis (N/m; in 3D the vertical one).

        The file must hold the field `force_on_<name>`.
        """
        field, scene = f"force_on_{name}", self.configuration
        if field not in self.fields:
            raise ResultError(f"{self.path} holds no field {field!r}: add it to output.fields of the scene, where an "
                              f"obstacle has the name {name!r}, and run it again")
        number = _number_of(scene["contacts"], name)
        drawn = [(kind, corners) for k, kind, corners in self.obstacles(step, time=time) if k == number]
        if not drawn:
            raise ResultError(f"{self.path}: the obstacle {name!r} is not there at this time")
        forces, places = self.field(field, step, time=time), self.positions(step, time=time)
        touching = forces.any(axis=1)
        rows, spacing = (places[touching], forces[touching]), float(scene["spacing"])
        if axis is None and self.dimension == 2:
            return along_outline(drawn[0], *rows, spacing, bool(scene.get("axisymmetric")))
        along = vertical_axis(scene.get("gravity"), self.dimension) if axis is None else "xyz".index(axis)
        return along_axis(np.concatenate([corners for _, corners in drawn]), along, *rows, spacing)

    def water_table(self, step: int = -1, *, time: float | None = None) -> np.ndarray:
        """The water table: places (m, 3) m where the pressure in the pores falls to zero, one for each column of soil.

        Columns are a spacing wide and upright; those without water under pressure have none. Needs `pore_pressure`.
        """
        axis = vertical_axis(self.configuration.get("gravity"), self.dimension)
        scene = self.configuration
        gravity = scene.get("gravity") or [0.0] * self.dimension
        density = (scene.get("pore_water") or {}).get("water_density", _WATER_DENSITY)
        weight = density * float(np.linalg.norm(gravity)) or np.inf
        pressure, place = self.field("pore_pressure", step, time=time), self.positions(step, time=time)
        return water_table(place, pressure, scene["spacing"], axis, -1.0 if gravity[axis] > 0.0 else 1.0, weight)

    def ids(self, step: int = -1, *, time: float | None = None) -> np.ndarray:
        """Global ids (n,), ascending."""
        return self._rows("PointData/id", self.output(step, time))

    def unit(self, name: str) -> str:
        """Unit of a field or of a global figure; '' for numbers without one."""
        if f"PointData/{name}" in self._columns:
            return self._columns[f"PointData/{name}"].unit
        if name in self._file["History"]:
            return str(self._file["History"][name].attrs.get("unit", ""))
        raise ResultError(f"{self.path} holds neither a field nor a history {name!r}")

    def components(self, name: str) -> tuple[str, ...]:
        """Names of the components of a field, () for one of a single column."""
        self.unit(name)
        return self._columns[f"PointData/{name}"].components

    def history(self, name: str) -> np.ndarray:
        """Global figure `name` (m,) over all recorded steps; 'step' and 'time' are among the names."""
        history = self._file["History"]
        if name not in history:
            raise ResultError(f"{self.path} holds no history {name!r}; there are: {', '.join(history)}")
        return history[name][: min(len(dataset) for dataset in history.values())]

    def output(self, step: int = -1, time: float | None = None) -> int:
        """Index from 0 of output `step`, or of the output nearest to `time` (s)."""
        if not len(self):
            raise ResultError(f"{self.path} holds no output yet")
        if time is not None:
            if not self.times[0] <= time <= self.times[-1]:
                raise ResultError(f"{self.path}: time {time} s is outside {self.times[0]} ... "
                                  f"{self.times[-1]} s")
            return int(np.argmin(np.abs(self.times - time)))
        if not -len(self) <= step < len(self):
            raise ResultError(f"{self.path}: output {step} of {len(self)}; allowed are {-len(self)} ... "
                              f"{len(self) - 1}")
        return int(step) % len(self)

    def to_xarray(self) -> "xarray.Dataset":
        """All fields as an xarray Dataset over time, id and component; NaN where a point does not exist.

        Reads the whole file into memory. Raises ImportError if xarray is not installed.
        """
        try:
            import xarray
        except ImportError:
            raise ImportError("to_xarray needs the package xarray: pip install xarray") from None
        outputs = range(len(self))
        ids = np.unique(np.concatenate([self.ids(k) for k in outputs] or [np.empty(0)]))
        dataset = xarray.Dataset(coords={"time": self.times, "id": ids, "step": ("time", self.steps)})
        for name in ("Points", *(f"PointData/{field}" for field in self.fields)):
            column = self._columns[name]
            values = np.full((len(self), len(ids), *column.tail), np.nan)
            for k in outputs:
                rows = self.positions(k) if name == "Points" else self._rows(name, k)
                values[k, np.searchsorted(ids, self.ids(k))] = rows
            axes = () if not column.tail else ("axis",) if column.tail == (3,) else ("component",)
            short = name.removeprefix("PointData/").replace("Points", "position")
            dataset[short] = (("time", "id", *axes), values, {"units": column.unit})
            dataset = dataset.assign_coords({axis: list(column.components) for axis in axes})
        return dataset

    def _rows(self, name: str, k: int, begin: int = 0, end: int | None = None) -> np.ndarray:
        """Rows of output k, by default those of all points."""
        end = int(self.point_counts[k]) if end is None else end
        start = self._starts[k]
        try:
            if self._parts is not None:
                return self._parts.read(name, k, begin, end)
            return self._file[f"VTKHDF/{name}"][start + begin : start + end]
        except (OSError, RuntimeError) as error:
            raise ResultError(f"{self.path} is damaged at {name}, output {k}: {error}") from None


def _number_of(contacts: list[dict[str, Any]], name: str) -> int:
    """Number of the obstacle among the contacts; those that move without a name are called obstacle_0 and so on."""
    named = [k for k, contact in enumerate(contacts) if contact.get("name") == name]
    return named[0] if named else int(name.removeprefix("obstacle_"))


def _open(path: Path) -> tuple[h5py.File, BinaryIO]:
    if not path.is_file():
        raise ResultError(f"{path} does not exist" if not path.exists() else f"{path} is not a file")
    # Through Python's file: HDF5 would lock its own where the environment says so (HDF5_USE_FILE_LOCKING), though the
    # run is still writing, and give a second reader in this process what the first one has seen.
    handle = path.open("rb")
    try:
        file = h5py.File(handle, "r")
    except (OSError, RuntimeError) as error:
        handle.close()
        reason = "it is truncated or damaged" if h5py.is_hdf5(path) else "it is not an HDF5 file"
        raise ResultError(f"cannot read {path}: {reason} ({error})") from None
    if "VTKHDF/Steps/StepNumbers" not in file or "Run" not in file:
        file.close()
        handle.close()
        raise ResultError(f"{path} is an HDF5 file, but not a result file of periporo")
    return file, handle
