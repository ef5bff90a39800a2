"""Water in the pores at constant suction: saturation, mass and effective stress (Menon & Song 2022, section 2).

The laws see effective stress; forces come from the total stress sigma = sigma_bar - S_r p_w I with p_w = -suction.
The water is drained: it flows in and out of the pores at will, so the mass of a point is that of its grains plus
rho_w S_r phi V. Water that enters has the velocity of the grains; its kinetic energy dm |v|^2 / 2 counts as work
of the surroundings (`external`), and with that the balance of energy closes to rounding. The work of suction on the
pores is part of the internal work.
"""

import numpy as np

from periporo.core.numerics.jit import inlined, kernel
from periporo.core.points.forces import WORK
from periporo.core.points.material import BONDING
from periporo.core.points.particles import Field
from periporo.errors import InputError, Problem

_EXTERNAL = WORK.index("external")
_KILOPASCAL = 1e3
ATMOSPHERE = 101.3e3
"""Atmospheric pressure, Pa."""


class RetentionCurve:
    """Saturation S_r = {1 + [alpha1 (v - 1)^alpha2 J s]^alpha3}^((1 - alpha3)/alpha3), suction s in kPa.

    v = 1/(1 - phi) is the present specific volume and J the present over the initial volume (Menon & Song 2022,
    eq. 15, after Gallipoli et al. 2003). They print the outer exponent with the opposite sign, which would make
    S_r > 1. `alpha1` 1/kPa, `alpha2`, `alpha3` > 1.
    """

    def __init__(self, alpha1: float, alpha2: float, alpha3: float):
        self.alphas = alpha1, alpha2, alpha3

    def saturation(self, suction: float, porosity: np.ndarray, ratio: np.ndarray) -> np.ndarray:
        """S_r (n,) at `suction` Pa for points of `porosity` (n,) and volume `ratio` J (n,)."""
        result = np.empty(len(porosity))
        _fill_saturation(suction, porosity, ratio, *self.alphas, result)
        return result


RETENTION = {
    # as printed (section 4.2): S_r = 0.9996 and 0.9989 at 25 and 50 kPa and the initial porosity of 0.2
    "menon_song": (0.038, 3.49, 1.25),
    # reproduces the saturations 0.92 and 0.88 that are stated there for these suctions
    "fitted": (8.508, 3.49, 1.0893),
}


class RetentionTable:
    """Saturation from measured pairs of `suction` (k,) Pa and `saturation` (k,), by monotone interpolation.

    Cubic Hermite pieces in the suction with the slopes of Fritsch & Butland (1984): no overshoot. Constant beyond
    the ends; the volume has no influence. Raises ValueError for a table that is not a retention curve.
    """

    def __init__(self, suction, saturation):
        s, y = np.asarray(suction, float), np.asarray(saturation, float)
        if len(s) < 2 or not (np.diff(s) > 0).all() or not (s >= 0).all():
            raise ValueError("retention table: needs at least two rows with increasing suctions >= 0")
        if not ((y >= 0) & (y <= 1)).all() or not (np.diff(y) <= 0).all():
            raise ValueError("retention table: saturations must lie in [0, 1] and not increase with suction")
        self._s, self._y = s, y
        h, slope = np.diff(s), np.diff(y) / np.diff(s)
        product = slope[1:] * slope[:-1]
        weighted = (2 * h[1:] + h[:-1]) * slope[1:] + (h[1:] + 2 * h[:-1]) * slope[:-1]
        inner = np.where(product > 0, 3 * (h[1:] + h[:-1]) * product / np.where(product > 0, weighted, 1.0), 0.0)
        self._slope = np.concatenate([slope[:1], inner, slope[-1:]])

    def saturation(self, suction: float, porosity: np.ndarray, ratio: np.ndarray) -> np.ndarray:
        """S_r (n,) at `suction` Pa, the same for all points."""
        s, y, m = self._s, self._y, self._slope
        x = min(max(suction, s[0]), s[-1])
        k = int(np.clip(np.searchsorted(s, x, side="right") - 1, 0, len(s) - 2))
        h = s[k + 1] - s[k]
        t = (x - s[k]) / h
        value = (
            (1 + 2 * t) * (1 - t) ** 2 * y[k] + t * t * (3 - 2 * t) * y[k + 1]
            + h * t * (1 - t) * ((1 - t) * m[k] - t * m[k + 1])
        )  # fmt: skip
        return np.full(len(porosity), value)


def retention_curve(model) -> RetentionCurve | RetentionTable:
    """The curve that the `retention` entry of a scene describes. Raises InputError for an unusable table."""
    if model.table is not None:
        try:
            return RetentionTable(*_read_table(model.table))
        except (OSError, ValueError) as error:
            problem = Problem(("pore_water", "retention", "table"), f"{model.table}: {error}")
            raise InputError("scene", [problem]) from None
    if model.set is not None:
        return RetentionCurve(*RETENTION[model.set])
    return RetentionCurve(model.alpha1, model.alpha2, model.alpha3)


def _read_table(name):
    """Columns of a CSV file headed suction,saturation in Pa and 1."""
    with open(name, encoding="utf-8-sig") as file:
        header = file.readline().strip().replace(" ", "")
        if header != "suction,saturation":
            raise ValueError(f"its first line must be suction,saturation, not {header!s:.60}")
        return np.loadtxt(file, delimiter=",", ndmin=2).T


class PoreWater:
    """The point process of pore water at constant `suction` Pa.

    `curve` is a retention curve, `water_density` kg/m^3, `porosity` (materials,) the initial one of each material.
    `frozen` keeps saturation and mass as they are at the start: a closed system, for tests of conservation. Point
    fields: `porosity`, `saturation`, `suction`. At suction 0 the pores are full of water without pressure.
    """

    output = ("porosity", "saturation", "suction")

    def __init__(self, suction, curve, water_density, porosity, *, frozen=False):
        self.suction = suction
        self.curve = curve
        self.water_density = water_density
        self.initial_porosity = np.asarray(porosity, float)
        self.frozen = frozen
        self._halo = None
        ones = np.ones(len(self.initial_porosity))
        self.initial_saturation = curve.saturation(suction, self.initial_porosity, ones)
        self.initial_bonding = bonding_variable(suction, self.initial_saturation)

    def attach(self, p, halo) -> None:
        """Declare the point fields; `halo` refreshes those that ghosts need."""
        self._halo = halo
        for name, unit in (("porosity", "1"), ("saturation", "1"), ("suction", "Pa"), ("grain_mass", "kg")):
            p.add_field(Field(name, None, unit, sent=False))
        p.add_field(Field("pore_stress", None, "Pa"))  # -S_r p_w
        p.add_field(Field("bonding_variable", None, "1"))  # xi

    def initial_fields(self, owned: dict[str, np.ndarray]) -> None:
        """Set porosity, saturation, suction and mass of new points, given `volume`, `material` and dry `mass`."""
        material = owned["material"]
        owned["porosity"] = self.initial_porosity[material]
        owned["saturation"] = self.initial_saturation[material]
        owned["suction"] = np.full(len(material), self.suction)
        owned["pore_stress"] = owned["saturation"] * self.suction
        owned["bonding_variable"] = self.initial_bonding[material]
        owned["grain_mass"] = owned["mass"]
        owned["mass"] = owned["mass"] + self.water_density * owned["saturation"] * owned["porosity"] * owned["volume"]

    def density(self, dry: np.ndarray) -> np.ndarray:
        """Bulk density (materials,) of the wet materials at the start from that of the `dry` ones, kg/m^3."""
        return dry + self.water_density * self.initial_saturation * self.initial_porosity

    def update(self, p, bonds, dt: float) -> None:
        """Porosity, saturation and mass at the end of the step, and total stress of the bonds."""
        n = p.owned
        _close_pores(n, p.jacobian, p.porosity)
        if not self.frozen:
            ratio = (1.0 - self.initial_porosity[p.material[:n]]) / (1.0 - p.porosity[:n])
            p.saturation[:] = self.curve.saturation(self.suction, p.porosity[:n], ratio)
            _exchange_water(
                n, self.water_density, p.porosity, p.saturation, p.present_volume() * p.jacobian, p.grain_mass, p.mass,
                p.velocity, p.work, p.dim,
            )  # fmt: skip
        p.pore_stress[:n] = p.saturation * self.suction
        p.bonding_variable[:n] = bonding_variable(self.suction, p.saturation)
        self._halo.update(p, "pore_stress", "bonding_variable")
        for block in bonds.blocks:
            if block.total is None or len(block.total) != len(block.stress):
                block.total = np.empty_like(block.stress)
            index, first, second, _ = bonds.layout.holders(block, bonds.pairs)
            _fill_total(index, first, second, p.pore_stress, block.stress, block.total)
            column = bonding_column(block.material)
            if column is not None:
                _fill_bonding(index, first, second, p.bonding_variable, column, block.state)


def bonding_column(material) -> int | None:
    """The state column that holds the bonding variable, if the law has one."""
    fields = list(material.state_fields)
    return fields.index(BONDING) if BONDING in fields else None


def bonding_variable(suction: float, saturation: np.ndarray) -> np.ndarray:
    """xi = f(s) (1 - S_r), f = 1 + x/(10.7 + 2.4 x), x = suction over atmospheric pressure.

    Gallipoli et al. (2003), with the fit of f by Borja (2004).
    """
    x = suction / ATMOSPHERE
    return (1.0 + x / (10.7 + 2.4 * x)) * (1.0 - saturation)


@inlined
def _power(base, exponent):
    return base**exponent if base > 0.0 else 0.0 * base


@kernel
def _fill_saturation(suction, porosity, ratio, alpha1, alpha2, alpha3, saturation):
    for i in range(porosity.shape[0]):
        voids = porosity[i] / (1.0 - porosity[i])  # v - 1
        x = alpha1 * _power(voids, alpha2) * ratio[i] * suction / _KILOPASCAL
        saturation[i] = (1.0 + _power(x, alpha3)) ** ((1.0 - alpha3) / alpha3)


@kernel
def _close_pores(owned, jacobian, porosity):
    """phi after the volume ratio of this step (eq. 16 is incremental); pores close at 0."""
    for i in range(owned):
        value = 1.0 - (1.0 - porosity[i]) / jacobian[i]
        porosity[i] = 0.0 if value < 0.0 else value


@kernel
def _exchange_water(
    owned, water_density, porosity, saturation, volume, grain_mass, mass, velocity, work, dim
):
    for i in range(owned):
        wet = grain_mass[i] + water_density * saturation[i] * porosity[i] * volume[i]
        square = 0.0
        for a in range(len(dim)):
            square += velocity[i, a] ** 2
        work[i, _EXTERNAL] += 0.5 * (wet - mass[i]) * square
        mass[i] = wet


@kernel
def _fill_total(index, first, second, pore_stress, stress, total):
    for r in range(stress.shape[0]):
        b = index[r]
        water = 0.5 * (pore_stress[first[b]] + pore_stress[second[b]])
        for c in range(stress.shape[1]):
            total[r, c] = stress[r, c] + water if c < 3 else stress[r, c]


@kernel
def _fill_bonding(index, first, second, bonding, column, state):
    for r in range(state.shape[0]):
        b = index[r]
        state[r, column] = 0.5 * (bonding[first[b]] + bonding[second[b]])
