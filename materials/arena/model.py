"""Arena: partially saturated sand and soil with cap plasticity, rate dependence, damage and variability."""

import math
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from periporo.core.numerics import tensors
from periporo.core.points.material import OPENED, StateField, state_column, state_columns
from periporo.materials.arena.elasticity import fill_moduli
from periporo.materials.arena.kernel import update_rows
from periporo.materials.arena.packed import ArenaConstants
from periporo.materials.arena.parameters import STRENGTHS
from periporo.materials.arena.pores import fill_pores
from periporo.materials.arena.rows import ArenaRows, tell_failed
from periporo.materials.arena.state import (
    CONTENT,
    EVP,
    FACTOR,
    FACTORS,
    PRESSURE,
    STATIC,
    STRENGTH,
    TIME,
    fill_initial,
    fill_yield,
    surface_of,
)
from periporo.materials.arena.surface import squared_limit
from periporo.materials.arena.variability import strength_factors
from periporo.materials.friction import FrictionAngles, angles_of_cone

_LARGEST_ANGLE = 50.0  # degrees, of friction of dense sand at low pressure
_LARGEST_FACTOR = 3.0  # of strength


class Arena(ArenaConstants):
    """Arena soil model (Arena manual, Banerjee & Brannon 2017) with the corrections of docs/explanation/arena.md.

    Stress is total stress, tension positive; the model owns its pore pressure. State columns: volumetric
    plastic strain (compaction positive), pore pressure, compressive strength X (I1 of total stress, negative), fluid
    content, opened strain, and where switched on the damage time, strength factors, the quasi-static stress, the
    plastic strain and its length, the dissipation.
    """

    owns_pore_pressure: ClassVar[bool] = True

    @classmethod
    def example(cls) -> Self:
        """The manual's Mason sand, half saturated."""
        return cls()

    @property
    def rate_dependent(self) -> bool:
        """Whether the stress can exceed the quasi-static one."""
        return self.T1 > 0

    @property
    def state_fields(self) -> tuple[StateField, ...]:
        """The state's columns; parts that are switched off have none."""
        fields = [
            StateField("volumetric_plastic_strain", "1"),
            StateField("pore_pressure", "Pa"),
            StateField("compressive_strength", "Pa", merge="log_mean"),
            StateField("fluid_content", "1", merge="log_mean"),
            OPENED,
        ]
        if self.do_damage:
            fields.append(StateField("damage_time", "s"))
        if self.do_variability:
            fields += [StateField(name, "1", merge="log_mean") for name in self._factor_names]
        if self.rate_dependent:
            fields.append(StateField("quasistatic_stress", "Pa", kind="tensor"))
        if self.report_plastic_strain:
            fields += [StateField("plastic_strain", "1", kind="tensor"), StateField("plastic_strain_length", "1")]
        if self.report_dissipation:
            fields.append(StateField("dissipation", "J/m^3"))
        return tuple(fields)

    @property
    def _factor_names(self) -> list[str]:
        """One strength factor for all, or one for each strength that has a Weibull law of its own."""
        return ["strength_factor"] if self.scatter_is_common else [f"{name}_factor" for name in STRENGTHS]

    @cached_property
    def _columns(self) -> dict[int, np.ndarray]:
        """What `periporo.materials.arena.state` calls `columns`, by the number of stored components."""
        return {components: self._columns_of(components) for components in (4, 6)}

    def _columns_of(self, components: int) -> np.ndarray:
        names = ("damage_time", self._factor_names[0], "quasistatic_stress", "plastic_strain", "plastic_strain_length")
        found = [state_column(self, name, components) for name in (*names, "dissipation")]
        found.insert(FACTORS, len(self._factor_names))
        return np.array([-1 if column is None else column for column in found])

    @classmethod
    def of_rows(cls, laws, components):
        """What answers for rows of which each has one of the `laws`."""
        return ArenaRows(laws)

    def initial_state(self, stress: np.ndarray, ids: np.ndarray, volume: np.ndarray) -> np.ndarray:
        """State (n, k) of rows that start at the total `stress` (n, 4|6) Pa.

        The pores hold fluid at the initial fluid pressure, so the effective stress is known. Rows without any stress
        are set to minus that pressure, in place. An effective stress beyond the virgin surface, times the ratio of
        overconsolidation, gets the volumetric plastic strain whose cap encloses it: the soil was consolidated drained.
        Raises ValueError where no cap can, and where a strength factor leaves no valid yield surface.
        """
        n, components = stress.shape
        columns = self._columns[components]
        if self.initial_fluid_pressure > 0:
            stress[np.ix_(~stress.any(axis=1), np.arange(3))] = -self.initial_fluid_pressure
        state = np.zeros((n, state_columns(self, components)))
        if columns[FACTOR] >= 0:
            state[:, columns[FACTOR] : columns[FACTOR] + columns[FACTORS]] = self._checked_factors(ids, volume)
        if columns[STATIC] >= 0:
            state[:, columns[STATIC] : columns[STATIC] + components] = stress
        i1, j2 = self._invariants(stress)
        fill_initial(*self._packed[1:4], columns, float(self.overconsolidation_ratio), i1, j2, state)
        bad = np.flatnonzero(np.isnan(state[:, EVP]))
        if bad.size:
            b = bad[0]
            raise ValueError(
                f"row {b} (ids {ids[b].tolist()}): initial stress with I1 = {i1[b]:.6g} Pa and sqrt(J2) = "
                f"{math.sqrt(j2[b]):.6g} Pa lies outside every yield surface (fluid pressure "
                f"{self.initial_fluid_pressure:.6g} Pa); reduce its shear or tension, or raise FSLOPE, PEAKI1"
            )
        return state

    def _checked_factors(self, ids, volume):
        """Strength factors (n, 1|4): size effect times Weibull draw."""
        laws = [self.scatter(name) for name in (STRENGTHS if len(self._factor_names) > 1 else STRENGTHS[:1])]
        factors = np.stack([strength_factors(ids, volume, *law) for law in laws], axis=1)
        peak, fslope, stren, yslope = (factors * self.intact_strength()).T
        if self.YSLOPE > 0:
            bad = np.flatnonzero((stren <= yslope * peak) | (fslope <= yslope))
            if bad.size:
                b = bad[0]
                raise ValueError(
                    f"row {b} (ids {ids[b].tolist()}): strength factors {np.round(factors[b], 3)} of its draw make "
                    f"PEAKI1 = {peak[b]:.4g}, FSLOPE = {fslope[b]:.4g}, STREN = {stren[b]:.4g} and YSLOPE = "
                    f"{yslope[b]:.4g}, against the rules STREN > YSLOPE * PEAKI1, FSLOPE > YSLOPE; lower PEAKI1 or "
                    "weibull_reference_volume, or let the strengths draw alike (the same weibull_seed and _modulus)"
                )
        return factors

    def compute_stress(self, stress, strain_increment, state, dt):
        """Advance `stress` (n, 4|6) Pa and `state` (n, k) in place by `strain_increment` over `dt` s.

        With infinite `dt` the overstress vanishes and damage does not grow. Raises UpdatesFailed for rows whose
        update fails: they keep their start state.
        """
        columns = self._columns[stress.shape[1]]
        tell_failed(update_rows(self._packed, columns, stress, strain_increment, state, float(dt)))

    def elastic_moduli(self, stress, state):
        """Bulk and shear modulus of compressive unloading at the current state, two (n,) arrays in Pa."""
        return self._moduli(fill_moduli, self._packed, stress, state)

    def _moduli(self, fill, constants, stress, state) -> tuple[np.ndarray, np.ndarray]:
        i1, _ = self._invariants(self._static_stress(stress, state))
        pressure, evp, content = (np.ascontiguousarray(state[:, c]) for c in (PRESSURE, EVP, CONTENT))
        bulk, shear = np.empty(len(stress)), np.empty(len(stress))
        fill(*constants[:2], i1 + 3.0 * pressure, pressure, evp, content, bulk, shear)
        return bulk, shear

    def weakened(self, factor: float) -> Self:
        """The law whose yield surface has sqrt(J2) over `factor` at every pressure, intact and failed; vertex and crush
        curve stay."""
        names = ("FSLOPE", "STREN", "YSLOPE", "failed_FSLOPE", "failed_STREN", "failed_YSLOPE")
        divided = {name: value / factor for name in names if (value := getattr(self, name)) is not None}
        return type(self)(**(self.model_dump(exclude_unset=True) | divided))

    def friction_angles(self, dimension: int, factor: float = 1.0) -> FrictionAngles:
        """The angles of the shear limit at low pressure, of a row with strength `factor`."""
        slope = factor * self.intact_strength()[1]
        return angles_of_cone(3.0 * slope, 2.0 * self._flow[1] * slope)

    def doubts(self, stress: np.ndarray, state: np.ndarray) -> dict[str, str]:
        """What looks wrong about the parameters and the rows' strength, by subject."""
        columns, strongest = self._columns[stress.shape[1]], 1.0
        if columns[FACTOR] >= 0:
            slopes = columns[FACTOR] + (STRENGTHS.index("FSLOPE") if columns[FACTORS] > 1 else 0)
            strongest = float(state[:, slopes].max(initial=0.0))
        dimension = tensors.dimension_of(stress)
        angles = self.friction_angles(dimension, strongest)
        acting, where = (angles.plane_strain, "plane strain") if dimension == 2 else (angles.compression, "compression")
        if strongest == 1.0:
            if acting is not None:
                return {}
            return {"friction": f"FSLOPE {self.FSLOPE:g} has no limit in {where} at low pressure: nothing shears it"}
        if acting is not None and acting <= _LARGEST_ANGLE and strongest <= _LARGEST_FACTOR:
            return {}
        meaning = f"has {'no limit' if acting is None else f'an angle of friction of {acting:.1f} degrees'} in {where}"
        return {
            "friction": f"FSLOPE {self.FSLOPE:g} times a strength factor of {strongest:.3g} {meaning} at low pressure; "
            "the size effect makes points that are smaller than weibull_reference_volume stronger"
        }

    @property
    def derived_fields(self) -> tuple[StateField, ...]:
        """What `derived_state` gives."""
        fields = [StateField("porosity", "1"), StateField("saturation", "1"), StateField("kappa", "Pa")]
        fields += [StateField("coherence", "1")] if self.do_damage else []
        fields += [] if self.rate_dependent else [StateField("quasistatic_stress", "Pa", kind="tensor")]
        return tuple(fields)

    @property
    def default_output(self) -> tuple[str, ...]:
        """What results hold without being asked."""
        return ("pore_pressure", "porosity", "saturation", *(("coherence",) if self.do_damage else ()))

    def derived_state(self, stress: np.ndarray, state: np.ndarray) -> dict[str, np.ndarray]:
        """Quantities that follow from the stored ones: porosity, saturation, branch point kappa (I1_eff, Pa).

        With damage also the coherence; without rate dependence also the quasi-static stress, (n, 4|6) Pa,
        which then is the stress. All others are (n,).
        """
        n = len(state)
        porosity, saturation = np.empty(n), np.empty(n)
        pressure, evp, content = (np.ascontiguousarray(state[:, c]) for c in (PRESSURE, EVP, CONTENT))
        fill_pores(self._packed[1], evp, content, pressure, porosity, saturation)
        peak, _ = self._yield(stress, state)
        kappa = peak - self.CR * (peak - state[:, STRENGTH] - 3.0 * pressure)
        derived = {"porosity": porosity, "saturation": saturation, "kappa": kappa}
        if self.do_damage:
            time = state[:, self._columns[stress.shape[1]][TIME]]
            fading = self.fspeed * (1.0 - time / self.time_at_failure)
            derived["coherence"] = 0.5 * (1.0 + np.tanh(0.5 * fading))  # 1/(1 + exp(-fading)) that cannot overflow
        if not self.rate_dependent:
            derived["quasistatic_stress"] = stress.copy()
        return derived

    def yield_surface(self, stress_row: np.ndarray, state_row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Curve (p, q) in Pa of the current yield surface, for plots over the total stress.

        p is the mean total stress (tension positive), q = sqrt(3 J2); from the cap's nose to the vertex.
        """
        pressure = state_row[PRESSURE]
        strength = state_row[STRENGTH] + 3.0 * pressure
        surface = self._surface_of(state_row, len(stress_row))
        middle, half = 0.5 * (surface.peak + strength), 0.5 * (surface.peak - strength)
        i1 = middle - half * np.cos(np.linspace(0.0, np.pi, 201))  # denser at both steep ends
        square = np.array([squared_limit(surface, value, strength) for value in i1])
        return i1 / 3.0 - pressure, np.sqrt(3.0 * np.maximum(square, 0.0))

    def yield_excess(self, stress: np.ndarray, state: np.ndarray) -> np.ndarray:
        """Distance (n,) of the quasi-static stress beyond the yield surface, over its length; <= 0 inside."""
        return self._yield(stress, state)[1]

    def _yield(self, stress, state):
        """PEAKI1 and excess, both (n,)."""
        i1, j2 = self._invariants(self._static_stress(stress, state))
        peak, excess = np.empty(len(stress)), np.empty(len(stress))
        fill_yield(*self._packed[2:4], self._columns[stress.shape[1]], i1, j2, state, peak, excess)
        return peak, excess

    def _surface_of(self, state_row, components):
        surface, _, _ = surface_of(self._surface, self._strength, self._columns[components], state_row[None], 0)
        return surface

    def _static_stress(self, stress, state):
        column = self._columns[stress.shape[1]][STATIC]
        return state[:, column : column + stress.shape[1]] if column >= 0 else stress

    @staticmethod
    def _invariants(stress):
        return 3.0 * tensors.mean(stress), 0.5 * tensors.deviator_norm(stress) ** 2
