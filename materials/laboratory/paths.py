"""Paths that drive one point: strain (or stress) against time, or the deformation gradient."""

import csv
import math
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from periporo.core.numerics.tensors import COMPONENTS
from periporo.errors import InputError, Problem, choice

GRADIENT_COLUMNS = tuple(f"F{a}{b}" for a in "123" for b in "123")
STRAIN_COLUMNS = tuple(f"strain_{c}" for c in COMPONENTS)
STRESS_COLUMNS = tuple(f"stress_{c}" for c in COMPONENTS)
MAX_ROWS = 1_000_000
INSIDE_OUT = "the determinant of F must be positive: matter would turn inside out"


@dataclass(frozen=True)
class StrainPath:
    """Six components against time, linear between the rows; the first row is the start, without strain.

    name: stem of the output; time: (m,) s; target: (m, 6) accumulated strain, tensor shear, or Pa where
    `stress_controlled` (6,) is true; initial_stress: (6,) Pa that belongs to the path, if any.
    """

    name: str
    time: np.ndarray
    target: np.ndarray
    stress_controlled: np.ndarray = field(default_factory=lambda: np.zeros(6, dtype=bool))
    initial_stress: np.ndarray | None = None


@dataclass(frozen=True)
class DeformationPath:
    """Deformation gradient (m, 3, 3) against time (m,) s, joined by stretch and rotation; the first is identity."""

    name: str
    time: np.ndarray
    gradient: np.ndarray
    initial_stress: np.ndarray | None = None


def find_path(text: str) -> StrainPath | DeformationPath:
    """The path in the CSV file `text`, or the built-in one, as in `triaxial:confining=1e5,strain=0.1`."""
    name, _, options = text.partition(":")
    if name in BUILT_IN and not Path(text).exists():
        return built_in_path(name, options)
    if not Path(text).exists() and not name.endswith(".csv"):
        message = f"neither a file nor a built-in path; {choice(name, list(BUILT_IN))}"
        raise InputError(text, [Problem((), message)])
    return read_path(text)


def read_path(file: str | Path) -> StrainPath | DeformationPath:
    """The path in a CSV file: `time_s` and strains, stresses or F; `#` starts a comment line.

    Raises InputError with the line if a column or a value is not what it must be.
    """
    lines, header, table = _read_table(str(file))
    _check_header(str(file), lines[0], header)
    time = table[:, header.index("time_s")]
    for row in range(1, len(time)):
        if not time[row] > time[row - 1]:
            message = f"time_s must increase: {time[row]:g} s follows {time[row - 1]:g} s"
            raise InputError(str(file), [Problem(("time_s",), message, lines[row + 1])])
    columns = {name: table[:, c] for c, name in enumerate(header)}
    stem = Path(file).stem
    path: StrainPath | DeformationPath
    if any(name in GRADIENT_COLUMNS for name in header):
        gradient = _gradients(columns, len(time))
        bad = np.flatnonzero(~(np.linalg.det(gradient) > 0))
        if len(bad):
            raise InputError(str(file), [Problem(("F",), INSIDE_OUT, lines[bad[0] + 1])])
        starts = np.allclose(gradient[0], np.eye(3), rtol=0, atol=1e-14)
        path = DeformationPath(stem, time, gradient)
    else:
        path = strain = _strain_path(stem, time, columns)
        starts = not np.any(strain.target[0, ~strain.stress_controlled])
    if not starts:
        message = "the first row is the start: its strains must be 0, or its F the identity"
        raise InputError(str(file), [Problem((), message, lines[1])])
    return path


def _read_table(file: str) -> tuple[list[int], list[str], np.ndarray]:
    """Line number of the header and of every row, the header, and the numbers (m, columns)."""
    try:
        text = Path(file).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InputError(file, [Problem((), f"the file cannot be read: {reason}")]) from None
    numbered = [
        (number, [cell.strip() for cell in next(csv.reader([line]))])
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if len(numbered) < 3:
        raise InputError(file, [Problem((), "a path needs a header and at least two rows")])
    if len(numbered) > MAX_ROWS:
        raise InputError(file, [Problem((), f"a path may have {MAX_ROWS} rows, not {len(numbered) - 1}")])
    line, header = numbered[0]
    for sign, separator in (("a semicolon", ";"), ("a tab", "\t")):
        if len(header) == 1 and separator in header[0]:
            message = f"columns are separated by {sign}; separate them by commas, with points in numbers"
            raise InputError(file, [Problem((), message, line)])
    values = []
    for number, cells in numbered:
        if cells[-1] == "":
            message = "the line ends with a comma, as if another column followed; remove it"
            raise InputError(file, [Problem((), message, number)])
        if len(cells) != len(header):
            message = f"{len(cells)} values under {len(header)} columns"
            raise InputError(file, [Problem((), message, number)])
    for number, cells in numbered[1:]:
        values.append([_number(file, number, name, cell) for name, cell in zip(header, cells, strict=True)])
    return [number for number, _ in numbered], header, np.array(values)


def _number(file: str, line: int, column: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(file, [Problem((column,), f"'{text}' is not a finite number", line)])
    return value


def _check_header(file: str, line: int, header: list[str]) -> None:
    known = ("time_s", *STRAIN_COLUMNS, *STRESS_COLUMNS, *GRADIENT_COLUMNS)
    problems = []
    for name in header:
        if name not in known:
            meant = _meant(name)
            hint = choice(name, known) if meant is None else f"did you mean '{meant}'?"
            problems.append(Problem((name,), f"unknown column; {hint}", line))
    for name in sorted({n for n in header if header.count(n) > 1}):
        problems.append(Problem((name,), "this column stands here twice", line))
    if "time_s" not in header:
        problems.append(Problem(("time_s",), "this column is missing", line))
    gradient = [n for n in header if n in GRADIENT_COLUMNS]
    others = [n for n in header if n in STRAIN_COLUMNS or n in STRESS_COLUMNS]
    if gradient and others:
        problems.append(Problem((gradient[0],), f"F cannot be combined with {others[0]}", line))
    if not gradient and not others:
        problems.append(Problem((), "there is no column of strain, stress or F", line))
    for c in COMPONENTS:
        if f"strain_{c}" in header and f"stress_{c}" in header:
            problems.append(Problem((f"stress_{c}",), f"give this or strain_{c}, not both", line))
    if problems:
        raise InputError(file, problems)


def _meant(name: str) -> str | None:
    """The column that goes by another name elsewhere: eps_xx, sigma_yy, t."""
    found = re.fullmatch(r"(e|eps|epsilon|strain|s|sig|sigma|stress)_?([xyz]{2})", name.lower())
    if found:
        kind, component = ("stress" if found[1].startswith("s") and found[1] != "strain" else "strain"), found[2]
        component = component if component in COMPONENTS else component[::-1]
        return f"{kind}_{component}" if component in COMPONENTS else None
    return "time_s" if name.lower() in ("t", "time", "time [s]") else None


def _gradients(columns: dict[str, np.ndarray], rows: int) -> np.ndarray:
    gradient = np.tile(np.eye(3), (rows, 1, 1))
    for c, name in enumerate(GRADIENT_COLUMNS):
        if name in columns:
            gradient[:, c // 3, c % 3] = columns[name]
    return gradient


def _strain_path(stem: str, time: np.ndarray, columns: dict[str, np.ndarray]) -> StrainPath:
    controlled = np.array([name in columns for name in STRESS_COLUMNS])
    names = np.where(controlled, STRESS_COLUMNS, STRAIN_COLUMNS)
    target = np.stack([columns.get(str(name), np.zeros(len(time))) for name in names], axis=1)
    return StrainPath(stem, time, target, controlled)


_OPTIONS = {
    "confining": "isotropic pressure at the start, Pa",
    "strain": "strain at the end",
    "rows": "rows of the path",
    "rate": "strain rate, 1/s",
}
_DEFAULTS = {"confining": 1e5, "strain": 0.1, "rows": 100, "rate": 1e-3}


def built_in_path(name: str, options: str = "") -> StrainPath | DeformationPath:
    """The laboratory test `name`, from an isotropic stress, compressing along yy.

    Tests are triaxial, oedometer, undrained, isotropic and simple_shear. Options, as in
    `confining=1e5,strain=0.1,rows=100,rate=1e-3`: `confining` pressure (Pa); final `strain` (axial; volumetric if
    isotropic; angle of shear in simple shear); `rows`; strain `rate` (1/s).
    Raises `InputError` for an option that there is not.

    >>> path = built_in_path("triaxial", "confining=1e5,strain=0.1,rows=100")
    >>> path.target.shape, float(path.time[-1])
    ((101, 6), 100.0)
    """
    values = _parse_options(f"{name}:{options}", options)
    rows = int(values["rows"])
    part = np.linspace(0.0, 1.0, rows + 1)
    time = part * values["strain"] / values["rate"]
    pressure = np.array([-1.0, -1.0, -1.0, 0.0, 0.0, 0.0]) * values["confining"]
    return BUILT_IN[name](name, time, part * values["strain"], pressure)


def _parse_options(source: str, options: str) -> dict[str, float]:
    values = dict(_DEFAULTS)
    for item in filter(None, options.split(",")):
        key, _, text = item.partition("=")
        if key not in values:
            allowed = ", ".join(f"{k} ({meaning})" for k, meaning in _OPTIONS.items())
            raise InputError(source, [Problem((key,), f"unknown option; options are {allowed}")])
        try:
            values[key] = float(text)
        except ValueError:
            values[key] = math.nan
        lowest = 0.0 if key == "confining" else math.ulp(0.0)
        if not (math.isfinite(values[key]) and values[key] >= lowest):
            allowed = "at least 0" if key == "confining" else "positive"
            raise InputError(source, [Problem((key,), f"'{text}' must be a finite number, {allowed}")])
    if values["rows"] != int(values["rows"]) or not 1 <= values["rows"] <= MAX_ROWS:
        raise InputError(source, [Problem(("rows",), f"must be an integer from 1 to {MAX_ROWS}")])
    return values


def _triaxial(name, time, strain, pressure):
    """Drained triaxial compression: axial strain at constant lateral stress."""
    target = np.zeros((len(time), 6))
    target[:, 0] = target[:, 2] = pressure[0]
    target[:, 1] = -strain
    controlled = np.array([True, False, True, False, False, False])
    return StrainPath(name, time, target, controlled, pressure)


def _oedometer(name, time, strain, pressure):
    """Compression without lateral strain."""
    return StrainPath(name, time, np.outer(strain, [0, -1, 0, 0, 0, 0]), initial_stress=pressure)


def _undrained(name, time, strain, pressure):
    """Triaxial compression at constant volume."""
    return StrainPath(name, time, np.outer(strain, [0.5, -1, 0.5, 0, 0, 0]), initial_stress=pressure)


def _isotropic(name, time, strain, pressure):
    """Compression equal in all directions."""
    return StrainPath(name, time, np.outer(strain, [-1, -1, -1, 0, 0, 0]) / 3, initial_stress=pressure)


def _simple_shear(name, time, strain, pressure):
    """Simple shear at constant volume with its rotation."""
    gradient = np.tile(np.eye(3), (len(time), 1, 1))
    gradient[:, 0, 1] = strain
    return DeformationPath(name, time, gradient, pressure)


BUILT_IN = {
    "triaxial": _triaxial,
    "oedometer": _oedometer,
    "undrained": _undrained,
    "isotropic": _isotropic,
    "simple_shear": _simple_shear,
}
