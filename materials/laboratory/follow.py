"""How a point follows a path, or the phases of a test: row by row, in substeps that are halved where they must be."""

from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np

from periporo.errors import InputError, Problem
from periporo.materials.laboratory.paths import (
    GRADIENT_COLUMNS,
    INSIDE_OUT,
    STRESS_COLUMNS,
    DeformationPath,
    StrainPath,
)
from periporo.materials.laboratory.phases import Leg, Phase, PhasedTest, legs_of
from periporo.materials.laboratory.point import Control, MaterialPoint, PointStopped, StressNotReached

_MAX_HALVINGS = 8


class Record(Protocol):
    """What is told where the point is on its way, and tells what engineers read of its present state."""

    place: str

    def latest(self) -> dict[str, float]:
        """The columns of the present state by name."""


def follower(point, path, substeps) -> tuple[Callable, Callable]:
    """Functions that advance the point to a row of a path, and that give the path's own columns of a row."""
    if isinstance(path, DeformationPath):
        names, flat = GRADIENT_COLUMNS, path.gradient.reshape(-1, 9)
        return _gradient_followed(point, path, substeps), lambda row: dict(zip(names, flat[row], strict=True))
    return _strain_followed(point, path, substeps), lambda row: {}


def phased(point: MaterialPoint, test: PhasedTest, substeps: int, record: Record) -> Iterator[tuple]:
    """Rows of a test in phases."""
    time = 0.0
    yield time, {"phase": 0}
    for number, phase in enumerate(test.phases):
        begun = record.latest()
        for leg in _legs(test, number, point, record):
            for row in range(1, leg.rows + 1):
                record.place = f"{_name(test, number)}, time {time:g} s"
                _follow_leg(point, leg, row, substeps)
                time += leg.duration / leg.rows
                yield time, {"phase": number}
                if _is_over(phase, begun, record.latest()):
                    break
            else:
                continue
            break


def _name(test: PhasedTest, number: int) -> str:
    name = test.phases[number].name
    return f"{test.name}, phase {number}" + (f" ({name})" if name else "")


def _legs(test, number, point, record) -> Iterator[Leg]:
    """The straight pieces of a phase; water is opened or shut before each."""
    phase = test.phases[number]
    record.place = _name(test, number)
    if point.water is not None:
        if phase.drainage == "drained":
            point.water.open(point.water.pressure)
        elif point.water.drained:
            point.water.shut(point.volumetric)
    yield from legs_of(phase, point)


def _is_over(phase: Phase, begun: dict[str, float], now: dict[str, float]) -> bool:
    """Whether a column has come to the value at which the phase ends."""
    known = {name: (begun.get(name, np.nan), now.get(name, np.nan)) for name in phase.stop}
    missing = [name for name, (first, _) in known.items() if np.isnan(first)]
    if missing:
        message = f"this test has no number '{missing[0]}' when the phase begins; its porosity, water or stress lacks"
        raise InputError("test", [Problem(("stop",), message)])
    return any((last - phase.stop[name]) * (first - phase.stop[name]) <= 0.0 for name, (first, last) in known.items())


def _follow_leg(point: MaterialPoint, leg: Leg, row: int, substeps: int) -> None:
    """Advance the point to a row of a leg."""
    steps = leg.rows * substeps
    for k in range((row - 1) * substeps + 1, row * substeps + 1):
        if leg.water is not None and point.water is not None:
            first, last = leg.water
            point.water.open(first + k / steps * (last - first))
        increment = leg.strain / steps
        target = leg.start + k / steps * (leg.end - leg.start)
        try:
            _advance(point, increment.copy(), leg.control, target, leg.duration / steps, _MAX_HALVINGS)
        except StressNotReached:
            raise PointStopped(_unreachable(_stresses(point.total))) from None


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
    control = Control.of_components(controlled)
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
                guess = _advance(point, increment, control, target[controlled], dt, _MAX_HALVINGS)
            except StressNotReached:
                raise PointStopped(_missed(point.stress[0], end, controlled)) from None

    return follow


def _missed(stress, wanted, controlled) -> str:
    """How far prescribed stresses came."""
    names = np.array(STRESS_COLUMNS)[controlled]
    values = zip(names, stress[controlled], wanted[controlled], strict=True)
    came = ", ".join(f"{n} came to {s:.6g} of {w:.6g} Pa" for n, s, w in values if abs(s - w) > 1e-6 * abs(w))
    return _unreachable(f", {came}")


def _stresses(total) -> str:
    """How far the stresses of a specimen came, compression positive."""
    axial, radial = -total[1], -0.5 * (total[0] + total[2])
    return f", axial stress came to {axial:.6g}, radial to {radial:.6g}, shear to {total[3]:.6g} Pa"


def _unreachable(how_far: str) -> str:
    return f"the prescribed stress cannot be reached{how_far}; the material may fail there: prescribe strain instead"


def _advance(point, increment, control, target, dt, halvings):
    """One substep, divided again where Newton's method fails; returns the increment of the last part."""
    if not len(target):
        point.strain_by(increment, dt)
        return increment
    present = point.controlled(control)
    try:
        point.reach(increment, control, target, dt)
        return increment
    except StressNotReached:
        if halvings == 0:
            raise
    _advance(point, 0.5 * increment, control, 0.5 * (present + target), 0.5 * dt, halvings - 1)
    return 2.0 * _advance(point, 0.5 * increment, control, target, 0.5 * dt, halvings - 1)


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
