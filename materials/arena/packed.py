"""Constants of Arena that follow from its parameters, as the compiled loops take them."""

import math
from functools import cached_property

import numpy as np

from periporo.materials.arena import pores as pore_space
from periporo.materials.arena.constants import STRESS_FLOOR, Control, Elasticity, Pores, Strength, Surface, pack
from periporo.materials.arena.parameters import ArenaParameters
from periporo.materials.arena.surface import coefficients


class ArenaConstants(ArenaParameters):
    """Parameters of Arena with what follows from them alone."""

    @cached_property
    def _elasticity(self) -> Elasticity:
        grain, slope, reference = self.grain_bulk_modulus, self.grain_slope, self.grain_reference_pressure
        return Elasticity(
            float(grain),
            float(slope),
            float(reference),
            1.0 / (grain - slope * reference),
            float(self.b0),
            float(self.b1),
            float(self.b2),
            float(self.b3),
            self.b4 / (self.b1 * self.b3),
            1.0 - 1.0 / self.b4,
            float(self.G0),
            float(self.nu1),
            float(self.nu2),
            self.density_factor,
            self.density_scaling == "total",
            self.shear_modulus_in_tension == "poisson",
            self.undrained_unloading == "fluid",
            self.use_disaggregation_algorithm,
        )

    @cached_property
    def _pores(self) -> Pores:
        pores = Pores(
            float(self.initial_porosity),
            float(self.initial_saturation),
            float(self.initial_fluid_pressure),
            self.water_strain == "logarithmic",
            math.nan,
            math.nan,
            float(self.p0),
            self.scaled_p1,
            1.0 / self.p2,
            self.p3,
            float(self.p1_sat),
            max(float(self.p0), 1000.0),
            float(self.air_exponent),
            float(self.atmospheric_pressure),
            float(self.water_bulk_modulus),
            float(self.water_slope),
            float(self.water_reference_pressure),
            self.pore_pressure == "total",
        )
        air = (1.0 - self.initial_saturation) * pore_space.air_volume(pores, 0.0)
        water = self.initial_saturation * pore_space.water_volume(pores, 0.0)[0]
        return pores._replace(open_volume=air + water, open_saturation=water / (air + water))

    @property
    def _flow(self) -> tuple[float, float]:
        """3/2 BETA^2 where soil compacts, and where it dilates."""
        return 1.5 * self.BETA**2, 1.5 * (self.BETA**2 if self.BETA_acts_on == "surface" else 1.0)

    @cached_property
    def _strength(self) -> Strength:
        return Strength(
            *self.intact_strength(),
            *self.failed_strength(),
            float(self.fspeed),
            float(self.time_at_failure),
            float(self.CR),
            *self._flow,
        )

    @cached_property
    def _surface(self) -> Surface:
        """Surface of a row without damage and variability."""
        a1, a2, a3, a4 = coefficients(*(float(v) for v in self.intact_strength()))
        return Surface(a1, a2, a3, a4, float(self.PEAKI1), float(self.CR), *self._flow)

    @cached_property
    def _packed(self) -> tuple[np.ndarray, ...]:
        """Elasticity, pores, surface, strength and control as arrays."""
        control = Control(
            float(self.tolerance),
            float(self.substeps),
            min(float(self.p0), STRESS_FLOOR),
            float(self.T1),
            float(self.T2),
            self.do_damage,
            self.damage_grows_on == "surface",
        )
        parts = (self._elasticity, self._pores, self._surface, self._strength, control)
        return tuple(pack(part) for part in parts)
