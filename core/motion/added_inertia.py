"""Selective mass scaling: neighbours that accelerate against each other are given more inertia, bodies as a whole none.

The highest frequencies of a cloud of points, which set the time step, are those at which neighbours move against each
other. A *round* takes a part of their relative acceleration away, by equal and opposite forces,

    f_i += PART sum_j m_ij (a_j - a_i),  m_ij = w V_i V_j min(m_i / sum_k w V_i V_k, m_j / sum_k w V_j V_k),  a = f/m,

so that accelerations become P M^-1 f with P = (I - PART M^-1 L)^rounds. L is symmetric and M^-1 L has eigenvalues from
0 to 2, since sum_j m_ij <= m_i: P M^-1 is symmetric and positive definite, the inverse of a mass matrix as in the
selective mass scaling of Olovsson, Simonsson & Unosson (2005), but without a system to solve. What all neighbours do
alike, free fall for instance, is not changed, and equilibrium (f = 0) is the same. A wave of the number k has its
inertia raised by the part rounds PART k^2 r^2, r^2 = sum w V xi_x^2 / (2 sum w V), the more the nearer it is to the
grid's. Linear momentum is kept to rounding; energy and angular momentum are kept together with those of the added
inertia, which the ledger calls `inertia_energy`.
"""

import numpy as np

from periporo.core.numerics import vectors
from periporo.core.numerics.jit import kernel
from periporo.core.points.particles import Field, vector

PART = 0.45  # below a half, so that the inertia of every motion stays finite

UNITS = {"inertia_energy": "J"}
"""What the energy ledger says of it, with units: kinetic energy of the added inertia."""


class AddedInertia:
    """The force channel `inertia` of so many `rounds`.

    Point fields: `acceleration` (d,) m/s^2 and `coupling`, m_i over the weights of its pairs.
    """

    def __init__(self, rounds: int):
        self.rounds = rounds

    def attach(self, particles, forces) -> None:
        """Declare channel and fields."""
        d = particles.dimension
        forces.need("inertia")
        particles.add_field(Field("acceleration", d, "m/s^2", migrates=False, axes=vector(d)))
        particles.add_field(Field("coupling", None, "1/m^3", migrates=False))

    def add_force(self, sim) -> None:
        """Fill the channel from the others; points that are moved by a prescribed motion are not accelerated."""
        p, n = sim.particles, sim.particles.awake
        p.inertia_force[:] = 0.0
        force = sim.forces.total()[:n]
        for motion in sim.prescribed_motions:
            motion.hold_zero(p, force)
        p.inertia_force[:n] = self.answer(sim, force / p.mass[:n, None]) * p.mass[:n, None] - force

    def answer(self, sim, acceleration: np.ndarray) -> np.ndarray:
        """What becomes of the `acceleration` (awake, d) that forces would give to points by themselves."""
        p, n, pairs = sim.particles, sim.particles.awake, sim.bonds.pairs
        p.acceleration[:n], p.acceleration[n : p.owned] = acceleration, 0.0
        _find_couplings(n, p.mass, p.sums, p.coupling)
        force = np.empty((p.total, p.dimension))
        for k in range(self.rounds):
            sim.halo.update(p, "acceleration", *(("coupling",) if k == 0 else ()))
            force[:] = 0.0
            _couple(pairs.first, pairs.second, pairs.weight, p.volume, p.coupling, p.acceleration, force, p.dim)
            p.acceleration[:n] += PART * force[:n] / p.mass[:n, None]
        return p.acceleration[:n]


@kernel
def _find_couplings(awake, mass, sums, coupling):
    for i in range(awake):
        coupling[i] = mass[i] / sums[i, 0] if sums[i, 0] > 0.0 else 0.0


@kernel
def _couple(first, second, weight, volume, coupling, acceleration, force, dim):
    last, own = -1, vectors.zero(dim)
    for b in range(first.shape[0]):
        if weight[b] != 0.0:
            i, j = first[b], second[b]
            mass = weight[b] * volume[i] * volume[j] * min(coupling[i], coupling[j])
            f = vectors.difference(acceleration, i, j, dim) * mass
            last, own = vectors.add_to_ends(force, i, j, f, f * -1.0, last, own)
