"""Hypoplastic sand (von Wolffersdorff 1996) with intergranular strain (Niemunis & Herle 1997).

One equation for the rate of stress, without yield surface: stiffness, dilation and strength follow from stress and void
ratio. Limits of the void ratio fall with pressure by Bauer's law, e/e_0 = exp(-(3p/h_s)^n).
"""

import math
from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from periporo.core.points.material import OPENED, StateField, StepRefused
from periporo.materials.base import MaterialParameters, units
from periporo.materials.hypoplastic_rows import advance, fill_moduli

_PRESSURE, _DENSITY, _DEGREES, _NUMBER = units("Pa", "kg/m^3", "deg", "1")

VOID_RATIO = StateField("void_ratio", "1")
INTERGRANULAR_STRAIN = StateField("intergranular_strain", "1", kind="tensor")
DISSIPATION = StateField("dissipation", "J/m^3")


def _positive(meaning: str, unit=_NUMBER, **bounds):
    return Field(gt=0, description=meaning, json_schema_extra=unit, **bounds)


class HypoplasticSand(MaterialParameters):
    """Sand whose strength and dilation follow from its density and pressure.

    A step is divided into as many substeps as the error asks for; one that needs more than `substeps` is refused.
    """

    density: float = _positive("dry bulk density", _DENSITY)
    initial_void_ratio: float = _positive("void ratio at the start")
    critical_friction_angle: float = _positive("angle of friction at the critical state", _DEGREES, lt=60)
    hardness: float = _positive("granular hardness h_s", _PRESSURE)
    exponent: float = _positive("n of Bauer's law of compression", lt=1)
    densest_void_ratio: float = _positive("e_d0, smallest void ratio at no pressure")
    critical_void_ratio: float = _positive("e_c0, void ratio of the critical state at no pressure")
    loosest_void_ratio: float = _positive("e_i0, largest void ratio at no pressure")
    alpha: float = Field(ge=0, le=1, description="exponent of the peak strength", json_schema_extra=_NUMBER)
    beta: float = Field(ge=0, le=5, description="exponent of the stiffness", json_schema_extra=_NUMBER)
    elastic_range: float = Field(
        1e-4, gt=0, le=0.1, description="R, size of the range of small strains", json_schema_extra=_NUMBER
    )
    reversal_stiffness: float = Field(
        5.0, ge=1, le=100, description="m_R, stiffness after a reversal over that in monotonic strain",
        json_schema_extra=_NUMBER,
    )  # fmt: skip
    turn_stiffness: float = Field(
        2.0, ge=1, le=100, description="m_T, the same after a turn by 90 degrees", json_schema_extra=_NUMBER
    )
    range_exponent: float = Field(
        0.5, ge=0, le=10, description="beta_r, growth of the intergranular strain", json_schema_extra=_NUMBER
    )
    stiffness_exponent: float = Field(
        6.0, gt=0, le=50, description="chi, fall of the stiffness with strain", json_schema_extra=_NUMBER
    )
    smallest_pressure: float = Field(
        10.0, gt=0, description="mean pressure at which soil comes apart", json_schema_extra=_PRESSURE
    )
    tolerance: float = Field(
        1e-3, gt=0, le=0.1, description="error of a substep, relative to the stress", json_schema_extra=_NUMBER
    )
    substeps: int = Field(
        2000, ge=1, le=1_000_000, description="most substeps of a step", json_schema_extra=_NUMBER
    )
    report_dissipation: bool = Field(
        False, description="keep the work of the last step that unloading would not give back in the state"
    )

    default_output: ClassVar[tuple[str, ...]] = (VOID_RATIO.name,)

    @model_validator(mode="after")
    def _in_order(self):
        dense, critical, loose = self.densest_void_ratio, self.critical_void_ratio, self.loosest_void_ratio
        if not dense < critical < loose:
            raise ValueError(
                f"void ratios must ascend: densest_void_ratio ({dense:g}), critical_void_ratio ({critical:g}), "
                f"loosest_void_ratio ({loose:g})"
            )
        if not dense <= self.initial_void_ratio <= loose:
            raise ValueError(
                f"initial_void_ratio ({self.initial_void_ratio:g}) must lie between densest_void_ratio ({dense:g}) and "
                f"loosest_void_ratio ({loose:g})"
            )
        if self.turn_stiffness > self.reversal_stiffness:
            raise ValueError(
                f"turn_stiffness ({self.turn_stiffness:g}) must not exceed reversal_stiffness "
                f"({self.reversal_stiffness:g})"
            )
        if not self._constants()[-1] > 0.0:
            raise ValueError("these void ratios, alpha and critical_friction_angle give no positive stiffness")
        return self

    @property
    def porosity(self) -> float:
        """Volume of the pores at the start, over that of the soil."""
        return self.initial_void_ratio / (1.0 + self.initial_void_ratio)

    @classmethod
    def example(cls) -> Self:
        """Dense Hochstetten sand (von Wolffersdorff 1996; Niemunis & Herle 1997)."""
        return cls(
            density=1650.0, initial_void_ratio=0.6, critical_friction_angle=33.0, hardness=1e9, exponent=0.25,
            densest_void_ratio=0.55, critical_void_ratio=0.95, loosest_void_ratio=1.05, alpha=0.25, beta=1.5,
        )  # fmt: skip

    def _constants(self) -> tuple[float, ...]:
        """h_s, n, e_d0, e_c0, e_i0, alpha, beta, a and the factor of f_s that does not change."""
        sine = math.sin(math.radians(self.critical_friction_angle))
        a = math.sqrt(3.0) * (3.0 - sine) / (2.0 * math.sqrt(2.0) * sine)
        dense, critical, loose = self.densest_void_ratio, self.critical_void_ratio, self.loosest_void_ratio
        looseness = ((loose - dense) / (critical - dense)) ** self.alpha
        below = 3.0 + a * a - a * math.sqrt(3.0) * looseness
        factor = 1.0 / below if below > 0.0 else -1.0
        return self.hardness, self.exponent, dense, critical, loose, self.alpha, self.beta, a, factor

    def numbers(self) -> np.ndarray:
        """Those constants, R, m_R, m_T, beta_r and chi, smallest pressure, tolerance and most substeps: (17,)."""
        names = (
            "elastic_range", "reversal_stiffness", "turn_stiffness", "range_exponent", "stiffness_exponent",
            "smallest_pressure", "tolerance", "substeps",
        )  # fmt: skip
        return np.array([*self._constants(), *(getattr(self, name) for name in names)], float)

    @property
    def state_fields(self) -> tuple[StateField, ...]:
        """Void ratio, intergranular strain, `opened`, and `dissipation` if it is reported."""
        reported = (DISSIPATION,) if self.report_dissipation else ()
        return (VOID_RATIO, INTERGRANULAR_STRAIN, OPENED, *reported)

    def weakened(self, factor: float) -> Self:
        """The law with the tangent of the critical angle divided by `factor`; the peak's share of density stays."""
        tangent = math.tan(math.radians(self.critical_friction_angle)) / factor
        return self.model_copy(update={"critical_friction_angle": math.degrees(math.atan(tangent))})

    def limits_of_void_ratio(self, pressure) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Densest, critical and loosest void ratio (n,) at a mean `pressure` (n,) Pa (Bauer 1996)."""
        fade = np.exp(-((3.0 * np.maximum(pressure, 0.0) / self.hardness) ** self.exponent))
        return self.densest_void_ratio * fade, self.critical_void_ratio * fade, self.loosest_void_ratio * fade

    def doubts(self, stress, state) -> dict[str, str]:
        """What looks wrong about the rows, by subject."""
        dense, _, loose = self.limits_of_void_ratio(-stress[:, :3].sum(axis=1) / 3.0)
        void = state[:, 0]
        outside = (void < dense) | (void > loose)
        if not outside.any():
            return {}
        row = int(np.argmax(outside))
        return {
            "void ratio": f"the void ratio {void[row]:.3g} of {int(outside.sum())} rows is beyond its limits at their "
            f"pressure, such as {dense[row]:.3g} to {loose[row]:.3g}: choose another initial_void_ratio"
        }

    def initial_state(self, stress, ids, volume):
        """The void ratio of the start, grains that have not moved; rows without pressure get the smallest one."""
        state = np.zeros((len(stress), 2 + stress.shape[1] + self.report_dissipation))
        state[:, 0] = self.initial_void_ratio
        loose = stress[:, :3].sum(axis=1) > -3.0 * self.smallest_pressure
        stress[loose, :3], stress[loose, 3:] = -self.smallest_pressure, 0.0
        return state

    def compute_stress(self, stress, strain_increment, state, dt):
        """Advance `stress` (n, 4|6) Pa by `strain_increment` in place; `dt` plays no part.

        Raises StepRefused where a row needs too many substeps.
        """
        self._advance(self.numbers()[None], stress, strain_increment, state)

    def _advance(self, numbers, stress, strain_increment, state) -> None:
        refused = np.zeros(len(stress), np.bool_)
        opened = 1 + stress.shape[1]
        dissipation = opened + 1 if self.report_dissipation else -1
        advance(numbers, stress, strain_increment, state, opened, dissipation, refused)
        if refused.any():
            raise StepRefused(np.flatnonzero(refused), f"it needs more than {self.substeps} substeps")

    @classmethod
    def of_rows(cls, laws, components):
        """What answers for rows of which each has one of the `laws`."""
        return _HypoplasticRows(laws)

    def elastic_moduli(self, stress, state):
        """Moduli of small strains, two (n,) arrays in Pa."""
        return _moduli(self.numbers()[None], stress, state)


class _HypoplasticRows:
    """Rows with a law each."""

    def __init__(self, laws):
        self._law = laws[0]
        self._numbers = np.array([law.numbers() for law in laws])

    def compute_stress(self, stress, strain_increment, state, dt):
        self._law._advance(self._numbers, stress, strain_increment, state)

    def elastic_moduli(self, stress, state):
        return _moduli(self._numbers, stress, state)


def _moduli(numbers, stress, state) -> tuple[np.ndarray, np.ndarray]:
    bulk, shear = np.empty(len(stress)), np.empty(len(stress))
    fill_moduli(numbers, stress, state, bulk, shear)
    return bulk, shear
