"""The energy ledger: work of every force on every point, step by step.

In velocity Verlet the kinetic energy changes by the half-step work of all forces plus m dt^2/8 (|a_1|^2 - |a_0|^2),
exactly. Each point accumulates the work of each channel, and that last term, so that sums over points close to
rounding whatever the forces are, also with prescribed motion and a varying time step.

A load on a face (`periporo.core.points.faces`) acts in part through the internal force. What its moment does in half a
step is taken from the internal work and given to the load's channel, so that each has the work of its own.
"""

from collections.abc import Iterable

import numpy as np
from mpi4py import MPI

from periporo.core.motion.sleep import Sleep
from periporo.core.numerics.jit import kernel
from periporo.core.numerics.tensors import square_lengths
from periporo.core.points.departures import Departures
from periporo.core.points.forces import FLOW_WORK, WORK
from periporo.core.points.particles import Particles
from periporo.core.ranks.reductions import exact_sum

OBSTACLES = {"obstacle_work": "J"}
"""What the ledger says of obstacles that move, with units."""


class Ledger:
    """Energies of the whole scene in J, the same for any number of ranks."""

    def __init__(
        self, comm, particles: Particles, initial_kinetic: float | None = None, departures: Departures | None = None,
        sleep: Sleep | None = None, reactions: Iterable = (),
    ):  # fmt: skip
        """`initial_kinetic` J, the present one if not given.

        `departures` of a scene that points may leave, `sleep` of one where they may; `reactions` with a `work` (2,) J
        that moving obstacles gave to points through contact and friction.
        """
        self.departures, self.sleep = departures, sleep
        self._obstacles = [r for r in reactions if getattr(r, "motion", None) is not None]
        self._comm = comm
        self._particles = particles
        self.initial_kinetic = self.kinetic() if initial_kinetic is None else initial_kinetic

    def kinetic(self) -> float:
        """Kinetic energy."""
        p = self._particles
        v = p.velocity[: p.owned]
        return float(exact_sum(self._comm, 0.5 * p.mass * square_lengths(v))[0])

    def entries(self) -> dict[str, float]:
        """Energies and work since the start, with the residual of the balance.

        `energy_residual` is what kinetic energy gained beyond all work: it equals `integration_term`, the
        integrator's own and known error, up to rounding.
        """
        p = self._particles
        v = p.velocity[: p.owned]
        kinetic = 0.5 * p.mass * square_lengths(v)
        entries = self._named(exact_sum(self._comm, np.concatenate([kinetic[:, None], p.work], axis=1)))
        if "plastic_dissipation" in p.fields:  # a part of the internal energy that its laws report
            entries["plastic_dissipation"] = float(exact_sum(self._comm, p.plastic_dissipation)[0])
        if "water_work" in p.fields:  # a part of the internal energy, where a scene asks for it
            entries["water_work"] = float(exact_sum(self._comm, p.water_work)[0])
        if "flow_work" in p.fields:  # parts of the internal energy, and what the ledger's forces did not see
            entries |= zip(FLOW_WORK, exact_sum(self._comm, p.flow_work).tolist(), strict=True)
        return entries

    def rough_entries(self) -> dict[str, float]:
        """As `entries` by plain sums: much quicker, but the last digits depend on the ranks."""
        p = self._particles
        sums = np.zeros(1 + len(WORK))
        _sum_energies(p.owned, p.mass, p.velocity, p.work, sums, p.dim)
        self._comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        return self._named(sums)

    def _named(self, sums):
        """Entries of sums over the points that are there; work on those that have left counts on."""
        left, gone = self.departures, {}
        if left is not None:
            gone = {"departed_points": left.count, "departed_energy": float(left.sums[0])}
        total = sums if left is None else sums + left.sums
        work = dict(zip(WORK, total[1:].tolist(), strict=True))
        gained = float(total[0]) - self.initial_kinetic
        if self.sleep is not None:
            gained += self.sleep.set_aside
            gone |= {"set_aside_energy": self.sleep.set_aside, "asleep": self.sleep.share}
        given = np.zeros(2) + sum(r.work for r in self._obstacles)
        if self._obstacles:
            gone |= dict.fromkeys(OBSTACLES, float(given.sum()))
        return {
            "kinetic_energy": float(sums[0]),
            "internal_energy": -work["internal"],
            "external_work": work["external"],
            "contact_energy": float(given[0]) - work["contact"],
            "friction_dissipation": float(given[1]) - work["friction"],
            "damping_dissipation": -work["damping"],
            "prescribed_work": work["prescribed"],
            "integration_term": work["integration"],
            "energy_residual": gained - sum(w for name, w in work.items() if name != "integration"),
            **({"inertia_energy": -work["inertia"]} if "inertia_force" in self._particles.fields else {}),
            **gone,
        }


@kernel
def _sum_energies(owned, mass, velocity, work, sums, dim):
    for i in range(owned):
        square = 0.0
        for a in range(len(dim)):
            square += velocity[i, a] ** 2
        sums[0] += 0.5 * mass[i] * square
        for c in range(work.shape[1]):
            sums[1 + c] += work[i, c]
