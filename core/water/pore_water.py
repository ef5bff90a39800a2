"""Water in the pores: pressure, saturation, mass and effective stress (Menon & Song 2022, section 2).

The laws see effective stress; forces come from the total stress sigma = sigma_bar - S p I with the pore pressure p
(compression positive, suction is -p) and the saturation S as Bishop's factor, or another one
(`periporo.core.water.bishop`). Where there is free water outside, the pressure that it has at a point's place is taken
from S p: see `periporo.core.water.pressure.FreeWater`.

`DrainedWater` flows in and out of the pores at will and keeps the pressure of a place; `UndrainedWater` cannot leave
its point. The mass of a point is that of its grains and its water. Water that enters has the velocity of the grains;
its kinetic energy dm |v|^2 / 2 counts as work of the surroundings (`external`), and with that the balance of energy
closes to rounding. The work of pressure on the pores is part of the internal work.
"""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from periporo.core.numerics.jit import kernel
from periporo.core.points.forces import WORK
from periporo.core.points.material import BONDING
from periporo.core.points.particles import Field
from periporo.core.ranks.reductions import exact_sum
from periporo.core.water import smoothing, work
from periporo.core.water.bishop import pore_stress
from periporo.core.water.content import (
    fill_content,
    fill_pressure,
    follow_volume,
    pore_stiffness,
    porosities,
    stored_energy,
)
from periporo.core.water.pores import Pores
from periporo.core.water.pressure import FreeWater, Profile
from periporo.core.water.retention import packed, saturations

_EXTERNAL = WORK.index("external")
ATMOSPHERE = 101.3e3
"""Atmospheric pressure, Pa."""


class PoreWater(ABC):
    """What every pore water does as a point process; a subclass tells pressure and saturation after a step.

    `profile` is the pressure at the start, `free` the free water outside or None. Point fields: `pore_pressure`,
    `saturation`.
    """

    output: tuple[str, ...] = ("pore_pressure", "saturation")
    derived = {"suction": (1, "Pa", lambda p, n: np.maximum(-p.pore_pressure[:n], 0.0))}

    def __init__(self, pores: Pores, profile: Profile, free: FreeWater | None = None):
        self.pores = pores
        self.profile = profile
        self.free = free
        self.curves = packed(pores.retention)
        largest = -np.array([profile.largest_suction])
        driest = np.concatenate([pores.initial_saturation(m, largest) for m in range(len(pores.porosity))])
        self.largest_bonding = bonding_variable(-largest, driest)
        self.reports_work = False  # to the ledger
        self._sim: Any = None
        self._bonds = False  # whether a law wants to know the bonding by suction

    def attach(self, sim) -> None:
        """Declare the point fields."""
        self._sim = sim
        for name, unit in (("pore_pressure", "Pa"), ("saturation", "1"), ("grain_mass", "kg")):
            sim.particles.add_field(Field(name, None, unit, sent=False))
        sim.particles.add_field(Field("pore_stress", None, "Pa"))  # -chi p, and the pressure of free water
        if self.reports_work:
            sim.particles.add_field(work.FIELD)
        self._bonds = any(bonding_column(block.material) is not None for block in sim.bonds.blocks)
        if self._bonds:
            sim.particles.add_field(Field("bonding_variable", None, "1"))  # xi

    def initial_fields(self, owned: dict[str, np.ndarray]) -> None:
        """Set what the water is at new points, given `position`, `volume`, `material` and dry `mass`."""
        material, pores = owned["material"], self.pores
        pressure, porosity = self.profile.at(owned["position"], self._sim.time), pores.porosity[material]
        owned["pore_pressure"] = pressure
        owned["saturation"] = saturations(self.curves, material, -pressure, porosity, np.ones(len(material)))
        owned["pore_stress"] = pore_stress(pores.factors, material, pressure, owned["saturation"])
        owned["grain_mass"] = owned["mass"]
        owned["mass"] = owned["mass"] + pores.density * owned["saturation"] * porosity * owned["volume"]

    def update(self, p, bonds, dt: float) -> None:
        """Pressure, saturation and mass at the end of the step, and total stress of the rows."""
        n = p.owned
        before = p.pore_stress.copy() if self.reports_work and dt > 0.0 else None
        self._advance(p, dt)
        p.pore_stress[:n] = pore_stress(self.pores.factors, p.material, p.pore_pressure, p.saturation)
        if self.free is not None:
            p.pore_stress[:n] += self.free.pressure(p, self._sim.reached(dt))
        if self._bonds:
            p.bonding_variable[:n] = bonding_variable(np.maximum(-p.pore_pressure, 0.0), p.saturation)
        self._sim.halo.update(p, "pore_stress", *(("bonding_variable",) if self._bonds else ()))
        if before is not None:
            work.add_work(p, bonds, before)
        self.fill_total(p, bonds)
        for block in bonds.blocks:
            column = bonding_column(block.material)
            if column is not None:
                index, first, second, _ = bonds.layout.holders(block, bonds.pairs)
                _fill_bonding(index, first, second, p.bonding_variable, column, block.state)

    def fill_total(self, p, bonds) -> None:
        """Total stress of the rows, from their own and the `pore_stress` of all points."""
        for block in bonds.blocks:
            if block.total is None or len(block.total) != len(block.stress):
                block.total = np.empty_like(block.stress)
            index, first, second, _ = bonds.layout.holders(block, bonds.pairs)
            _fill_total(index, first, second, p.pore_stress, block.stress, block.total)

    @abstractmethod
    def _advance(self, p, dt: float) -> None:
        """Pressure, saturation and mass of the owned points at the end of the step."""

    def histories(self) -> dict[str, float]:
        """What is stored, m^3 at zero pressure; collective."""
        p = self._sim.particles
        return {"water_stored": float(exact_sum(self._sim.comm, (p.mass - p.grain_mass) / self.pores.density)[0])}

    def exchange(self, p, content) -> None:
        """Let the owned points hold the `content` (owned,) m^3 of water at zero pressure."""
        _exchange_water(
            p.owned, self.pores.density, content, p.grain_mass, p.mass, p.velocity, p.work, p.dim
        )  # fmt: skip


class DrainedWater(PoreWater):
    """Water at the pressure of its place, whatever the soil does; with `frozen` content, for tests of conservation.

    At suction 0 the pores are full of water without pressure. Point field besides: `porosity`.
    """

    output = (*PoreWater.output, "porosity")

    def __init__(self, pores: Pores, profile: Profile, free: FreeWater | None = None, *, frozen: bool = False):
        super().__init__(pores, profile, free)
        self.frozen = frozen

    def attach(self, sim) -> None:
        """Declare the point fields."""
        super().attach(sim)
        sim.particles.add_field(Field("porosity", None, "1", sent=False))

    def initial_fields(self, owned) -> None:
        """Set what the water is at new points, given `position`, `volume`, `material` and dry `mass`."""
        super().initial_fields(owned)
        owned["porosity"] = self.pores.porosity[owned["material"]]

    def _advance(self, p, dt):
        n, initial = p.owned, self.pores.porosity[p.material[: p.owned]]
        _close_pores(n, p.jacobian, p.porosity)
        if self.frozen:
            return
        if self.profile.varies:
            p.pore_pressure[:] = self.profile.at(p.position[:n], self._sim.reached(dt))
        ratio = (1.0 - initial) / (1.0 - p.porosity)
        p.saturation[:] = saturations(self.curves, p.material[:n], -p.pore_pressure, p.porosity, ratio)
        self.exchange(p, p.saturation * p.porosity * p.present_volume() * p.jacobian)


class UndrainedWater(PoreWater):
    """Water that stays with its point, w m^3 at zero pressure: pressure follows from it and the volume of the pores.

    In relaxation, which takes all the time in the world, it keeps its pressure and enters or leaves. The volume is that
    which the laws see, so that pressure works on what it depends on. Point fields: `water_content` m^3, `pore_dilation`
    (present over initial volume).
    """

    stays = True  # with its point, so that nothing else evens out its pressure

    def __init__(self, pores: Pores, profile: Profile, free: FreeWater | None, gravity: np.ndarray):
        """`gravity` (d,) m/s^2 is the scene's."""
        super().__init__(pores, profile, free)
        self.weight = pores.density * gravity
        self.smooths = False
        self.derived = self.derived | {"porosity": (1, "1", lambda p, n: self.porosity(p))}

    def porosity(self, p, rows=slice(None)) -> np.ndarray:
        """Present porosity of the `rows` of the owned points."""
        return porosities(self.pores.porosity[p.material[: p.owned][rows]], p.pore_dilation[rows])

    def attach(self, sim) -> None:
        """Declare the point fields, and tell blocks what stiffness the water adds to theirs."""
        super().attach(sim)
        sim.particles.add_field(Field("water_content", None, "m^3", sent=False))
        sim.particles.add_field(Field("pore_dilation", None, "1", sent=False))
        flows = "flow" in sim.particles.fields and any(b.opening is not None for b in sim.bonds.blocks)
        self.smooths = self.stays and flows
        if self.smooths:
            sim.particles.add_field(smoothing.FIELD)
        for block in sim.bonds.blocks:
            block.pore_stiffness = self._stiffness

    def initial_fields(self, owned) -> None:
        """Set what the water is at new points, given `position`, `volume`, `material` and dry `mass`."""
        super().initial_fields(owned)
        content = owned["saturation"] * self.pores.porosity[owned["material"]] * owned["volume"]
        owned["water_content"] = content * (1.0 + owned["pore_pressure"] / self.pores.bulk_modulus)
        owned["pore_dilation"] = np.ones(len(content))

    def _advance(self, p, dt):
        follow_volume(p, self._sim.scheme.seen_gradient(p), dt)
        if self._sim.rate_independent:
            self.fill_content(p, p.water_content)
            self.exchange(p, p.water_content)
        else:
            self._fill_pressure(p)
            if self.smooths and dt > 0.0:
                self._smooth(p, dt)

    def _smooth(self, p, dt):
        """Exchange water between points that flow."""
        n = p.owned
        smoothing.describe(p, self._stiffness_of(np.arange(n)), dt)
        self._sim.halo.update(p, "share", "smoothing")
        gained = np.zeros(p.total)
        smoothing.exchange(p, self._sim.bonds.pairs, self.weight, gained)
        p.water_content += gained[:n]
        self._fill_pressure(p)
        self.exchange(p, p.water_content)

    def fill_content(self, p, content):
        """Find saturation and `content` (owned,) m^3 that the present pressure makes in the present volume."""
        fill_content(
            p.owned, p.material, self.pores.porosity, p.volume, p.pore_dilation, self.pores.bulk_modulus, self.curves,
            p.pore_pressure, p.saturation, content,
        )  # fmt: skip

    def _fill_pressure(self, p):
        """Find pressure and saturation of the content in the present volume."""
        fill_pressure(
            p.owned, p.material, self.pores.porosity, p.volume, p.pore_dilation, self.pores.bulk_modulus, self.curves,
            p.water_content, p.saturation, p.pore_pressure,
        )  # fmt: skip

    def histories(self) -> dict[str, float]:
        """What is stored, m^3, and the energy of that, J; collective."""
        rows = np.column_stack([self._sim.particles.water_content, self.energies(self._sim.particles)])
        return dict(zip(("water_stored", "water_energy"), exact_sum(self._sim.comm, rows).tolist(), strict=True))

    def energies(self, p) -> np.ndarray:
        """What the water of the owned points stores by pressure and suction, (n,) J, see `stored_energy`."""
        return stored_energy(
            p.material[: p.owned], self.pores.porosity, self.pores.bulk_modulus, self.curves, p.pore_pressure,
            p.pore_dilation, p.volume[: p.owned],
        )  # fmt: skip

    def _stiffness(self, block) -> np.ndarray:
        """What the water of the points adds to the bulk modulus of a block's rows, (n,) Pa: nothing in relaxation."""
        if self._sim.rate_independent:
            return np.zeros(len(block.active))
        return self._stiffness_of(np.asarray(block.first, np.int64))

    def _stiffness_of(self, rows):
        p = self._sim.particles
        return pore_stiffness(
            rows, p.material, self.pores.porosity, self.pores.bulk_modulus, self.curves, self.pores.factors,
            p.pore_pressure, p.pore_dilation,
        )  # fmt: skip


def bonding_column(material) -> int | None:
    """The state column that holds the bonding variable, if the law has one."""
    fields = list(material.state_fields)
    return fields.index(BONDING) if BONDING in fields else None


def bonding_variable(suction, saturation: np.ndarray) -> np.ndarray:
    """xi = f(s) (1 - S), f = 1 + x/(10.7 + 2.4 x), x = suction over atmospheric pressure.

    Gallipoli et al. (2003), with the fit of f by Borja (2004).
    """
    x = suction / ATMOSPHERE
    return (1.0 + x / (10.7 + 2.4 * x)) * (1.0 - saturation)


@kernel
def _close_pores(owned, jacobian, porosity):
    """phi after the volume ratio of this step (eq. 16 is incremental); pores close at 0."""
    for i in range(owned):
        value = 1.0 - (1.0 - porosity[i]) / jacobian[i]
        porosity[i] = 0.0 if value < 0.0 else value


@kernel
def _exchange_water(owned, density, content, grain_mass, mass, velocity, work, dim):
    for i in range(owned):
        wet = grain_mass[i] + density * content[i]
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
