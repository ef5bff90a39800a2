"""One material point along a path: `periporo drive MATERIAL.yaml PATH.csv -o folder`.

Rows of the path are divided into substeps. Strain is given, or found by Newton's method where stress is
given; deformation gradients are joined by stretch and rotation.
"""

import argparse
import dataclasses
import importlib.util
import sys
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ValidationError

from periporo.core.numerics.tensors import COMPONENTS
from periporo.core.points.material import Material
from periporo.errors import InputError, Problem
from periporo.io.input.yaml_source import read_yaml
from periporo.io.schema.errors import problems_of
from periporo.materials import registry
from periporo.materials.laboratory.paths import (
    BUILT_IN,
    GRADIENT_COLUMNS,
    INSIDE_OUT,
    STRAIN_COLUMNS,
    STRESS_COLUMNS,
    DeformationPath,
    StrainPath,
    find_path,
)
from periporo.materials.laboratory.point import MaterialPoint, PointStopped, StressNotReached

_MAX_HALVINGS = 8
_INPUT_ERROR, _STOPPED = 2, 3  # exit status


class DriveStopped(RuntimeError):
    """A point did not reach a row of its path; `columns` are the rows so far, as `drive` returns them."""

    def __init__(self, path: StrainPath | DeformationPath, row: int, reason: str, columns: dict[str, np.ndarray]):
        super().__init__(f"{path.name}, row {row}, time {path.time[row]:g} s: {reason}")
        self.columns = columns


def drive(
    material: Material,
    path: StrainPath | DeformationPath,
    substeps: int = 10,
    initial_stress: np.ndarray | None = None,
    *,
    volume: float = 1.0,
    number: int = 0,
) -> dict[str, np.ndarray]:
    """Columns (m,) by name for the rows of `path`: time, strain, stress and state, in SI units.

    Each row is reached in `substeps` steps. The initial stress (6,) Pa is that of the argument, else the path's own,
    else zero. `volume` (m^3) of the specimen and `number`, its id, are for laws whose strength scatters.

    Raises `InputError` if path and start do not suit, `DriveStopped`, with the rows so far, if the law fails or
    refuses a strain, gives a number that is not finite, or does not reach a prescribed stress.

    >>> from periporo.materials import built_in_path
    >>> from periporo.materials.elastic import Elastic
    >>> soil = Elastic(density=1800, bulk_modulus=25e6, shear_modulus=15e6)
    >>> columns = drive(soil, built_in_path("oedometer", "strain=0.01,confining=0,rows=10"))
    >>> print(f"{columns['stress_yy'][-1]:.6g} Pa")  # (K + 4/3 G) times the strain
    -450000 Pa
    """
    if substeps < 1:
        raise InputError("substeps", [Problem((), f"must be at least 1, not {substeps}")])
    if not 0 < volume < np.inf:
        raise InputError("volume", [Problem((), f"must be positive, in m^3, not {volume:g}")])
    if number < 0:
        raise InputError("id", [Problem((), f"must be at least 0, not {number}")])
    stress = initial_stress if initial_stress is not None else path.initial_stress
    try:
        point = MaterialPoint(material, np.zeros(6) if stress is None else stress, volume, number)
    except ValueError as error:
        raise InputError(path.name, [Problem((), f"the initial stress does not suit: {error}")]) from error
    if isinstance(path, DeformationPath):
        follow = _gradient_followed(point, path, substeps)
    else:
        follow = _strain_followed(point, path, substeps)
    rows = [_observed(point)]
    for row in range(1, len(path.time)):
        try:
            follow(row)
        except PointStopped as stop:
            raise DriveStopped(path, row, str(stop), _table(path, rows)) from None
        rows.append(_observed(point))
    return _table(path, rows)


def _table(path, rows) -> dict[str, np.ndarray]:
    """Columns by name of the rows that were reached."""
    columns = {"time_s": path.time[: len(rows)]}
    if isinstance(path, DeformationPath):
        flat = path.gradient.reshape(-1, 9)
        columns |= {name: flat[: len(rows), c] for c, name in enumerate(GRADIENT_COLUMNS)}
    return columns | {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _gradient_followed(point: MaterialPoint, path: DeformationPath, substeps: int):
    """Function that advances the point to a row of a path of deformation gradients, by stretch and rotation."""
    turned = np.flatnonzero(~(np.linalg.det(path.gradient) > 0))
    if len(turned):
        raise InputError(path.name, [Problem((), f"row {turned[0]}: {INSIDE_OUT}")])

    def follow(row):
        dt = path.time[row] - path.time[row - 1]
        point.deform(path.gradient[row - 1], path.gradient[row], dt, substeps)

    return follow


def _strain_followed(point: MaterialPoint, path: StrainPath, substeps: int):
    """Function that advances the point to a row; strains and prescribed stresses are linear in time in between."""
    controlled = path.stress_controlled
    _check_start(point, path)
    guess = np.zeros(6)

    def follow(row):
        nonlocal guess
        dt = (path.time[row] - path.time[row - 1]) / substeps
        start, end = path.target[row - 1], path.target[row]
        for k in range(1, substeps + 1):
            target = start + k / substeps * (end - start)
            increment = np.where(controlled, guess, target - point.strain)
            try:
                guess = _advance(point, increment, controlled, target, dt, _MAX_HALVINGS)
            except StressNotReached:
                raise PointStopped(_missed(point.stress[0], end, controlled)) from None

    return follow


def _missed(stress, wanted, controlled) -> str:
    """How far prescribed stresses came."""
    names = np.array(STRESS_COLUMNS)[controlled]
    values = zip(names, stress[controlled], wanted[controlled], strict=True)
    came = ", ".join(f"{n} came to {s:.6g} of {w:.6g} Pa" for n, s, w in values if abs(s - w) > 1e-6 * abs(w))
    return f"the prescribed stress cannot be reached, {came}; the material may fail there: prescribe strain instead"


def _advance(point, increment, controlled, target, dt, halvings):
    """One substep, divided again where Newton's method fails; returns the increment of the last part."""
    if not controlled.any():
        point.strain_by(increment, dt)
        return increment
    stress = point.stress[0].copy()
    try:
        point.reach(increment, controlled, target, dt)
        return increment
    except StressNotReached:
        if halvings == 0:
            raise
    _advance(point, 0.5 * increment, controlled, 0.5 * (stress + target), 0.5 * dt, halvings - 1)
    return 2.0 * _advance(point, 0.5 * increment, controlled, target, 0.5 * dt, halvings - 1)


def _check_start(point: MaterialPoint, path: StrainPath) -> None:
    wanted = path.target[0][path.stress_controlled]
    found = point.stress[0][path.stress_controlled]
    if not np.allclose(wanted, found, rtol=1e-9, atol=1e-9):
        names = ", ".join(np.array(STRESS_COLUMNS)[path.stress_controlled])
        message = (
            f"the first row is the start, but its {names} = {', '.join(f'{v:g}' for v in wanted)} Pa differ "
            f"from the initial stress {', '.join(f'{v:g}' for v in found)} Pa; give it by --initial-stress"
        )
        raise InputError(path.name, [Problem((), message)])


def _observed(point: MaterialPoint) -> dict[str, float]:
    """Strain, stress, state and derived state of the point as named numbers."""
    values = dict(zip(STRAIN_COLUMNS, point.strain, strict=True))
    values |= dict(zip(STRESS_COLUMNS, point.stress[0], strict=True))
    column = 0
    for field in point.material.state_fields:
        names = [f"{field.name}_{c}" for c in COMPONENTS] if field.kind == "tensor" else [field.name]
        for name in names:
            values[name] = point.state[0, column]
            column += 1
    if hasattr(point.material, "derived_state"):
        for name, array in point.material.derived_state(point.stress, point.state).items():
            if array.ndim == 1:
                values[name] = array[0]
            else:
                values |= {f"{name}_{c}": v for c, v in zip(COMPONENTS, array[0], strict=True)}
    return {name: float(value) for name, value in values.items()}


def load_material(file: str | Path) -> Material:
    """The material of a YAML file: `model` and its parameters. Raises InputError with line and key."""
    source = read_yaml(file)
    problems = list(source.problems)
    parameters = dict(source.data) if isinstance(source.data, dict) else {}
    name = parameters.pop("model", None)
    if not isinstance(name, str):
        message = f"give the name of the material model, one of {', '.join(sorted(registry.available()))}"
        raise InputError(str(file), [*problems, Problem(("model",), message, source.line(("model",)))])
    try:
        law = registry.load(name)
    except KeyError as error:
        raise InputError(str(file), [*problems, Problem(("model",), error.args[0])]) from None
    try:
        material = law(**parameters)
    except ValidationError as error:
        schema = law.model_json_schema() if issubclass(law, BaseModel) else {}
        problems += problems_of(error, schema, parameters)
    except (TypeError, ValueError) as error:
        problems.append(Problem((), str(error)))
    if problems:
        lines = [dataclasses.replace(p, line=p.line or source.line(p.path)) for p in problems]
        raise InputError(str(file), lines)
    return material


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `periporo drive`."""
    parser.add_argument("material", help="YAML file with `model` and its parameters")
    parser.add_argument(
        "path",
        help="CSV file with time_s and strain_xx, stress_xx or F11 columns; or a built-in path "
        f"({', '.join(BUILT_IN)}), as in triaxial:confining=1e5,strain=0.1,rows=100,rate=1e-3",
    )
    parser.add_argument(
        "-o", "--output", default="drive", help="folder of the results (default: %(default)s)"
    )
    parser.add_argument("-n", "--substeps", type=int, default=10, help="steps per row (default: %(default)s)")
    parser.add_argument(
        "--initial-stress",
        metavar="PA",
        help="mean stress, or six components xx,yy,zz,xy,yz,xz, tension positive: --initial-stress=-1e5",
    )
    parser.add_argument(
        "--volume", type=float, default=1.0, metavar="M3",
        help="volume of the specimen, for laws with a size effect (default: 1 m^3)",
    )  # fmt: skip
    parser.add_argument(
        "--id", type=int, default=0, metavar="N", help="number of the point, for laws that draw by it (default: 0)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Carry out `periporo drive`; messages go to stderr.

    The exit status is 2 if an input is wrong, 3 if the point did not reach the end of the path: the table then
    holds the rows that it reached.
    """
    status = 0
    try:
        material = load_material(arguments.material)
        path = find_path(arguments.path)
        stress = _parse_stress(arguments.initial_stress)
        columns = drive(
            material, path, arguments.substeps, stress, volume=arguments.volume, number=arguments.id
        )
    except InputError as error:
        print(error, file=sys.stderr)
        return _INPUT_ERROR
    except DriveStopped as stop:
        print(f"{stop}\nthe table ends before that row", file=sys.stderr)
        columns, status = stop.columns, _STOPPED
    folder = Path(arguments.output)
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / f"{path.name}.csv"
    write_table(table, columns)
    print(table)
    _draw(material, columns, folder, path.name)
    return status


def _parse_stress(text: str | None) -> np.ndarray | None:
    if text is None:
        return None
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.full(6, np.nan)
    if len(values) == 1:
        values = values[0] * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    if len(values) != 6 or not np.isfinite(values).all():
        message = f"one number or six are needed, separated by commas, not '{text}'"
        raise InputError("--initial-stress", [Problem((), message)])
    return values


def write_table(file: Path, columns: dict[str, np.ndarray]) -> None:
    """Write columns (m,) as CSV with 17 significant digits, which is exact."""
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(file, table, fmt="%.17g", delimiter=",", header=",".join(columns), comments="")


def _draw(material: Material, columns: dict[str, np.ndarray], folder: Path, stem: str) -> None:
    if importlib.util.find_spec("matplotlib") is None:
        print("no plots: they need matplotlib (pip install 'periporo[plot]')", file=sys.stderr)
        return
    from periporo.materials.laboratory.plots import draw_plots  # only here: matplotlib is optional

    for file in draw_plots(material, columns, folder, stem):
        print(file)
