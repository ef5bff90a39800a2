"""Pore pressures of the start that are known at points of a file."""

from collections.abc import Callable

import numpy as np

from periporo.errors import InputError, Problem
from periporo.io.geometry.fields import FieldError, column_of, distances, linear_around
from periporo.io.geometry.points import counted_from
from periporo.io.output.results import ResultError, open_results
from periporo.io.schema.water import PressureFile

_PATH = ("pore_water", "pressure", "file")


def known_pressures(model: PressureFile, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (m, d) m, counted from the scene's origin, and pressures there (m,) Pa. Raises InputError."""
    try:
        places, values = _of_result(model, dimension) if model.is_result else column_of(model.file, model.column)
    except (FieldError, ResultError) as error:
        raise InputError("scene", [Problem(_PATH, str(error))]) from None
    if places.shape[1] != dimension or not len(places):
        message = f"it has {len(places)} points of {places.shape[1]} coordinates; the scene needs some of {dimension}"
        raise InputError("scene", [Problem(_PATH, f"{model.file}: {message}")])
    return counted_from(places, model._origin) if model._origin else places, values


def pressure_around(places: np.ndarray, values: np.ndarray) -> tuple[Callable[[np.ndarray], np.ndarray], float]:
    """Pressure (n,) Pa at positions (n, d) m, linear around the nearest place, and the largest suction, Pa."""
    largest = max(0.0, -float(values.min()))
    return lambda position: np.maximum(linear_around(places, values, position), -largest), largest


def farthest(model: PressureFile, position: np.ndarray) -> tuple[float, float]:
    """How far a position (n, d) m at most is from a place whose pressure is known, and what these are apart, m."""
    d = position.shape[1]
    places, _ = known_pressures(model, d)
    size = np.ptp(places, axis=0)
    apart = float(np.prod(size[size > 0.0]) / len(places)) ** (1.0 / max(1, int((size > 0.0).sum())))
    return float(distances(position, places).max(initial=0.0)), apart


def _of_result(model, dimension):
    """Places and values of an output of a result file."""
    with open_results(model.file) as results:
        step = -1 if model.step is None else model.step
        values, places = results.field(model.column, step), results.positions(step)
        if results.dimension != dimension:
            raise ResultError(f"{model.file} has {results.dimension} dimensions, the scene {dimension}")
    if values.ndim != 1 or not np.isfinite(values).all():
        raise ResultError(f"{model.file}: its '{model.column}' must be one finite number for each point")
    return places[:, :dimension], values
