"""A stable time step from the present stiffness.

The highest frequency of the whole scene comes from a few Lanczos iterations of the scheme's own elastic
operator: that is exact but costs some steps. In between it is followed by a local estimate for every point,
its bonds taken as springs, omega_i^2 = lambda_max(sum_b 2 c_b/r_b^2 [mu I + (K + mu/3) n n]) / m_i, which tells
at once when points come close or stiffen. Its ratio to the exact value is measured again when it has changed,
and every few hundred steps, since a point in a nearly degenerate neighbourhood is stiffer than its springs; while the
ratio stays the same it is measured less and less often.

Viscosity of the soil shortens the step as a stiffness would: with the damping C of velocities half a step earlier, a
step h is stable while dt^2/4 K + dt/2 C <= M holds for all dt <= h, which K + (2/h) C tells. Both frequencies are of
that, with the activity that the soil has and the limit h of the look before. If the limit falls, C counts more.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from periporo.core.motion.pace import longest_approach
from periporo.core.numerics import algebra as la
from periporo.core.numerics.elasticity import add_elastic
from periporo.core.numerics.jit import kernel
from periporo.core.numerics.random_numbers import uniform
from periporo.core.ranks.reductions import inner, maximum
from periporo.errors import InputError, Problem

_MOST_ITERATIONS = 12  # of Lanczos
_CONVERGED = 2e-3  # relative change of the frequency in one of them
_DAMPED = 0.97  # of the limit of damped steps
_DRIFT = 0.1  # relative change of the local estimate after which the ratio is measured again
_OFTEN, _SELDOM = 200, 800  # steps after which it is measured again in any case
_LONGER = 1.2  # step over the one before, from which on the next look comes early
_NEVER = 2**62
_STEADY = 0.02  # relative change of the ratio up to which it is measured less often
_SCRATCHED = ("velocity", "jacobian", "tilt", "viscous_stress")  # fields of points that keep their values
_HELD = ("seen", "held_flux")  # what points that sleep add to forces, whatever moves
_REMEMBERED = ("ratio", "reduction", "_calibrated_at", "_calibrated_in", "_pause", "_local", "_again", "_limit")


class StableTimeStep:
    """Chooses the time step: `safety` times the stability limit 2/omega, or a `fixed` one."""

    def __init__(self, safety: float, fixed: float | None, interval: int):
        self.safety = safety
        self.fixed = fixed
        self.interval = interval
        self.ratio = 1.0  # exact over local frequency
        self.reduction = 1.0  # after a failure the run is careful for a while
        self._calibrated_at = 0.0
        self._calibrated_in = 0  # step
        self._pause = _OFTEN  # steps
        self._local = 0.0  # frequency when the step was last chosen
        self._again = _NEVER  # step by which it is chosen anew in any case
        self._limit = 0.0  # s, of stability, when the step was last chosen

    def due(self, step: int) -> bool:
        """Whether the step is to be chosen anew."""
        return self.fixed is None and (step % self.interval == 0 or step >= self._again)

    def expire(self) -> None:
        """Have the step chosen anew, for what sets it is another."""
        self._again = 0

    def choose(self, sim) -> float:
        """The time step (s) for the present configuration."""
        if self.fixed is not None:
            return self.fixed * self.reduction
        if sim.sleep is not None and sim.sleep.share == 1.0:
            return sim.dt
        _stiffen_contacts(sim)
        flows = sim.scheme.viscosity > 0.0 and any(block.flows for block in sim.bonds.blocks)
        before = self._limit if flows else 0.0
        local = local_frequency(sim, sim.contacts, self.interval * sim.dt, before)
        grows = local > (1.0 + _DRIFT) * self._local and self._local > 0.0
        self._local, self._again = local, sim.step_number + max(1, self.interval // 4 if grows else self.interval)
        drifted = not abs(local - self._calibrated_at) <= _DRIFT * self._calibrated_at
        if drifted or sim.step_number >= self._calibrated_in + self._pause:
            exact = highest_frequency(sim, before)
            ratio, self.ratio = self.ratio, exact / local if local > 0.0 and exact > 0.0 else 1.0
            steady = not drifted and abs(self.ratio - ratio) <= _STEADY * ratio
            self._pause = min(2 * self._pause, _SELDOM) if steady else _OFTEN
            self._calibrated_at, self._calibrated_in = local, sim.step_number
        if local == 0.0 and sim.dt > 0.0:
            return sim.dt  # every point flies freely: go on as before
        if local == 0.0:
            message = "no point has a bond or a contact, so nothing limits the step; give a fixed one"
            raise InputError("scene", [Problem(("time_step", "fixed"), message)])
        bodies = (c.frequency(sim.comm, sim.particles, sim.time, self.interval * sim.dt) for c in sim.contacts
                  if hasattr(c, "frequency"))  # fmt: skip
        frequency = math.hypot(self.ratio * local, max(bodies, default=0.0))
        self._limit = 2.0 / frequency
        if self._limit < before:
            self._limit *= self._limit / before
        step = min(self.safety, damped_limit(sim, frequency)) * self._limit
        step = self.reduction * min(step, longest_approach(sim))
        if step > _LONGER * sim.dt > 0.0:  # contacts were looked for in as many steps of the length before
            self._again = min(self._again, sim.step_number + max(1, int(self.interval * sim.dt / step)))
        return step

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        return {name: getattr(self, name) for name in _REMEMBERED}

    def recall(self, memory: dict) -> None:
        """Set it back."""
        for name in _REMEMBERED:
            setattr(self, name, memory[name])


def _stiffen_contacts(sim) -> None:
    """Let contacts whose stiffness is that of the soil follow its present one, where a law's moduli may change."""
    following = [contact for contact in sim.contacts if getattr(contact, "modulus", None) is not None]
    changing = [block for block in sim.bonds.blocks if not block.keeps_all]
    if not following or not changing:
        return
    largest = maximum(sim.comm, max(block.stiffest(block.elastic_moduli()) for block in changing))
    for contact in following:
        contact.follow(sim.particles, largest)


def damped_limit(sim, frequency: float) -> float:
    """Longest step over 2/`frequency` (rad/s) with the dampings of contacts and loads.

    It is a bit below sqrt(1 + zeta^2) - zeta, zeta being the largest share of critical damping. The damping force is
    that of the velocity half a step earlier, so it shortens the step. Infinite without any.
    """
    zeta = max([0.0, *(float(np.max(contact.damping)) for contact in sim.contacts)])
    rates = [load.damping_rate for load in sim.loads if hasattr(load, "damping_rate")]
    zeta = max([zeta, *(0.5 * rate / frequency for rate in rates)])
    return _DAMPED * (math.sqrt(1.0 + zeta * zeta) - zeta) if zeta > 0.0 else math.inf


def local_frequency(sim, contacts, ahead: float = 0.0, limit: float = 0.0) -> float:
    """Largest of the points' own frequency estimates from bonds and `contacts`, rad/s.

    A contact counts if it acts, or may within the time `ahead` (s); viscosity counts for steps of up to `limit` s, if
    that is not 0.
    """
    p = sim.particles
    springs, stiffness = local_stiffness(sim, contacts, ahead, limit)
    return float(np.sqrt(maximum(sim.comm, _largest_square_frequency(p.awake, springs, stiffness, p.mass, p.dim))))


def local_stiffness(sim, contacts, ahead: float = 0.0, limit: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """N/m of the points, their bonds taken as springs (total, 3|6), and their `contacts` (owned,)."""
    p = sim.particles
    springs = np.zeros((p.total, p.dimension * (p.dimension + 1) // 2))
    for block in sim.bonds.blocks:
        sim.scheme.add_springs(p, sim.bonds, block, *block.stiffness(), limit, springs)
    stiffness = np.zeros(p.owned)
    for contact in contacts:
        contact.add_stiffness(p, sim.time, ahead, stiffness)
    return springs, stiffness


def highest_frequency(sim, limit: float = 0.0) -> float:
    """Highest frequency of the elastic operator of all bonds and contacts by Lanczos iteration, rad/s.

    The moduli are those of the present stress and state. These, and what points carry, are put aside meanwhile; nothing
    of the simulation changes. It starts from random numbers everywhere: where points look stiffest by themselves, the
    highest mode often is not, and an iteration that starts there finds a lower one. With a `limit` (s) it is that of a
    step of this length with the present viscosity.
    """
    p, n = sim.particles, sim.particles.awake
    with held(sim):
        root_mass = np.sqrt(p.mass[:n])[:, None]
        vector = uniform(p.id[:n], p.dimension, seed=1) - 0.5
        partner = _partner(sim, vector, root_mass)
        previous, beta = np.zeros_like(vector), 0.0
        diagonal: list[float] = []
        beside: list[float] = []
        value = 0.0
        norm = np.sqrt(inner(sim.comm, vector, partner))
        if norm == 0.0:  # all points have left
            return 0.0
        vector, partner = _divided(vector, partner, norm)
        for _ in range(_MOST_ITERATIONS):
            image = apply_stiffness(sim, partner / root_mass, limit) / root_mass
            diagonal.append(inner(sim.comm, partner, image))
            before, value = value, _largest_eigenvalue(diagonal, beside)
            image -= diagonal[-1] * vector + beta * previous
            partner = _partner(sim, image, root_mass)
            previous, beta = vector, np.sqrt(inner(sim.comm, image, partner))
            if value - before <= 2.0 * _CONVERGED * value or not beta > 1e-6 * abs(diagonal[0]):
                break
            vector, partner = _divided(image, partner, beta)
            beside.append(beta)
    return math.sqrt(max(value, 0.0))


def _partner(sim, vector, root_mass):
    """The motion (awake, d) that a force `vector` calls forth, both scaled by `root_mass`: itself, if none is added.

    Lanczos iteration is in the product of the two, in which the elastic operator is symmetric with added inertia, too.
    """
    return vector if sim.added_inertia is None else sim.added_inertia.answer(sim, vector / root_mass) * root_mass


def _divided(vector, partner, norm):
    """Both over `norm`; one array if they are one."""
    quotient = vector / norm
    return quotient, quotient if partner is vector else partner / norm


@contextmanager
def held(sim) -> Iterator[None]:
    """Within it the moduli are those of the present, and stress, state and points may be tried with.

    Contacts hold what they hold now, or may soon with the present velocities.
    """
    p = sim.particles
    for contact in sim.contacts:
        contact.add_stiffness(p, sim.time, sim.time_step.interval * sim.dt, np.zeros(p.owned))
    for block in sim.bonds.blocks:
        block.held_moduli = block.elastic_moduli()
    kept = [(r.stress.copy(), r.state.copy(), r.active.copy()) for r in sim.bonds.carriers]
    totals = [b.total for b in sim.bonds.blocks]
    still = _HELD if "asleep" in p.fields else ()
    points = {name: getattr(p, name).copy() for name in (*_SCRATCHED, *still) if name in p.fields}
    for name in points.keys() & still:
        getattr(p, name)[:] = 0.0
    sim.bonds.tries = True
    yield
    sim.bonds.tries = False
    for rows, (stress, state, active) in zip(sim.bonds.carriers, kept, strict=True):
        rows.stress[:], rows.state[:], rows.active[:] = stress, state, active
    for block, total in zip(sim.bonds.blocks, totals, strict=True):
        block.total, block.held_moduli = total, None
    for name, values in points.items():
        getattr(p, name)[:] = values


def _largest_eigenvalue(diagonal, beside):
    """Of the symmetric tridiagonal matrix with these entries; NaN stays."""
    matrix = np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1)
    return float(np.linalg.eigvalsh(matrix)[-1]) if np.isfinite(matrix).all() else np.nan


def apply_stiffness(sim, displacement, limit: float = 0.0):
    """Elastic force (awake, d) that a small displacement calls forth, by the production kernels and contacts.

    With that of the scheme's viscosity, if there is a `limit` (s), when it happens in half of it.
    """
    p = sim.particles
    size = maximum(sim.comm, float(np.abs(displacement).max(initial=0.0)))
    dt = 1e-15 * sim.spacing / size  # small enough to be linear
    p.velocity[: p.awake] = displacement
    sim.halo.update(p, "velocity")
    for rows in sim.bonds.carriers:
        rows.stress[:] = 0.0
    for block in sim.bonds.blocks:
        block.total = None
    sim.scheme.deform(p, sim.bonds, sim.halo, dt, dt)
    for block in sim.bonds.blocks:
        bulk, shear = block.stiffness()
        _add_elastic(bulk, shear, block.stress, block.strain_increment)
    if limit > 0.0:
        sim.scheme.resist(p, sim.bonds, sim.halo, 2.0 / limit)
    force, held = np.zeros((2, p.total, p.dimension))
    moment = np.zeros((p.owned, p.dimension**2))
    for contact in sim.contacts:
        contact.resist(p, dt, held, moment)
    sim.scheme.internal_force(p, sim.bonds, sim.halo, force, moment if sim.forces.on_faces else None)
    force += held
    force /= -dt
    return force[: p.awake]


@kernel
def _add_elastic(bulk, shear, stress, strain_increment):
    for r in range(stress.shape[0]):
        add_elastic(bulk[r], shear[r], r, stress, strain_increment)


@kernel
def _largest_square_frequency(owned, springs, stiffness, mass, dim):
    largest = 0.0
    for i in range(owned):
        value = (la.largest_eigenvalue(la.shape_at(springs, i, 0, dim)) + stiffness[i]) / mass[i]
        if value > largest or np.isnan(value):  # and stays: nothing is larger than NaN
            largest = value
    return largest
