"""A laboratory test in phases: consolidation, shear, cycles, suction, as a mapping or a YAML file says.

Compression is positive here, as in a laboratory; y is the axis of the specimen. Prescribed stresses are total ones (net
stress where there is suction); without `water` these are the effective ones.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError, model_validator

from periporo.errors import InputError, Problem
from periporo.io.input.yaml_source import YamlSource, read_yaml
from periporo.io.schema.base import Integer, Name, Pressure, Real, SceneModel, key
from periporo.io.schema.errors import problems_of
from periporo.io.schema.water import BISHOP_NEEDS_RETENTION, Bishop, Retention
from periporo.materials.laboratory.columns import STOPPABLE
from periporo.materials.laboratory.point import Control, MaterialPoint

_RATE, _STRESS_RATE = 1e-3, 1e3  # 1/s, Pa/s
_AXIAL, _LATERAL = 1, (0, 2)
_HALF = np.sqrt(0.5)


class Cycles(SceneModel):
    """Cycles of strain or stress about the value at which the phase begins."""

    number: Integer = key("how many", ge=1, le=100_000)
    strain: Real | None = key("amplitude of axial strain, or of the angle of shear", "1", default=None, gt=0, le=1)
    stress: Pressure | None = key("amplitude of axial or shear stress", "Pa", default=None, gt=0)

    @model_validator(mode="after")
    def _has_an_amplitude(self):
        if (self.strain is None) == (self.stress is None):
            raise ValueError("give exactly one of: strain, stress")
        return self


class Phase(SceneModel):
    """A part of a test: what drives the specimen, what is kept, and when it ends."""

    name: Name | None = key("name, for messages", default=None)
    type: Literal["isotropic", "triaxial", "oedometer", "simple_shear", "rest"] = key("kind of test")
    strain: Real | None = key(
        "change of the axial strain, volumetric if isotropic, angle of shear in simple shear", "1", default=None,
        ge=-3, le=3,
    )
    stress: Pressure | None = key(
        "axial stress at the end, mean if isotropic, shear stress in simple shear", "Pa", default=None
    )
    cycles: Cycles | None = key("cycles, in place of strain and stress", default=None)
    radial: Pressure | None = key("radial stress at the end (triaxial); default: as it is", "Pa", default=None)
    keep: Literal["radial", "p", "ratio", "vertical", "volume"] | None = key(
        "what stays besides: radial stress (triaxial, default), mean stress p or ratio q/p of effective stress; in "
        "simple shear vertical stress (default) or volume",
        default=None,
    )
    drainage: Literal["drained", "undrained"] = key("whether water can leave", default="drained")
    water_pressure: Pressure | None = key(
        "water pressure at the end of a drained phase, negative is suction; default: as it is", "Pa", default=None
    )
    duration: Real | None = key("duration, of one cycle if there are some", "s", default=None, gt=0, le=1e10)
    rows: Integer = key("rows of the table, for one cycle if there are some", default=100, ge=1, le=1_000_000)
    stop: dict[str, Real] = key("end early where a column reaches a value, as {q: 150e3}", default={})

    @model_validator(mode="after")
    def _is_one_thing(self):
        drives = [name for name in ("strain", "stress", "cycles") if getattr(self, name) is not None]
        if len(drives) != (self.type != "rest"):
            wanted = "none of them" if self.type == "rest" else "exactly one"
            raise ValueError(f"give {wanted} of strain, stress, cycles in a phase of type {self.type}")
        kept = {"triaxial": ("radial", "p", "ratio"), "simple_shear": ("vertical", "volume")}.get(self.type, ())
        if self.keep is not None and self.keep not in kept:
            allowed = f"one of {', '.join(kept)}" if kept else "nothing"
            raise ValueError(f"a phase of type {self.type} keeps {allowed}, not {self.keep}")
        if self.radial is not None and (self.type != "triaxial" or self.keep not in (None, "radial")):
            raise ValueError("radial belongs to triaxial phases that keep nothing else; leave it out")
        if self.water_pressure is not None and self.drainage == "undrained":
            raise ValueError("water_pressure is prescribed in drained phases only; leave it out, or drain")
        unknown = [name for name in self.stop if name not in STOPPABLE]
        if unknown:
            raise ValueError(f"stop knows no column '{unknown[0]}'; allowed: {', '.join(STOPPABLE)}")
        return self


class SpecimenWaterInput(SceneModel):
    """Water in the pores of the specimen."""

    pressure: Pressure = key("pressure at the start, negative is suction", "Pa", default=0.0)
    bulk_modulus: Real = key("bulk modulus of the water", "Pa", default=2.2e9, ge=1e3, le=1e12)
    retention: Retention | None = key("the retention curve; default: pores are always full", default=None)
    bishop: Bishop | None = key("Bishop's factor; default: the saturation", default=None)

    @model_validator(mode="after")
    def _can_lose_water(self):
        if self.bishop is not None and self.retention is None:
            raise ValueError(BISHOP_NEEDS_RETENTION)
        return self


class PhasedTest(SceneModel):
    """A test of phases, one after the other, on one specimen."""

    name: Name = key("stem of the output", default="test")
    pressure: Pressure = key("total mean stress at the start", "Pa", default=0.0, ge=0)
    porosity: Real | None = key("porosity at the start, if the law has none", "1", default=None, gt=0, lt=1)
    water: SpecimenWaterInput | None = key(
        "water in the pores; default: as soon as a phase is undrained, full pores at pressure 0", default=None
    )
    substeps: Integer = key("steps per row", default=10, ge=1, le=100_000)
    phases: tuple[Phase, ...] = key("what happens", min_length=1, max_length=1000)

    @property
    def wet(self) -> bool:
        """Whether there is water whose pressure counts."""
        return self.water is not None or any(p.drainage == "undrained" or p.water_pressure for p in self.phases)


def read_test(source: str | Path | dict[str, Any]) -> PhasedTest:
    """The test in a YAML file, or that of a mapping. Raises InputError with lines and keys."""
    if isinstance(source, dict):
        return _validated(source, None, Path("."), "test")
    text = read_yaml(source)
    data = {"name": Path(source).stem} | text.data if isinstance(text.data, dict) else text.data
    return _validated(data, text, Path(source).resolve().parent, str(source))


def _validated(data: Any, source: YamlSource | None, folder: Path, name: str) -> PhasedTest:
    problems = list(source.problems) if source else []
    try:
        test = PhasedTest.model_validate(data, context={"folder": folder})
    except ValidationError as error:
        problems += problems_of(error, PhasedTest.model_json_schema(), data)
    if problems:
        lines = [Problem(p.path, p.message, p.line or (source.line(p.path) if source else None)) for p in problems]
        raise InputError(name, lines)
    return test


@dataclass(frozen=True)
class Leg:
    """A straight piece of a phase: `rows` rows over `duration` s along `strain` (6,) and from `start` to `end` (m,).

    The strain is what is prescribed, tension positive; `water` is the pressure Pa at its ends, None if undrained.
    """

    control: Control
    strain: np.ndarray
    start: np.ndarray
    end: np.ndarray
    water: tuple[float, float] | None
    duration: float
    rows: int


def legs_of(phase: Phase, point: MaterialPoint) -> Iterator[Leg]:
    """The straight pieces of a phase of a `point` that is there already: each is made when the point has come to it."""
    if phase.cycles is None:
        yield _leg(phase, point, phase.strain, phase.stress, phase.duration, phase.rows)
        return
    amplitude, middle = phase.cycles.strain or phase.cycles.stress or 0.0, _driven_stress(phase, point)
    for _ in range(phase.cycles.number):
        here = 0.0
        for to in (1.0, -1.0, 0.0):
            way, here = to - here, to
            part = abs(way) / 4.0
            duration = None if phase.duration is None else phase.duration * part
            strain = amplitude * way if phase.cycles.strain is not None else None
            stress = None if strain is not None else middle + amplitude * to
            yield _leg(phase, point, strain, stress, duration, max(1, round(phase.rows * part)))


def _driven_stress(phase: Phase, point: MaterialPoint) -> float:
    """The stress Pa that the phase drives, as it is now, compression positive."""
    total = point.total
    if phase.type == "simple_shear":
        return float(total[3])
    return -float(total[_AXIAL] if phase.type != "isotropic" else total[:3].mean())


def _leg(phase, point, strain, stress, duration, rows) -> Leg:
    control = _control(phase, point, strain is None)
    start = point.controlled(control)
    end = start.copy()
    moved = 0.0 if strain is None else strain
    if stress is not None:
        moved = stress - _driven_stress(phase, point)
        if phase.type == "isotropic":
            end[:] = -stress
        else:
            end[0] = stress if phase.type == "simple_shear" else -stress
    if phase.radial is not None:
        end[-2:] = -phase.radial
    if duration is None:
        rate = _RATE if strain is not None else _STRESS_RATE
        duration = max(abs(moved) / rate, 1e-9 if moved else 1.0)
    water = None
    if phase.drainage == "drained":
        now = 0.0 if point.water is None else point.water.pressure
        water = (now, now if phase.water_pressure is None else phase.water_pressure)
    direction = np.zeros(6) if strain is None else strain * _DIRECTION[phase.type]
    return Leg(control, direction, start, end, water, duration, rows)


_DIRECTION = {
    "isotropic": np.array([-1.0, -1.0, -1.0, 0.0, 0.0, 0.0]) / 3.0,
    "triaxial": np.array([0.0, -1.0, 0.0, 0.0, 0.0, 0.0]),
    "oedometer": np.array([0.0, -1.0, 0.0, 0.0, 0.0, 0.0]),
    "simple_shear": np.array([0.0, 0.0, 0.0, 0.5, 0.0, 0.0]),
}
"""Strain of a unit of what drives a phase, tension positive."""


def _control(phase: Phase, point: MaterialPoint, by_stress: bool) -> Control:
    """What is free and what is prescribed in a phase; the driven stress comes first, if it is one."""
    unit = np.eye(6)
    match phase.type:
        case "isotropic":
            chosen = unit[:3] if by_stress else unit[:0]
        case "rest":
            chosen = unit[:3]
        case "oedometer":
            chosen = unit[1:2] if by_stress else unit[:0]
        case "simple_shear":
            chosen = unit[[*([3] if by_stress else []), *([] if phase.keep == "volume" else [1])]]
        case "triaxial":
            return _triaxial(phase, point, by_stress)
    return Control(chosen.T, chosen, np.zeros(len(chosen), bool))


def _triaxial(phase: Phase, point: MaterialPoint, by_stress: bool) -> Control:
    """Free radial strains; radial stresses are prescribed, or their difference with p or q/p."""
    unit = np.eye(6)
    free = unit[[*([_AXIAL] if by_stress else []), *_LATERAL]]
    rows = [unit[_AXIAL]] if by_stress else []
    effective = [False] * len(rows)
    if phase.keep in (None, "radial"):
        rows += [unit[k] for k in _LATERAL]
        effective += [False, False]
    else:
        mean = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) / 3.0
        if phase.keep == "p":
            rows.append(mean)
        else:  # q = ratio p: the deviator, tension positive, over the mean stress
            deviator = np.array([0.5, -1.0, 0.5, 0.0, 0.0, 0.0])
            p = mean @ point.stress[0]
            if not p < 0.0:
                message = f"there is no ratio q/p at p = {-p:g} Pa: consolidate first"
                raise InputError("test", [Problem(("keep",), message)])
            rows.append(deviator - (deviator @ point.stress[0]) / p * mean)
        rows.append(_HALF * (unit[0] - unit[2]))
        effective += [phase.keep == "ratio", False]
    return Control(free.T, np.array(rows), np.array(effective))
