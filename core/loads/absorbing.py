"""Boundaries that let waves out: dashpots of the impedance of the ground beyond (Lysmer & Kuhlemeyer 1969).

What travels against the normal of a boundary with velocity v is met by the stress -Z v that the ground beyond would
have, Z = rho V_p along the normal and rho V_s across it: nothing comes back at normal incidence. A wave that comes from
beyond with velocity v_in doubles its stress: -Z (v - 2 v_in) (Joyner & Chen 1975). What the boundary has held when it
begins to absorb, the weight of the soil for instance, it goes on to hold.
"""

from collections.abc import Callable

import numpy as np

from periporo.core.points.forces import ForceChannels
from periporo.core.points.particles import Field, Particles
from periporo.core.ranks.reductions import exact_sum, maximum

_FACE = 2.5  # what a point's mass is over that of its face: 1.5^2 + 0.5^2, of the two rows that move it


class Absorbing:
    """Dashpots of `area` m^(d-1) each on faces of the points `ids` (sorted), at `lever` (d,) m along an axis.

    `incoming` maps an axis to the velocity (m/s) of the wave that comes from beyond, a function of time and time step.
    The ground `beyond` has a density (kg/m^3), bulk and shear modulus (Pa); None: those of the points. The force goes
    to the channel `external`.
    """

    def __init__(
        self, name: str, ids: np.ndarray, lever: np.ndarray, area: float,
        incoming: dict[int, Callable[[float, float], float]], beyond: tuple[float, float, float] | None = None,
    ):  # fmt: skip
        self.name, self.ids, self.lever, self.area, self.incoming = name, ids, lever, area, incoming
        self._beyond = None if beyond is None else impedance(*beyond)
        self.normal = int(np.flatnonzero(lever)[0])
        self.held = f"absorbing_{name}"
        self._impedance: np.ndarray | None = None
        self.damping_rate = 0.0  # 1/s, at which the lightest face comes to rest
        self._takes_over = False  # whether it has found out what there was to hold
        self._found: tuple[np.ndarray, np.ndarray] | None = None  # ids of the points, and the rows among them

    @property
    def end(self) -> float:
        """When (s) the last of the histories of what comes in ends; 0 of none."""
        return max((getattr(function, "end", 0.0) for function in self.incoming.values()), default=0.0)

    def attach(self, p: Particles, forces: ForceChannels) -> None:
        """Declare what each point holds (N), and with which impedance (kg/m^(d+1)/s, along and across the normal)."""
        if self.held not in p.fields:  # stages that follow each other have the same
            p.add_field(Field(self.held, p.dimension, "N", sent=False))
        forces.need("external", on_faces=True)

    def begin(self, sim, before: list) -> None:
        """Begin to absorb after a stage with the loads `before`; collective."""
        p = sim.particles
        self._impedance = impedances(sim) if self._beyond is None else np.tile(self._beyond, (len(sim.materials), 1))
        rows = self._rows(p)
        rates = self.area * self._impedance[p.material[rows]].max(axis=1) / p.mass[rows]
        self.damping_rate = _FACE * maximum(sim.comm, float(rates.max(initial=0.0)))
        if any(isinstance(load, Absorbing) and load.name == self.name for load in before):
            return
        held = getattr(p, self.held)
        held[:] = 0.0
        held[rows] = -sim.forces.total()[rows]
        for other in sim.loads:  # at a corner the first has it all
            if isinstance(other, Absorbing) and other is not self and other._takes_over:
                held[rows] -= getattr(p, other.held)[rows]
        self._takes_over = True

    def add_force(self, p: Particles, time: float, dt: float) -> None:
        """Add to the external force; velocities are those of the middle of the step."""
        if self._impedance is None:
            return
        rows, d = self._rows(p), p.dimension
        lever = p.share[rows, 1:2] * self.lever  # `periporo.core.points.faces`
        velocity = p.velocity[rows] + (p.gradient[rows].reshape(-1, d, d) * lever[:, None, :]).sum(axis=2)
        for axis, function in self.incoming.items():
            velocity[:, axis] -= 2.0 * function(time - 0.5 * dt, dt) if dt > 0.0 else 0.0
        resistance = self._impedance[p.material[rows]]  # along and across the normal
        each = np.repeat(resistance[:, 1:], d, axis=1)
        each[:, self.normal] = resistance[:, 0]
        push = -self.area * each * velocity
        p.external_force[rows] += getattr(p, self.held)[rows] + push
        p.external_moment[rows] += (push[:, :, None] * lever[:, None, :]).reshape(-1, d * d)

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        impedance = None if self._impedance is None else self._impedance.tolist()
        return {"impedance": impedance, "damping_rate": self.damping_rate}

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        self._impedance = None if memory["impedance"] is None else np.array(memory["impedance"])
        self.damping_rate = memory["damping_rate"]

    def _rows(self, p):
        if self._found is None or self._found[0] is not p.id:
            self._found = p.id, np.flatnonzero(np.isin(p.id[: p.owned], self.ids, assume_unique=True))
        return self._found[1]


def impedances(sim) -> np.ndarray:
    """rho V_p and rho V_s (materials, 2) kg/m^2/s of the mean moduli of each material's rows at present; collective."""
    found = np.zeros((len(sim.materials), 2))
    for block in sim.bonds.blocks:
        bulk, shear = (moduli[block.active] for moduli in block.elastic_moduli())
        index, first, _, _ = sim.bonds.layout.holders(block, sim.bonds.pairs)
        mine = first[index][block.active] < sim.particles.owned
        ones = np.ones(int(mine.sum()))
        count, bulk_sum, shear_sum = exact_sum(sim.comm, np.stack([ones, bulk[mine], shear[mine]], axis=1))
        if count:
            found[block.index] = impedance(block.material.density, bulk_sum / count, shear_sum / count)
    return found


def impedance(density: float, bulk: float, shear: float) -> np.ndarray:
    """rho V_p and rho V_s (2,) kg/m^2/s of ground of that density (kg/m^3), with these moduli (Pa)."""
    return np.sqrt(density * np.array([bulk + 4.0 / 3.0 * shear, shear]))
