"""Parameters of a law that fit measured tests best: `periporo.fit`, and `periporo fit MATERIAL.yaml TESTS.yaml`.

Nonlinear least squares (Branch, Coleman & Li 1999, as in SciPy) over all tests at once. Each compared column counts by
its distance from the measured one over the measured range, so that stresses and strains can be put together; over a
tenth of the largest value, if that is more.
Confidence is that of the linear model at the end, with the scatter that is left of each curve.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError, model_validator

from periporo.core.points.material import Material
from periporo.errors import InputError, Problem, choice
from periporo.io.input.yaml_source import read_yaml
from periporo.io.schema.base import FileName, Name, Real, SceneModel, key
from periporo.io.schema.errors import problems_of
from periporo.materials import registry
from periporo.materials.laboratory.columns import Columns
from periporo.materials.laboratory.drive import DriveStopped, drive
from periporo.materials.laboratory.files import as_material, read_ags, read_measured
from periporo.materials.laboratory.phases import read_test

_REFUSED = 1e3  # residual of parameters that contradict each other
_STEP = 1e-4  # of a parameter, relative, for the derivatives
_CONFIDENCE = 0.95
_FEW = 8  # values of a curve, below which its scatter is that of all
_FLAT = 0.1  # a curve that is flat counts by this part of its height


class Search(SceneModel):
    """Where a parameter is looked for."""

    start: Real | None = key("where to begin; default: the value of the material", default=None)
    lowest: Real | None = key("lowest value; default: the bound of the law", default=None)
    highest: Real | None = key("highest value; default: the bound of the law", default=None)


class AgsTable(SceneModel):
    """Columns of a group of an AGS4 file (needs python-ags4)."""

    group: Name = key("name of the group, as CONS or TRET")
    columns: dict[str, Name] = key("heading of each column, as {void_ratio: CONS_INCE}", min_length=1)
    where: dict[Name, str] = key("headings with the values that rows must have", default={})


class ComparedTest(SceneModel):
    """A test and what was measured in it."""

    test: FileName | dict[str, Any] = key("file of the test, or the test itself: see `periporo drive`")
    measured: FileName = key("CSV or AGS4 file with measured columns")
    ags: AgsTable | None = key("what to read of an AGS4 file", default=None)
    over: Name | None = key(
        "column over which curves are compared; without, the values where |q| is largest, at failure", default=None
    )
    compare: tuple[Name, ...] = key("columns that are compared", min_length=1)
    weight: Real = key("weight of the test", "1", default=1.0, gt=0)

    @model_validator(mode="after")
    def _has_a_table(self):
        if (self.ags is not None) != (Path(self.measured).suffix.lower() == ".ags"):
            raise ValueError("an AGS4 file (.ags) needs 'ags' with its group and columns, and no other file does")
        return self


class FitInput(SceneModel):
    """What is fitted to what."""

    parameters: dict[Name, Search | None] = key("parameters to find", min_length=1)
    tests: tuple[ComparedTest, ...] = key("tests, all at once", min_length=1, max_length=1000)


@dataclass(frozen=True)
class Fit:
    """What was found: `values` of the parameters and half the width of their 95 % `confidence` interval.

    `correlation` (k, k) is that of the parameters in this order; `misfit` the root of the mean square of what is left,
    over the measured ranges; `material` the law; `curves` what it gives for each test, `measured` what was measured.
    """

    values: dict[str, float]
    confidence: dict[str, float]
    correlation: np.ndarray
    misfit: float
    material: Material
    data: dict[str, Any]
    curves: list[Columns]
    measured: list[Columns]


@dataclass(frozen=True)
class _Task:
    test: Any
    measured: Columns
    model: ComparedTest


def fit(
    material: str | Path | dict[str, Any], tests: str | Path | dict[str, Any], say: Callable[[str], None] | None = None
) -> Fit:
    """Find the parameters of a law that fit measured tests best.

    `material` is its YAML file or mapping, whose values are where the search begins; `tests` a YAML file or mapping
    with `parameters` and `tests`. Bounds are those of the law, unless narrower ones are given. `say` gets a line for
    each improvement.

    Raises `InputError` for what cannot be used, or a parameter that the tests do not tell, and ImportError without
    SciPy.
    """
    try:
        from scipy import optimize, stats
    except ImportError as error:
        raise ImportError("fits need SciPy (pip install 'periporo[laboratory]')") from error
    data = dict(material) if isinstance(material, dict) else read_yaml(material).data
    law = as_material(material)
    model, tasks, source = _read(tests)
    names = list(model.parameters)
    start, low, high = _searched(data, law, model, source)
    scale = np.where(start != 0.0, np.abs(start), 1.0)

    def residuals(x):
        return np.concatenate(_residuals(data, names, x * scale, tasks))

    found = optimize.least_squares(
        residuals, start / scale, bounds=(low / scale, high / scale), diff_step=_STEP, x_scale=1.0, xtol=1e-8,
        ftol=1e-10,
    )  # fmt: skip
    values = found.x * scale
    count, free = len(found.fun), len(found.fun) - len(names)
    if free < 1:
        message = f"{count} measured values cannot tell {len(names)} parameters and their confidence"
        raise InputError(source, [Problem(("tests",), message)])
    _refuse_untold(names, found.jac, source)
    variances = _variances(_residuals(data, names, values, tasks)) * count / free
    given = np.linalg.inv(found.jac.T @ found.jac) @ found.jac.T  # change of the parameters by that of each residual
    covariance = given * variances @ given.T
    deviation = np.sqrt(np.diag(covariance))
    width = stats.t.ppf(0.5 + 0.5 * _CONFIDENCE, free) * deviation * scale
    if say is not None:
        say(f"{found.nfev} trials, {found.message}")
    final = data | dict(zip(names, values.tolist(), strict=True))
    fitted = as_material(final)
    return Fit(
        dict(zip(names, values.tolist(), strict=True)), dict(zip(names, width.tolist(), strict=True)),
        covariance / np.outer(deviation, deviation), math.sqrt(float(np.mean(found.fun**2))), fitted, final,
        [_driven(final, task) for task in tasks], [task.measured for task in tasks],
    )  # fmt: skip


def _read(tests) -> tuple[FitInput, list[_Task], str]:
    """Input, tests with what was measured, and what stands for the file in messages."""
    text = None if isinstance(tests, dict) else read_yaml(tests)
    folder = Path(".") if text is None else Path(tests).resolve().parent
    name, data = ("tests", tests) if text is None else (str(tests), text.data)
    try:
        model = FitInput.model_validate(data)
    except ValidationError as error:
        found = problems_of(error, FitInput.model_json_schema(), data)
        lines = [Problem(p.path, p.message, text.line(p.path) if text else None) for p in found]
        raise InputError(name, lines) from None
    tasks = []
    for number, entry in enumerate(model.tests):
        test = read_test(entry.test if isinstance(entry.test, dict) else folder / entry.test)
        file = folder / entry.measured
        measured = read_measured(file) if entry.ags is None else read_ags(file, **entry.ags.model_dump())
        wanted = [*entry.compare, *([entry.over] if entry.over else [])]
        missing = [column for column in wanted if column not in measured]
        if missing:
            message = f"{entry.measured} has no column '{missing[0]}'; {choice(missing[0], list(measured))}"
            raise InputError(name, [Problem(("tests", number, "compare"), message)])
        tasks.append(_Task(test, measured, entry))
    return model, tasks, name


def _searched(data, law, model, source) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start, lowest and highest value of each parameter."""
    found = []
    cls = registry.load(data["model"])
    properties = cls.model_json_schema()["properties"] if issubclass(cls, BaseModel) else {}
    for name, search in model.parameters.items():
        search = search or Search()
        start = search.start if search.start is not None else getattr(law, name, None)
        if isinstance(start, bool) or not isinstance(start, float | int):
            numbers = [n for n in data if isinstance(data[n], float | int)]
            message = f"the law has no number of this name, or no value to begin with; {choice(name, numbers)}"
            raise InputError(source, [Problem(("parameters", name), message)])
        low, high = _bounds(properties.get(name, {}))
        low, high = max(low, _or(search.lowest, -math.inf)), min(high, _or(search.highest, math.inf))
        if not low < start < high:
            message = f"the search begins at {start:g}, which is not between {low:g} and {high:g}; give another start"
            raise InputError(source, [Problem(("parameters", name, "start"), message)])
        found.append((float(start), low, high))
    return tuple(np.array(column) for column in zip(*found, strict=True))  # type: ignore[return-value]


def _or(value: float | None, default: float) -> float:
    return default if value is None else value


def _bounds(node: dict[str, Any]) -> tuple[float, float]:
    """The bounds that the law's schema gives a number."""
    choices = [node, *node.get("anyOf", [])]
    low = [n[k] for n in choices for k in ("minimum", "exclusiveMinimum") if k in n]
    high = [n[k] for n in choices for k in ("maximum", "exclusiveMaximum") if k in n]
    return float(max(low, default=-math.inf)), float(min(high, default=math.inf))


def _variances(parts: list[np.ndarray]) -> np.ndarray:
    """Mean square of the residuals of each residual's curve, for curves scatter differently; of all, if it has few."""
    whole = np.concatenate(parts)
    return np.concatenate([np.full(len(r), np.mean((r if len(r) >= _FEW else whole) ** 2)) for r in parts])


def _residuals(data, names, values, tasks) -> list[np.ndarray]:
    """Distances of what the law gives from what was measured, over the measured ranges, for each compared curve."""
    trial = data | dict(zip(names, map(float, values), strict=True))
    parts: list[np.ndarray] = []
    for task in tasks:
        try:
            driven = _driven(trial, task)
        except InputError:  # parameters that contradict each other
            driven = None
        for column in task.model.compare:
            measured = _at_failure(task.measured)[column] if task.model.over is None else task.measured[column]
            measured = np.atleast_1d(measured)
            known = np.isfinite(measured)
            if driven is None:
                parts.append(np.full(int(known.sum()), _REFUSED))
                continue
            if task.model.over is None:
                given = np.atleast_1d(_at_failure(driven)[column])
            else:
                given = _interpolated(task, driven, column)
            span = max(np.ptp(measured[known]), _FLAT * np.abs(measured[known]).max()) or 1.0
            share = math.sqrt(task.model.weight / len(task.model.compare))
            parts.append(share * (given - measured)[known] / span)
    return parts


def _driven(data, task) -> Columns:
    try:
        return drive(data, task.test)
    except DriveStopped as stop:  # what it gives until there counts
        return stop.columns


def _at_failure(columns: Columns) -> dict[str, float]:
    """The values in the row with the largest |q|; measured ones, if there is no q, in the only row."""
    row = int(np.nanargmax(np.abs(columns["q"]))) if "q" in columns else 0
    return {name: float(column[row]) for name, column in columns.items()}


def _interpolated(task, driven, column) -> np.ndarray:
    """A column of a driven point at the measured places; constant beyond its end."""
    over, values = driven[task.model.over], driven[column]
    direction = 1.0 if over[-1] >= over[0] else -1.0
    rising = np.maximum.accumulate(direction * over)
    keep = np.append(True, np.diff(rising) > 0.0)
    return np.interp(direction * task.measured[task.model.over], rising[keep], values[keep])


def _refuse_untold(names, jacobian, source) -> None:
    """Raise InputError for a parameter on which no compared value depends, or only together with others."""
    sizes = np.sqrt((jacobian**2).sum(axis=0))
    untold = [name for name, size in zip(names, sizes, strict=True) if not size > 0.0]
    if untold:
        message = "nothing that is compared depends on it; leave it out, or add a test that does"
        raise InputError(source, [Problem(("parameters", untold[0]), message)])
    _, singular, rows = np.linalg.svd(jacobian / sizes)
    if singular[-1] < 1e-7 * singular[0]:
        pair = [names[k] for k in np.argsort(-np.abs(rows[-1]))[:2]]
        message = f"the tests tell {' and '.join(pair)} only together; fix one, or add a test that tells them apart"
        raise InputError(source, [Problem(("parameters", pair[0]), message)])
