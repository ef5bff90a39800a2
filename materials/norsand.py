"""NorSand: critical state soil whose dilation and strength follow from the state parameter (Jefferies 1993).

Yield q = M_i p (1 + ln(p_i/p)) with the image pressure p_i, flow D = M_i - q/p, and hardening towards a largest p_i
that the state parameter psi_i = e - e_c(p_i) sets (Jefferies & Shuttle 2005; Jefferies & Been 2015).
"""

import math
from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from periporo.core.numerics.tensors import mean
from periporo.core.points.material import OPENED, StateField, StepRefused
from periporo.materials.base import MaterialParameters, units
from periporo.materials.friction import FrictionAngles
from periporo.materials.norsand_return import KILOPASCAL, LEAST_SLOPE, advance, fill_bulk, fill_image

_PRESSURE, _DENSITY, _NUMBER = units("Pa", "kg/m^3", "1")

IMAGE_PRESSURE = StateField("image_pressure", "Pa", merge="log_mean")
VOID_RATIO = StateField("void_ratio", "1")
STATE_PARAMETER = StateField("state_parameter", "1")
DISSIPATION = StateField("dissipation", "J/m^3")
_USUAL_STATE = 0.3  # size of the state parameter of soils that were measured


class NorSand(MaterialParameters):
    """Sand or silt from loose, which liquefies, to dense, which dilates, by its state parameter.

    The critical void ratio is `critical_void_ratio` - `compression_index` ln(p/1 kPa).
    """

    density: float = Field(gt=0, description="dry bulk density", json_schema_extra=_DENSITY)
    initial_void_ratio: float | None = Field(
        None, gt=0, le=20, description="void ratio at the start", json_schema_extra=_NUMBER
    )
    initial_state_parameter: float | None = Field(
        None, ge=-1, le=1, description="in its place: void ratio over that of the critical state at the pressure",
        json_schema_extra=_NUMBER,
    )  # fmt: skip
    critical_state_slope: float = Field(
        gt=0, lt=2.5, description="M, q/p at the critical state in triaxial compression", json_schema_extra=_NUMBER
    )
    critical_void_ratio: float = Field(
        gt=0, le=20, description="Gamma, void ratio of the critical state at 1 kPa", json_schema_extra=_NUMBER
    )
    compression_index: float = Field(
        gt=0, le=2, description="lambda, fall of the critical void ratio per ln p", json_schema_extra=_NUMBER
    )
    dilatancy: float = Field(
        gt=0, le=20, description="chi, largest dilatancy per state parameter in compression", json_schema_extra=_NUMBER
    )
    coupling: float = Field(
        0.0, ge=0, lt=1, description="N, fall of M away from the critical state", json_schema_extra=_NUMBER
    )
    hardening: float = Field(gt=0, description="H, modulus of plastic hardening", json_schema_extra=_NUMBER)
    shear_modulus: float = Field(
        gt=0, description="shear modulus at reference_pressure", json_schema_extra=_PRESSURE
    )
    pressure_exponent: float = Field(
        0.5, ge=0, le=1, description="exponent of the pressure in the moduli", json_schema_extra=_NUMBER
    )
    reference_pressure: float = Field(
        1e5, gt=0, description="pressure at which the shear modulus is given", json_schema_extra=_PRESSURE
    )
    poisson_ratio: float = Field(0.2, gt=-1, lt=0.5, description="Poisson's ratio", json_schema_extra=_NUMBER)
    overconsolidation_ratio: float = Field(
        1.0, ge=1, description="image pressure over that of the initial stress at yield", json_schema_extra=_NUMBER
    )
    smallest_pressure: float = Field(
        10.0, gt=0, description="mean pressure at which soil comes apart", json_schema_extra=_PRESSURE
    )
    report_dissipation: bool = Field(False, description="keep the plastic work of the last step in the state")

    default_output: ClassVar[tuple[str, ...]] = (VOID_RATIO.name, STATE_PARAMETER.name)
    derived_fields: ClassVar[tuple[StateField, ...]] = (STATE_PARAMETER,)

    @model_validator(mode="after")
    def _agree(self):
        if (self.initial_void_ratio is None) == (self.initial_state_parameter is None):
            raise ValueError("give initial_void_ratio or initial_state_parameter, one of them")
        if self.dilatancy * self.compression_index >= self.critical_state_slope:
            raise ValueError(
                f"dilatancy times compression_index ({self.dilatancy * self.compression_index:g}) must be below "
                f"critical_state_slope ({self.critical_state_slope:g}): the image state would not follow the state"
            )
        if 12.0 * self._ratio <= self.critical_state_slope**2:
            raise ValueError(
                f"poisson_ratio ({self.poisson_ratio:g}) is too large for critical_state_slope "
                f"({self.critical_state_slope:g}): G/K = {self._ratio:.3g} must exceed M^2/12"
            )
        return self

    @property
    def porosity(self) -> float | None:
        """Volume of the pores at the start, over that of the soil; not known where the pressure decides it."""
        void = self.initial_void_ratio
        return None if void is None else void / (1.0 + void)

    @classmethod
    def example(cls) -> Self:
        """A dense sand with numbers in the middle of those of Jefferies & Been (2015)."""
        return cls(
            density=1650.0, initial_state_parameter=-0.1, critical_state_slope=1.25, critical_void_ratio=0.9,
            compression_index=0.03, dilatancy=4.0, coupling=0.35, hardening=100.0, shear_modulus=40e6,
            overconsolidation_ratio=1.5,
        )  # fmt: skip

    @property
    def _ratio(self) -> float:
        """G/K."""
        return 1.5 * (1.0 - 2.0 * self.poisson_ratio) / (1.0 + self.poisson_ratio)

    def _numbers(self) -> np.ndarray:
        """What the return needs to know of the parameters, (11,): see `advance`."""
        slope = self.critical_state_slope
        image_dilatancy = self.dilatancy / (1.0 - self.dilatancy * self.compression_index / slope)
        return np.array([
            self.reference_pressure, self.shear_modulus / self._ratio, self.pressure_exponent, slope,
            self.critical_void_ratio, self.compression_index, image_dilatancy, self.coupling, self.hardening,
            self.smallest_pressure, self._ratio,
        ])  # fmt: skip

    @property
    def state_fields(self) -> tuple[StateField, ...]:
        """Image pressure, void ratio, `opened`, and `dissipation` if it is reported."""
        return (IMAGE_PRESSURE, VOID_RATIO, OPENED) + ((DISSIPATION,) if self.report_dissipation else ())

    def weakened(self, factor: float) -> Self:
        """The law with the tangent of the critical angle divided by `factor`; what density adds to the peak stays."""
        sine = 3.0 * self.critical_state_slope / (6.0 + self.critical_state_slope)
        sine = math.sin(math.atan(math.tan(math.asin(sine)) / factor))
        return self.model_copy(update={"critical_state_slope": 6.0 * sine / (3.0 - sine)})

    def friction_angles(self, dimension: int) -> FrictionAngles:
        """The angles of the critical state; that of plane strain has no stress out of plane but the mean."""
        slope = self.critical_state_slope
        angle = math.degrees(math.asin(3.0 * slope / (6.0 + slope)))
        plane = (slope - slope**2 / (3.0 + slope) * math.sqrt(0.5)) / math.sqrt(3.0)
        return FrictionAngles(angle, angle, math.degrees(math.asin(plane)))

    def critical_void_ratio_at(self, pressure) -> np.ndarray:
        """Void ratio of the critical state (n,) at a `pressure` (n,) Pa."""
        pressure = np.maximum(pressure, self.smallest_pressure)
        return self.critical_void_ratio - self.compression_index * np.log(pressure / KILOPASCAL)

    def derived_state(self, stress, state) -> dict[str, np.ndarray]:
        """The state parameter psi (n,): void ratio over that of the critical state at the present pressure."""
        return {STATE_PARAMETER.name: state[:, 1] - self.critical_void_ratio_at(-mean(stress))}

    def doubts(self, stress, state) -> dict[str, str]:
        """What looks wrong about the rows, by subject."""
        away = self.derived_state(stress, state)[STATE_PARAMETER.name]
        row = int(np.argmax(np.abs(away))) if len(away) else 0
        if not len(away) or abs(away[row]) <= _USUAL_STATE:
            return {}
        return {
            "state parameter": f"a row has the state parameter {away[row]:.2g}; soils have {-_USUAL_STATE:g} to "
            f"{_USUAL_STATE:g}: choose another initial_void_ratio"
        }

    def initial_state(self, stress, ids, volume):
        """Image pressure of the surface through the stress, times the overconsolidation ratio, and the void ratio.

        Rows without pressure get the smallest one.
        """
        loose = mean(stress) > -self.smallest_pressure
        stress[loose, :3], stress[loose, 3:] = -self.smallest_pressure, 0.0
        state = np.zeros((len(stress), len(self.state_fields)))
        void = self.initial_void_ratio
        if void is None:
            void = self.critical_void_ratio_at(-mean(stress)) + self.initial_state_parameter
        state[:, 1] = void
        image = np.empty(len(stress))
        fill_image(self._numbers()[None], stress, state[:, 1].copy(), image)
        state[:, 0] = self.overconsolidation_ratio * image
        return state

    def compute_stress(self, stress, strain_increment, state, dt):
        """Advance `stress` (n, 4|6) Pa by `strain_increment` in place; `dt` plays no part.

        Raises StepRefused where a step is too long to find the image pressure.
        """
        _advance(self._numbers()[None], self.report_dissipation, stress, strain_increment, state)

    def elastic_moduli(self, stress, state):
        """Moduli at the present pressure, two (n,) arrays in Pa."""
        return _moduli(self._numbers()[None], stress)

    @classmethod
    def of_rows(cls, laws, components):
        """What answers for rows of which each has one of the `laws`."""
        return _NorSandRows(laws)

    def yield_surface(self, stress_row, state_row):
        """Points (p, q) in Pa of the yield surface of one row's state in triaxial compression, for drawing."""
        image, void = state_row[:2]
        share = 1.0 - self._numbers()[6] * self.coupling / self.critical_state_slope * abs(
            float(void - self.critical_void_ratio_at(image))
        )
        p = image * np.linspace(0.02, math.e, 200)
        return -p, self.critical_state_slope * max(share, LEAST_SLOPE) * p * (1.0 + np.log(image / p))


class _NorSandRows:
    """Rows with a law each."""

    def __init__(self, laws):
        self._numbers = np.array([law._numbers() for law in laws])
        self._reports = laws[0].report_dissipation

    def compute_stress(self, stress, strain_increment, state, dt):
        _advance(self._numbers, self._reports, stress, strain_increment, state)

    def elastic_moduli(self, stress, state):
        return _moduli(self._numbers, stress)


def _advance(numbers, reports, stress, strain_increment, state) -> None:
    refused = np.zeros(len(stress), np.bool_)
    advance(numbers, stress, strain_increment, state, 3 if reports else -1, refused)
    if refused.any():
        raise StepRefused(np.flatnonzero(refused), "no image pressure agrees with so long a step")


def _moduli(numbers, stress) -> tuple[np.ndarray, np.ndarray]:
    bulk = np.empty(len(stress))
    fill_bulk(numbers, stress, bulk)
    return bulk, numbers[:, 10] * bulk
