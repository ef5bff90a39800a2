"""One material point along a path or through a test: `periporo.drive`, and `periporo drive MATERIAL.yaml PATH`.

Rows of a path are divided into substeps. Strain is given, or found by Newton's method where stress is
given; deformation gradients are joined by stretch and rotation.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from periporo.core.points.material import Material
from periporo.core.water.bishop import bishop_of
from periporo.core.water.pore_water import bonding_variable
from periporo.core.water.retention import FULL, retention_of
from periporo.errors import InputError, Problem
from periporo.materials.laboratory.columns import Columns, engineering, observed
from periporo.materials.laboratory.files import as_material, read_measured
from periporo.materials.laboratory.follow import follower, phased
from periporo.materials.laboratory.paths import DeformationPath, StrainPath, find_path
from periporo.materials.laboratory.phases import PhasedTest, SpecimenWaterInput, read_test
from periporo.materials.laboratory.point import MaterialPoint, PointStopped
from periporo.materials.laboratory.water import SpecimenWater

_SUBSTEPS = 10
_YAML = (".yaml", ".yml")

Test = StrainPath | DeformationPath | PhasedTest


class DriveStopped(RuntimeError):
    """A point did not reach a row of its path; `columns` are the rows so far, as `drive` returns them."""

    def __init__(self, place: str, reason: str, columns: Columns):
        super().__init__(f"{place}: {reason}")
        self.columns = columns


def drive(
    material: Material | str | Path | dict[str, Any],
    path: Test | str | Path | dict[str, Any],
    substeps: int | None = None,
    initial_stress: np.ndarray | None = None,
    *,
    volume: float = 1.0,
    number: int = 0,
    pictures: str | Path | None = None,
    measured: Iterable[str | Path] = (),
) -> Columns:
    """Columns (m,) by name for the rows of a test of one material point, in SI units.

    `material` is a law, its YAML file or its mapping; `path` a test in phases (a YAML file or mapping), a CSV file of
    strains, stresses or deformation gradients, a built-in test such as `triaxial:confining=1e5`, or what `read_path`,
    `built_in_path` and `read_test` make of these. Columns: `time_s`; strain, effective stress and state, tension
    positive; `pore_pressure` and `saturation` of a wet specimen; and what engineers read, compression positive
    (`periporo.materials.laboratory.columns.STOPPABLE`). A test in phases has `phase`, counted from 0, too.

    Each row is reached in `substeps` steps (10, or what the test says). The initial stress (6,) Pa is that of the
    argument, else the path's own, else zero. `volume` (m^3) of the specimen and `number`, its id, are for laws whose
    strength scatters. Nothing is drawn unless a folder is given for `pictures`; over them go the curves of the CSV
    files `measured`, whose columns have the names above.

    Raises `InputError` if path and start do not suit, `DriveStopped`, with the rows so far, if the law fails or
    refuses a strain, gives a number that is not finite, or does not reach a prescribed stress.

    >>> import periporo
    >>> soil = {"model": "elastic", "density": 1800, "bulk_modulus": 25e6, "shear_modulus": 15e6}
    >>> columns = periporo.drive(soil, "oedometer:strain=0.01,confining=0,rows=10")
    >>> print(f"{columns['axial_stress'][-1]:.6g} Pa")  # (K + 4/3 G) times the strain
    450000 Pa
    >>> shear = [{"type": "isotropic", "stress": 1e5}, {"type": "triaxial", "strain": 0.01, "drainage": "undrained"}]
    >>> columns = periporo.drive(soil, {"porosity": 0.4, "phases": shear})
    >>> print(f"q = {columns['q'][-1]:.4g} Pa, u = {columns['pore_pressure'][-1]:.4g} Pa")  # 3 G times the strain
    q = 4.496e+05 Pa, u = 1.492e+05 Pa
    """
    law, test = as_material(material), as_test(path)
    if substeps is not None and substeps < 1:
        raise InputError("substeps", [Problem((), f"must be at least 1, not {substeps}")])
    if not 0 < volume < np.inf:
        raise InputError("volume", [Problem((), f"must be positive, in m^3, not {volume:g}")])
    if number < 0:
        raise InputError("id", [Problem((), f"must be at least 0, not {number}")])
    curves = [read_measured(file) for file in measured]
    law, water, porosity = _prepared(law, test)
    point = _specimen(law, test, initial_stress, volume, number, water)
    record = _Record(point, porosity)
    try:
        for row in _rows(point, test, substeps, record):
            record.add(*row)
    except PointStopped as stop:
        stopped = DriveStopped(record.place, str(stop), record.columns())
        if pictures is not None:
            _draw(law, stopped.columns, Path(pictures), test.name, curves)
        raise stopped from None
    columns = record.columns()
    if pictures is not None:
        _draw(law, columns, Path(pictures), test.name, curves)
    return columns


def as_test(path: Test | str | Path | dict[str, Any]) -> Test:
    """A test that is ready, whatever stands for it."""
    if isinstance(path, StrainPath | DeformationPath | PhasedTest):
        return path
    if isinstance(path, dict) or str(path).endswith(_YAML):
        return read_test(path)
    return find_path(str(path))


def _prepared(law: Material, test: Test) -> tuple[Material, SpecimenWater | None, float | None]:
    """The law that the specimen follows, its water and its porosity, as far as they are known."""
    given = test.porosity if isinstance(test, PhasedTest) else None
    own = getattr(law, "porosity", getattr(law, "initial_porosity", None))
    porosity = given if own is None else own
    if not isinstance(test, PhasedTest) or not test.wet:
        return law, None, porosity
    if getattr(law, "owns_pore_pressure", False):
        message = "this law has its own pore pressure: leave out water, and drainage, and use its parameters"
        raise InputError(test.name, [Problem(("water",), message)])
    if not porosity:
        message = "water needs room: give the porosity at the start, above 0 (this law has none)"
        raise InputError(test.name, [Problem(("porosity",), message)])
    model = test.water or SpecimenWaterInput()
    curve = retention_of(model.retention)
    factors = np.array([bishop_of(model.bishop, curve)])
    water = SpecimenWater(porosity, curve, factors, model.bulk_modulus, model.pressure)
    if curve.kind != FULL and hasattr(law, "for_unsaturated"):
        pressure, saturation = water.at(np.zeros(1))
        law = law.for_unsaturated(float(bonding_variable(np.maximum(-pressure, 0.0), saturation)[0]))
    return law, water, porosity


def _specimen(law, test, initial_stress, volume, number, water) -> MaterialPoint:
    """The point at the start."""
    if isinstance(test, PhasedTest):
        own = -test.pressure * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    else:
        own = test.initial_stress
    stress = initial_stress if initial_stress is not None else own
    try:
        return MaterialPoint(law, np.zeros(6) if stress is None else stress, volume, number, water)
    except ValueError as error:
        raise InputError(test.name, [Problem((), f"the initial stress does not suit: {error}")]) from error


class _Record:
    """The rows that were reached, and where the point is on its way."""

    def __init__(self, point: MaterialPoint, porosity: float | None):
        self.place = ""
        self._point, self._porosity = point, porosity
        self._rows: list[dict[str, float]] = []

    def add(self, time: float, extra: dict[str, float]) -> None:
        """Keep the point's present state as a row."""
        self._rows.append({"time_s": float(time)} | extra | observed(self._point))

    def latest(self) -> dict[str, float]:
        """What engineers read of the present state."""
        row = {name: np.array([value]) for name, value in observed(self._point).items()}
        return {name: float(column[0]) for name, column in self._engineering(row).items()}

    def columns(self) -> Columns:
        """Columns by name."""
        return self._engineering({name: np.array([row[name] for row in self._rows]) for name in self._rows[0]})

    def _engineering(self, columns: Columns) -> Columns:
        return columns | engineering(columns, self._porosity)


def _rows(point: MaterialPoint, test: Test, substeps: int | None, record: _Record) -> Iterator[tuple]:
    """Time, and columns of its own, of each row that the point reaches."""
    if isinstance(test, PhasedTest):
        yield from phased(point, test, substeps or test.substeps, record)
        return
    record.place = test.name
    follow, extra = follower(point, test, substeps or _SUBSTEPS)
    yield test.time[0], extra(0)
    for row in range(1, len(test.time)):
        record.place = f"{test.name}, row {row}, time {test.time[row]:g} s"
        follow(row)
        yield test.time[row], extra(row)


def _draw(law: Material, columns: Columns, folder: Path, stem: str, measured: list[Columns]) -> list[Path]:
    """Pictures of the columns in a folder."""
    try:
        from periporo.materials.laboratory.plots import draw_plots  # only here: matplotlib is optional
    except ImportError as error:
        raise ImportError(f"pictures need matplotlib (pip install 'periporo[plot]'): {error}") from error
    folder.mkdir(parents=True, exist_ok=True)
    return draw_plots(law, columns, folder, stem, measured)
