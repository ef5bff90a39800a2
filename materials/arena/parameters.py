"""Parameters of Arena: the manual's names and defaults (Mason sand), bounds, and the rules between them."""

from typing import Any, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from periporo.errors import choice
from periporo.materials.base import MaterialParameters

STRENGTHS = ("PEAKI1", "FSLOPE", "STREN", "YSLOPE")
"""The parameters that damage and variability change, in the order in which functions take them."""

_OfEach = float | dict[str, float]


def _field(default, description, unit="1", **bounds):
    return Field(default, description=description, json_schema_extra={"unit": unit}, **bounds)


class ArenaParameters(MaterialParameters):
    """Validated parameters of the Arena soil model (Arena manual, Banerjee & Brannon)."""

    density: float = _field(1800.0, "bulk density at the start, with the water in the pores", "kg/m^3", gt=0)

    initial_porosity: float = _field(0.40, "porosity at the start", gt=0, lt=1)
    initial_saturation: float = _field(0.5, "water's share of the pores at the start", ge=0, le=1)
    dry_density: float | None = _field(
        None, "density of the dry soil, from which porosity, saturation and density follow", "kg/m^3", gt=0
    )
    water_content: float = _field(0.0, "mass of the water over that of the dry soil, with dry_density", ge=0)
    grain_density: float = _field(2650.0, "density of the grains, with dry_density", "kg/m^3", gt=0)
    water_density: float = _field(1000.0, "density of the water, with dry_density", "kg/m^3", gt=0)
    initial_fluid_pressure: float = _field(0.0, "gauge pore pressure at the start", "Pa", ge=0)
    overconsolidation_ratio: float = _field(1.0, "hydrostatic strength over that of an initial stress", ge=1)
    pore_pressure: Literal["plastic", "total"] = _field(
        "plastic", "strain that changes the pore pressure (eqs 55-66)"
    )
    reference_porosity: float = _field(0.42, "porosity that the moduli were fitted at", gt=0, lt=1)

    p0: float = _field(1e3, "hydrostatic strength (I1) of the loose soil", "Pa", gt=0)
    p1: float = _field(482.68e6, "crush curve: stress scale", "Pa", gt=0)
    p1_sat: float = _field(1.0, "crush curve: strength of the saturated over the dry soil", gt=0)
    p2: float = _field(0.719, "crush curve: exponent", gt=0)
    p1_density_scale_fac: float = _field(5.0, "crush curve: influence of the density on p1", ge=0)

    b0: float = _field(0.0029, "bulk modulus over that of the grains at zero pressure", gt=0)
    b1: float = _field(0.4731, "bulk modulus: curve", gt=0)
    b2: float = _field(1.5057, "bulk modulus: curve", gt=0)
    b3: float = _field(2.5728, "bulk modulus: curve", gt=0)
    b4: float = _field(2.0799, "bulk modulus: exponent", ge=1)
    G0: float = _field(7e8, "shear modulus where Poisson's ratio is not positive", "Pa", gt=0)
    nu1: float = _field(0.35, "Poisson's ratio: constant part", gt=-1, lt=0.5)
    nu2: float = _field(-0.05, "Poisson's ratio: part that fades with stiffness", gt=-1, lt=1)

    grain_bulk_modulus: float = _field(40e9, "bulk modulus of the grains K_s0", "Pa", gt=0)
    grain_slope: float = _field(4.0, "its slope in pressure n_s", ge=0)
    grain_reference_pressure: float = _field(101325.0, "pressure at which the grains have K_s0", "Pa", ge=0)
    water_bulk_modulus: float = _field(2.21e9, "bulk modulus of the water K_w0", "Pa", gt=0)
    water_slope: float = _field(6.029, "its slope in pressure n_w", gt=0)
    water_reference_pressure: float = _field(1e-4, "pressure at which the water has K_w0", "Pa", ge=0)
    air_exponent: float = _field(1.4, "adiabatic exponent of the air", gt=0)
    atmospheric_pressure: float = _field(101325.0, "absolute pressure at gauge pressure 0", "Pa", gt=0)

    PEAKI1: float = _field(1e3, "largest tensile I1", "Pa", ge=0)
    FSLOPE: float = _field(0.453, "slope of the shear limit at the vertex", ge=0)
    STREN: float = _field(1e7, "shear strength at high pressure", "Pa", ge=0)
    YSLOPE: float = _field(0.31, "slope of the shear limit at high pressure", ge=0)
    BETA: float = _field(1.0, "non-associativity; 1 is associative", gt=0)
    BETA_acts_on: Literal["surface", "cap"] = _field(
        "surface", "flow that BETA scales: all, or on the cap"
    )
    BETA_above_1: Literal["refuse", "allow"] = _field(
        "refuse", "BETA > 1 on the surface, which creates energy"
    )
    CR: float = _field(0.5, "share of the surface that the cap takes", gt=0, lt=1)
    T1: float = _field(5e-5, "relaxation time at a strain rate of 1/s", "s", ge=0)
    T2: float = _field(0.5, "exponent of the relaxation time", ge=0)

    do_damage: bool = _field(False, "let the strength fade with the time spent yielding (Kayenta)")
    fspeed: float = _field(7.0, "speed of failure", gt=0)
    time_at_failure: float = _field(800e-6, "time of yielding until half the strength is gone", "s", gt=0)
    damage_grows_on: Literal["shear_limit", "surface"] = _field(
        "shear_limit", "yielding that counts: not that on the cap, or all"
    )
    failed_PEAKI1: float | None = _field(None, "PEAKI1 of the failed soil; 1e-5 Pa", "Pa", ge=0)
    failed_FSLOPE: float | None = _field(None, "FSLOPE of the failed soil; half of FSLOPE", ge=0)
    failed_STREN: float | None = _field(None, "STREN of the failed soil; a tenth of STREN", "Pa", ge=0)
    failed_YSLOPE: float | None = _field(None, "YSLOPE of the failed soil; 1e-5", ge=0)

    do_variability: bool = _field(False, "Weibull-distributed strength with a size effect")
    weibull_modulus: _OfEach = _field(4.0, "Weibull modulus of the strengths, or of each by its name")
    weibull_exponent: _OfEach | None = _field(None, "exponent 1/m of the size effect; the modulus")
    weibull_reference_volume: _OfEach = _field(1e-3, "volume at which the strengths were measured", "m^3")
    weibull_seed: int | dict[str, int] = _field(1, "seed of the draws; 0 keeps the size effect alone")

    shear_modulus_in_tension: Literal["poisson", "constant"] = _field(
        "poisson", "in tension G follows from Poisson's ratio, or is G0"
    )
    density_scaling: Literal["drained", "total"] = _field(
        "drained", "the density scales the drained bulk modulus, or the total one"
    )
    water_strain: Literal["logarithmic", "secant"] = _field(
        "logarithmic", "water's strain is the integral of dp/K_w, or p/K_w"
    )
    undrained_unloading: Literal["fluid", "drained"] = _field(
        "fluid", "in tension K keeps the fluid's part while there is pore pressure, or is the drained one"
    )
    use_disaggregation_algorithm: bool = _field(False, "moduli times exp(evp - p3), as in the manual")

    tolerance: float = _field(1e-3, "first-order error of a substep, relative to the stress", gt=0, le=1)
    substeps: int = _field(0, "fixed number of substeps per update; 0 follows the tolerance", ge=0)
    report_plastic_strain: bool = _field(False, "keep the plastic strain and its length in the state")
    report_dissipation: bool = _field(False, "keep the plastic work of the last step in the state")

    @model_validator(mode="before")
    @classmethod
    def _from_sample(cls, values: Any) -> Any:
        """Porosity, saturation and density of a sample of known dry density and water content (eqs 253, 258, 260)."""
        if not isinstance(values, dict) or values.get("dry_density") is None:
            return values
        names = ("dry_density", "water_content", "grain_density", "water_density")
        given = {name: values.get(name, cls.model_fields[name].default) for name in names}
        if not all(isinstance(v, int | float) and v >= 0 for v in given.values()):
            return values  # whose bounds say what is wrong
        dry, content, grain, water = given.values()
        if not 0 < dry < grain or water == 0:
            raise ValueError(f"dry_density = {dry:g} must be positive and less than grain_density = {grain:g} kg/m^3")
        porosity = 1.0 - dry / grain
        saturation = content * dry / (porosity * water)
        if saturation > 1.0:
            raise ValueError(
                f"water_content = {content:g} is more than the pores hold: at dry_density = {dry:g} kg/m^3 "
                f"({porosity:.4g} of pores) at most {porosity * water / dry:.4g}"
            )
        found = {"initial_porosity": porosity, "initial_saturation": saturation, "density": dry * (1.0 + content)}
        for name, value in found.items():
            other = values.get(name, value)
            if not (isinstance(other, int | float) and abs(other - value) <= 1e-6 * max(value, 1e-3)):
                raise ValueError(f"{name} = {other} contradicts {value:.6g}, which follows from dry_density; give one")
        return values | found

    @field_validator("weibull_modulus", "weibull_exponent", "weibull_reference_volume", "weibull_seed")
    @classmethod
    def _is_of_strengths(cls, value: Any, info: ValidationInfo) -> Any:
        named = value if isinstance(value, dict) else {"": value}
        for name, number in named.items():
            if name and name not in STRENGTHS:
                raise ValueError(f"'{name}' is no strength; {choice(name, STRENGTHS)}")
            if number is not None and not (number > 0 or (number == 0 and info.field_name == "weibull_seed")):
                raise ValueError(f"{name} must be positive, not {number}".lstrip())
        return value

    @property
    def p3(self) -> float:
        """Volumetric plastic strain at which the pores are closed, -ln(1 - initial_porosity)."""
        return -float(np.log1p(-self.initial_porosity))

    @property
    def density_factor(self) -> float:
        """Stiffness relative to the reference porosity (eq. 288)."""
        phi, reference = self.initial_porosity, self.reference_porosity
        return float(np.exp(reference / (1 - reference) - phi / (1 - phi)))

    @property
    def scaled_p1(self) -> float:
        """p1 at the initial density, Pa (eq. 290)."""
        factor = self.density_factor
        return self.p1 * float(np.exp(self.p1_density_scale_fac * factor * (factor - 1)))

    def scatter(self, name: str) -> tuple[float, float, float, int]:
        """Weibull modulus, exponent of the size effect, reference volume (m^3) and seed of the strength `name`."""

        def of(value, default):
            return value.get(name, default) if isinstance(value, dict) else value

        def usual(key):
            return type(self).model_fields[key].default

        modulus = of(self.weibull_modulus, usual("weibull_modulus"))
        exponent = modulus if self.weibull_exponent is None else of(self.weibull_exponent, modulus)
        volume = of(self.weibull_reference_volume, usual("weibull_reference_volume"))
        return modulus, exponent, volume, of(self.weibull_seed, usual("weibull_seed"))

    @property
    def scatter_is_common(self) -> bool:
        """Whether one factor serves all strengths."""
        return len({self.scatter(name) for name in STRENGTHS}) == 1

    def intact_strength(self) -> tuple[float, float, float, float]:
        """PEAKI1, FSLOPE, STREN, YSLOPE of the intact soil."""
        return self.PEAKI1, self.FSLOPE, self.STREN, self.YSLOPE

    def failed_strength(self) -> tuple[float, float, float, float]:
        """The same four of the failed soil; a parameter that is zero intact stays zero by default."""
        given = (self.failed_PEAKI1, self.failed_FSLOPE, self.failed_STREN, self.failed_YSLOPE)
        usual = (1e-5, 0.5 * self.FSLOPE, 0.1 * self.STREN, 1e-5)
        intact = self.intact_strength()
        peak, fslope, stren, yslope = (
            (u if i > 0 else 0.0) if g is None else g for g, u, i in zip(given, usual, intact, strict=True)
        )
        return peak, fslope, stren, yslope

    @model_validator(mode="after")
    def _check_rules(self):
        if (self.T1 > 0) != (self.T2 > 0):
            raise ValueError(
                f"T1 = {self.T1} and T2 = {self.T2}: both must be positive (rate-dependent) or both zero"
            )
        if self.nu1 + min(self.nu2, 0.0) <= -1 or self.nu1 + max(self.nu2, 0.0) >= 0.5:
            raise ValueError(
                f"nu1 = {self.nu1} and nu2 = {self.nu2}: Poisson's ratio lies between nu1 and nu1 + nu2, "
                "which must stay above -1 and below 0.5"
            )
        others = (self.undrained_unloading, self.density_scaling, self.use_disaggregation_algorithm)
        if self.pore_pressure == "total" and others != ("fluid", "drained", False):
            raise ValueError(
                "pore_pressure: total needs undrained_unloading: fluid, density_scaling: drained and no "
                "disaggregation: the others change the stiffness without the pressure"
            )
        if self.grain_slope * self.grain_reference_pressure >= self.grain_bulk_modulus:
            raise ValueError("grain_slope times grain_reference_pressure must stay below grain_bulk_modulus")
        if self.BETA > 1.0 and self.BETA_acts_on == "surface" and self.BETA_above_1 == "refuse":
            raise ValueError(
                f"BETA = {self.BETA} exceeds 1: on the shear limit soil would dilate by more than BETA^2 times the "
                "associated flow and create energy; choose BETA_acts_on: cap, or insist with BETA_above_1: allow"
            )
        kind = surface_kind(*self.intact_strength())
        if not self.do_damage:
            return self
        failed = self.failed_strength()
        if surface_kind(*failed) != kind:
            raise ValueError(
                f"the failed soil's yield surface ({surface_kind(*failed)}) must be of the intact one's kind "
                f"({kind}): set failed_PEAKI1, failed_FSLOPE, failed_STREN, failed_YSLOPE accordingly"
            )
        for c in np.linspace(0.0, 1.0, 101):  # both ends valid does not make all in between valid
            surface_kind(*(c * i + (1 - c) * f for i, f in zip(self.intact_strength(), failed, strict=True)))
        return self


def surface_kind(peak: float, fslope: float, stren: float, yslope: float) -> str:
    """Name of the yield surface that the four strength parameters make; ValueError with the rule if none."""
    if fslope > 0 and stren == 0 and yslope == 0:
        return "linear Drucker-Prager"
    if stren > 0 and fslope == 0 and yslope == 0 and peak == 0:
        return "von Mises"
    if stren > 0 and fslope > 0 and yslope == 0 and peak == 0:
        return "saturating"
    if fslope > yslope > 0 and stren > yslope * peak and peak >= 0:
        return "general"
    raise ValueError(
        f"PEAKI1 = {peak}, FSLOPE = {fslope}, STREN = {stren}, YSLOPE = {yslope} make no yield surface; "
        "allowed: linear Drucker-Prager: FSLOPE > 0, STREN = YSLOPE = 0; "
        "von Mises: STREN > 0, the others 0; "
        "saturating: FSLOPE > 0, STREN > 0, PEAKI1 = YSLOPE = 0; "
        "general: FSLOPE > YSLOPE > 0, STREN > YSLOPE * PEAKI1, PEAKI1 >= 0"
    )
