"""Steps that take no point too far and strain none too much, however fast it is."""

import numpy as np

from periporo.core.motion.integrator import first_kick, take_back_kick
from periporo.core.numerics import algebra as la
from periporo.core.numerics.jit import kernel
from periporo.core.ranks.reductions import maxima, maximum

LONGEST_WAY = 0.1
"""Spacings that a point moves in a step, at most."""
LARGEST_STRAIN = 0.1
"""Strain of a row in a step, at most."""
_HURRY = 0.2  # of the longest way: from there on a step looks before it is taken
_SHARPER = 3.0  # strain of a row over the largest of its points' pairs
_CLOSE = 0.5  # spacings below which a pair says no more of the strain
_MARGIN = 0.9  # for the kick of a shorter step is another one


def kick_within(sim, dt: float) -> float:
    """Kick velocities to the middle of a step of `dt` (s), or of a shorter one; its length, s; collective.

    `Simulation.fastest` m/s of the step before says whether a look is worth its while.
    """
    p, longest = sim.particles, LONGEST_WAY * sim.spacing
    first_kick(p, sim.forces, dt)
    while sim.fastest * dt > _HURRY * longest:
        speed, rate = maxima(sim.comm, _look_ahead(sim, dt)).tolist()
        haste = max(speed / longest, _SHARPER * rate / LARGEST_STRAIN)
        if not haste * dt > 1.0:
            break
        take_back_kick(p)
        dt = _MARGIN / haste
        first_kick(p, sim.forces, dt)
    return dt


def longest_approach(sim) -> float:
    """Longest step (s) for what soon meets obstacles or other bodies, and strains as fast as it come near; collective.

    If it were shortened when they push already, what velocity Verlet lent to the motion in the longer one would stay.
    """
    closing = [contact.closing for contact in sim.contacts if hasattr(contact, "closing")]
    if not closing:
        return np.inf
    rate = maximum(sim.comm, max(closing)) / sim.spacing
    return _MARGIN * LARGEST_STRAIN / (_SHARPER * rate) if rate > 0.0 else np.inf


def _look_ahead(sim, dt):
    """Largest speed (m/s) of this rank's points in a step of `dt`, and strain rate (1/s) of their pairs; collective."""
    p, n = sim.particles, sim.particles.owned
    kicked = p.velocity[:n].copy()
    for motion in sim.prescribed_motions:
        motion.foresee(p, sim.time + dt / 2, dt, p.velocity[:n])
    sim.halo.update(p, "velocity")
    squares, pairs = np.zeros(2), sim.bonds.pairs
    _find_largest(
        n, pairs.first, pairs.second, pairs.weight, p.share, p.position, p.velocity, (_CLOSE * sim.spacing) ** 2,
        squares, p.dim,
    )  # fmt: skip
    p.velocity[:n] = kicked
    return np.sqrt(squares)


@kernel
def _find_largest(owned, first, second, weight, share, position, velocity, close, squares, dim):
    """Largest squares of the speed of a point, and of the relative speed of regular neighbours over their distance."""
    for i in range(owned):
        square = 0.0
        for a in range(len(dim)):
            square += velocity[i, a] ** 2
        squares[0] = max(squares[0], square)
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        if weight[b] > 0.0 and share[i, 1] > 0.0 and share[j, 1] > 0.0:
            xi, change = la.difference(position, i, j, dim), la.difference(velocity, i, j, dim)
            squares[1] = max(squares[1], la.dot(change, change) / max(la.dot(xi, xi), close))
