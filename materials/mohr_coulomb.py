"""Elastic, plastic Mohr-Coulomb soil, exact in principal stresses, whose strength may follow strain and its rate.

Yield s1 - s3 + (s1 + s3) sin(phi) = 2 c cos(phi) of the largest and the smallest principal stress, tension positive,
flow with psi in place of phi (de Souza Neto, Peric & Owen 2008, section 8.2), cut off at s1 = `tension_cutoff`. Without
friction it is Tresca's law of undrained clay.
"""

import functools
import math
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from periporo.core.numerics.algebra import DIMENSION
from periporo.core.numerics.tensors import dimension_of, filled
from periporo.core.points.material import OPENED, StateField, state_column
from periporo.materials.base import LARGEST, MaterialParameters, units
from periporo.materials.friction import FrictionAngles
from periporo.materials.mohr_coulomb_rows import advance, fill_tension_limit
from periporo.materials.tables import OverStrain, StrainTable, extremes, scaled, strains_of, values_at

_PRESSURE, _DENSITY, _DEGREES, _NUMBER, _RATE, _LENGTH = units("Pa", "kg/m^3", "deg", "1", "1/s", "m")

PLASTIC_SHEAR = StateField("plastic_shear", "1")
SOFTENING_PART = StateField("softening_part", "1")
DISSIPATION = StateField("dissipation", "J/m^3")


class MohrCoulomb(MaterialParameters):
    """Mohr-Coulomb soil; friction 0 is Tresca with the undrained strength c.

    Cohesion and angles may be tables over the plastic shear strain, the largest difference of principal plastic
    strains: soil hardens and softens. `sensitivity` divides the cohesion by itself while soil is remoulded, and
    `rate_coefficient` raises it with the logarithm of the plastic shear rate.
    """

    density: float = Field(gt=0, description="dry bulk density", json_schema_extra=_DENSITY)
    bulk_modulus: float = Field(gt=0, description="bulk modulus K", json_schema_extra=_PRESSURE)
    shear_modulus: float = Field(gt=0, description="shear modulus mu", json_schema_extra=_PRESSURE)
    cohesion: OverStrain = Field(
        description="cohesion c, or undrained strength; a number or a table",
        json_schema_extra=_PRESSURE | {"minimum": 0.0, "exclusiveMaximum": LARGEST["Pa"]},
    )
    friction_angle: OverStrain = Field(
        description="angle of friction phi, a number or a table",
        json_schema_extra=_DEGREES | {"minimum": 0.0, "exclusiveMaximum": 90.0},
    )
    dilation_angle: OverStrain = Field(
        0.0, description="angle of dilation psi, a number or a table",
        json_schema_extra=_DEGREES | {"minimum": 0.0, "exclusiveMaximum": 90.0},
    )
    tension_cutoff: float | None = Field(
        None, ge=0, description="largest principal stress", json_schema_extra=_PRESSURE
    )
    sensitivity: float = Field(
        1.0, ge=1, description="cohesion over that of remoulded soil", json_schema_extra=_NUMBER
    )
    remoulding_shear: float | None = Field(
        None, gt=0, description="plastic shear strain by which sensitive soil is remoulded", json_schema_extra=_NUMBER
    )
    length: float | None = Field(
        None, gt=0, description="radius over which the plastic shear strain is averaged: bands get a width",
        json_schema_extra=_LENGTH,
    )  # fmt: skip
    reference_spacing: float | None = Field(
        None, gt=0, description="spacing at which the plastic shear strains of tables hold; at every spacing if none",
        json_schema_extra=_LENGTH,
    )  # fmt: skip
    rate_coefficient: float = Field(
        0.0, ge=0, le=1, description="part of the cohesion that a tenfold rate of plastic shear adds",
        json_schema_extra=_NUMBER,
    )  # fmt: skip
    reference_rate: float | None = Field(
        None, gt=0, description="rate of plastic shear up to which the cohesion holds", json_schema_extra=_RATE
    )
    report_dissipation: bool = Field(False, description="keep the plastic work of the last step in the state")

    @model_validator(mode="after")
    def _possible_strength(self):
        strain = strains_of(self.cohesion, self.friction_angle, self.dilation_angle)
        cohesion, phi, psi = (
            values_at(p, strain) for p in (self.cohesion, self.friction_angle, self.dilation_angle)
        )
        for name, values, limit in (("cohesion", cohesion, LARGEST["Pa"]), ("friction_angle", phi, 90.0)):
            if not (values.min() >= 0.0 and values.max() < limit):
                found = " to ".join(f"{value:g}" for value in np.unique([values.min(), values.max()]))
                raise ValueError(f"{name} must stay from 0 to below {limit:g}, not {found}")
        if not psi.min() >= 0.0:
            raise ValueError(f"dilation_angle must not be negative, not {psi.min():g}")
        for at, c, high, low in zip(strain, cohesion, phi, psi, strict=True):
            where = f" at plastic_shear {at:g}" if len(strain) > 1 else ""
            if c == 0.0 and high == 0.0:
                raise ValueError(f"cohesion and friction_angle are both 0{where}: the material would have no strength")
            if low > high:
                raise ValueError(
                    f"dilation_angle ({low:g}) must not exceed friction_angle ({high:g}){where}: flow would create "
                    "energy"
                )
        return self

    @model_validator(mode="after")
    def _complete(self):
        if (self.sensitivity > 1.0) != (self.remoulding_shear is not None):
            raise ValueError("give sensitivity, above 1, and remoulding_shear together: one says how much of the "
                             "cohesion is lost, the other by which strain")  # fmt: skip
        if self.sensitivity > 1.0 and isinstance(self.cohesion, StrainTable):
            raise ValueError("give either sensitivity or a table of the cohesion, not both")
        for name in ("length", "reference_spacing"):
            if getattr(self, name) is not None and len(strains_of(*self._strength)) == 1:
                raise ValueError(f"{name} is for strength that follows the plastic shear strain, but none does")
        if self.length is not None and self.reference_spacing is not None:
            raise ValueError("give length, with which bands have a width of their own, or reference_spacing, not both")
        if (self.rate_coefficient > 0.0) != (self.reference_rate is not None):
            raise ValueError("give rate_coefficient, above 0, and reference_rate together")
        return self

    @classmethod
    def example(cls) -> Self:
        """A dense sand with a little cohesion."""
        return cls(
            density=1700.0, bulk_modulus=25e6, shear_modulus=15e6, cohesion=1e3, friction_angle=35.0,
            dilation_angle=5.0,
        )  # fmt: skip

    @property
    def _softening(self) -> float | StrainTable:
        """The cohesion over the plastic shear strain, with what sensitivity makes of it."""
        if self.remoulding_shear is None or isinstance(self.cohesion, StrainTable):
            return self.cohesion
        return StrainTable(
            plastic_shear=(0.0, self.remoulding_shear), values=(self.cohesion, self.cohesion / self.sensitivity)
        )

    @property
    def _strength(self) -> tuple[float | StrainTable, ...]:
        """Cohesion and angles over the plastic shear strain."""
        return self._softening, self.friction_angle, self.dilation_angle

    @property
    def remembers(self) -> bool:
        """Whether the strength follows the strain or its rate, so that stress is not all that a row remembers."""
        return self.rate_coefficient > 0.0 or self.table().shape[1] > 1

    @property
    def exchanges_stress(self) -> bool:
        """Neighbours in a flow may exchange stress if that is all that they remember."""
        return not self.remembers

    @property
    def dilatancy(self) -> float:
        """Plastic volumetric strain over plastic shear strain, about: tan(psi), the largest."""
        return math.tan(math.radians(extremes(self.dilation_angle)[1]))

    @property
    def state_fields(self) -> tuple[StateField, ...]:
        """`dissipation` if reported, `plastic_shear` if the strength follows it, its part that counts, and `opened`."""
        wanted = (
            (DISSIPATION, self.report_dissipation), (PLASTIC_SHEAR, self.remembers),
            (SOFTENING_PART, self.reference_spacing is not None), (OPENED, True),
        )  # fmt: skip
        return tuple(field for field, kept in wanted if kept)

    @property
    def averaged(self) -> tuple[str, float] | None:
        """The strain that the strength follows, and the radius (m) over which it is averaged, if it is."""
        return None if self.length is None else (PLASTIC_SHEAR.name, self.length)

    @property
    def default_output(self) -> tuple[str, ...]:
        """The strain that the strength follows is written."""
        return (PLASTIC_SHEAR.name,) if self.remembers else ()

    def table(self) -> np.ndarray:
        """Plastic shear strains (m,), and there sin(phi), 2 c cos(phi) in Pa and sin(psi): (4, m), not to be changed.

        In between, these are linear.
        """
        return _table(*self._strength)

    def weakened(self, factor: float) -> Self:
        """The law with cohesion, tan(friction_angle), tan(dilation_angle) and cut-off divided by `factor`."""

        def less(angle):
            return math.degrees(math.atan(math.tan(math.radians(angle)) / factor))

        cutoff = None if self.tension_cutoff is None else self.tension_cutoff / factor
        return self.model_copy(
            update={
                "cohesion": scaled(self.cohesion, lambda c: c / factor), "tension_cutoff": cutoff,
                "friction_angle": scaled(self.friction_angle, less),
                "dilation_angle": scaled(self.dilation_angle, less),
            }
        )  # fmt: skip

    def friction_angles(self, dimension: int) -> FrictionAngles:
        """The largest friction angle, which is the same in every kind of test."""
        return FrictionAngles(*[extremes(self.friction_angle)[1]] * 3)

    def doubts(self, stress, state) -> dict[str, str]:
        """What looks wrong about the parameters, by subject."""
        psi = self.dilation_angle
        end = psi.values[-1] if isinstance(psi, StrainTable) else psi
        if end == 0.0:
            return {}
        return {
            "dilation": f"dilation_angle stays at {end:g}: soil that flows grows without bound; give a table that ends "
            "with 0, as in {plastic_shear: [0, 0.3], values: [" + f"{end:g}, 0]}}"
        }  # fmt: skip

    def initial_state(self, stress, ids, volume):
        """Closed, nothing dissipated, not sheared: zeros; and a row's size over `reference_spacing`."""
        state = np.zeros((len(stress), len(self.state_fields)))
        if self.reference_spacing is not None:
            size = volume ** (1.0 / dimension_of(stress))
            state[:, self._column(SOFTENING_PART.name, stress.shape[1])] = size / self.reference_spacing
        return state

    def _column(self, name: str, components: int) -> int:
        found = state_column(self, name, components)
        return -1 if found is None else found

    def compute_stress(self, stress, strain_increment, state, dt):
        """Advance `stress` (n, 4|6) Pa by `strain_increment` in place over `dt` s."""
        self._advance(self.numbers()[None], self.table()[None], stress, strain_increment, state, dt)

    def _advance(self, numbers, tables, stress, strain_increment, state, dt) -> None:
        names = PLASTIC_SHEAR.name, SOFTENING_PART.name, DISSIPATION.name
        columns = tuple(self._column(name, stress.shape[1]) for name in names)
        advance(numbers, tables, dt, stress, strain_increment, state, columns, DIMENSION[dimension_of(stress)])

    def numbers(self) -> np.ndarray:
        """Moduli and cut-off in Pa, the coefficient of the rate and its reference in 1/s, (5,); infinite if none."""
        cutoff = math.inf if self.tension_cutoff is None else self.tension_cutoff
        reference = math.inf if self.reference_rate is None else self.reference_rate
        return np.array([self.bulk_modulus, self.shear_modulus, cutoff, self.rate_coefficient, reference])

    @classmethod
    def of_rows(cls, laws, components):
        """What answers for rows of which each has one of the `laws`."""
        return _MohrCoulombRows(laws)

    def tension_limit(self, stress, state):
        """Largest mean stress (n,) Pa of the rows, at the apex or the cut-off, beyond which they open."""
        return self._tension_limit(self.numbers()[None], self.table()[None], stress, state)

    def _tension_limit(self, numbers, tables, stress, state) -> np.ndarray:
        limit = np.empty(len(stress))
        fill_tension_limit(numbers, tables, state, self._column(PLASTIC_SHEAR.name, stress.shape[1]), limit)
        return limit

    def elastic_moduli(self, stress, state):
        """Constant moduli, two (n,) arrays in Pa."""
        n = len(stress)
        return filled(n, self.bulk_modulus), filled(n, self.shear_modulus)

    def yield_surface(self, stress_row, state_row):
        """Points (p, q) in Pa of triaxial compression at the present strength, to beyond the given stress."""
        limit = float(self.tension_limit(stress_row[None], state_row[None])[0])
        column = self._column(PLASTIC_SHEAR.name, stress_row.shape[-1])
        strain, sine, strength, _ = self.table()
        at = 0.0 if column < 0 else state_row[column]
        sine, strength = float(np.interp(at, strain, sine)), float(np.interp(at, strain, strength))
        p_now = float(np.mean(stress_row[:3]))
        high = limit if math.isfinite(limit) else max(0.0, p_now)
        p = np.array([high, high, min(1.5 * p_now, -abs(high), -strength)])
        q = 3.0 * (strength - 2.0 * sine * p) / (3.0 - sine)
        q[0] = 0.0
        return p, q


class _MohrCoulombRows:
    """Rows with a law each."""

    def __init__(self, laws):
        self._law = laws[0]
        self._numbers = np.array([law.numbers() for law in laws])
        self._tables = np.array([law.table() for law in laws])

    def compute_stress(self, stress, strain_increment, state, dt):
        self._law._advance(self._numbers, self._tables, stress, strain_increment, state, dt)

    def tension_limit(self, stress, state):
        return self._law._tension_limit(self._numbers, self._tables, stress, state)

    def elastic_moduli(self, stress, state):
        return self._numbers[:, 0].copy(), self._numbers[:, 1].copy()


@functools.lru_cache(maxsize=4096)
def _table(*strength: float | StrainTable) -> np.ndarray:
    strain = strains_of(*strength)
    cohesion, phi, psi = (values_at(p, strain) for p in strength)
    phi, psi = np.radians(phi), np.radians(psi)
    return np.array([strain, np.sin(phi), 2.0 * cohesion * np.cos(phi), np.sin(psi)])
