"""Points at rest: they keep position and stress, and cost nothing, until something near them changes.

A point is *quiet* while it is slower than a bound. It falls asleep when it, and all points within two steps of
`_REACH` horizons of it, have been quiet for a number of steps. Then its velocity is zero, and what it contributes to
the forces on its neighbours stays as it is: its flux B, the stress and the share that they see; its gradient L is zero.
So the kinematics of the points that are awake are those of the whole body with the others held, forces remain their
conjugate, and the elastic operator remains symmetric and positive semi-definite. Pairs of two sleepers are not listed,
and the rows of sleepers are set aside (`periporo.core.bonds.blocks.Rows.resting`).

A sleeper wakes when a point within the same two steps is faster than twice the bound, when the loads on it have changed
so much that they would give it that speed in the time that it takes to fall asleep, or when a motion or an obstacle is
to move it, and with it all within twice as many steps of what wakes it: a wave would otherwise have neighbours found
anew at each look. A signal takes longer over two steps than there is between two looks.

The kinetic energy that is taken away is booked. Who sleeps follows from fields of the points alone, at looks that come
every `LOOK_INTERVAL` steps, so that it depends neither on ranks nor on checkpoints.
"""

import numpy as np

from periporo.core.motion.rebuilds import rebuild
from periporo.core.numerics import vectors
from periporo.core.numerics.jit import kernel
from periporo.core.numerics.tensors import square_lengths
from periporo.core.points.neighbours import near
from periporo.core.points.particles import Field
from periporo.core.ranks.reductions import exact_sum

LOOK_INTERVAL = 5  # steps
_REACH = 0.92  # horizons: the points within it are known on every rank, also when neighbours are to be found anew
_WAKENED = 4  # of these steps around what wakes others, so that it takes the signal some looks to reach sleepers again
_LOUD = 2.0  # bounds, above which a point wakes others
_FEW = 0.02  # of the points that are awake: for fewer it does not pay to find neighbours anew
_KEPT = ("share", "flux", "link", "seen", "flow")  # what a sleeper's neighbours see of it

UNITS = {"set_aside_energy": "J", "asleep": "1"}
"""What the energy ledger says of them, with units: kinetic energy that was taken away, share of points asleep."""


class Sleep:
    """Lets points sleep that have been slower than `speed` (m/s) for `steps`, with all of their neighbourhood.

    `set_aside` J is the kinetic energy that was taken from points that fell asleep, `share` the part of all points that
    sleep. Point fields: `asleep` is 0 for a point that is awake, 1 from when it fell asleep until its loads are known,
    then 2; `quiet` counts looks; `guard` is 1 for points that were close to sleepers when neighbours were found, and
    for sleepers that were close to others.
    """

    def __init__(self, speed: float, steps: int):
        self.speed, self.steps = speed, steps
        self._looks = max(steps // LOOK_INTERVAL, 1)
        self.set_aside, self.share = 0.0, 0.0
        self._kept: list[str] = []
        self._all_woke = False

    def attach(self, p) -> None:
        """Declare the point fields."""
        d = p.dimension
        p.add_field(Field("asleep", None, "", dtype=np.int64))
        p.add_field(Field("quiet", None, "", sent=False, dtype=np.int64))
        p.add_field(Field("guard", None, "", sent=False, dtype=np.int64))
        p.add_field(Field("held_flux", d * d, "Pa/m^5", sent=False))
        p.add_field(Field("held_load", d, "N", sent=False))
        p.add_field(Field("disturbed", None, "1", migrates=False))
        self._kept = [name for name in _KEPT if name in p.fields]
        for name in self._kept:
            p.keep(name)

    def look(self, sim) -> bool:
        """Count quiet points; whether one must wake, or enough can sleep, for neighbours to be found anew; collective.
        """
        if sim.step_number % LOOK_INTERVAL or not _allows(sim):
            return False
        p, n, awake = sim.particles, sim.particles.owned, sim.particles.awake
        slow = square_lengths(p.velocity[:awake]) <= self.speed**2
        p.quiet[:awake] = np.where(slow, p.quiet[:awake] + 1, 0)
        fell = np.flatnonzero(p.asleep[:n] == 1)
        if len(fell):
            p.held_load[fell], p.asleep[fell] = sum(load[fell] for load in _loads(sim)), 2
        wakes = self.share > 0.0 and bool((self._loud(sim) & ((p.guard != 0) | (p.asleep[:n] != 0))).any())
        if sim.step_number % (LOOK_INTERVAL * self._looks) == 0:
            tired = int((self._calm(sim) & (p.asleep[:n] == 0)).sum())
            tired, awake = sim.comm.allreduce(np.array([tired, p.awake])).tolist()
            return wakes or tired > _FEW * awake
        return wakes

    def decide(self, sim) -> bool:
        """Wake points and let others fall asleep, before neighbours are found anew; whether any does; collective."""
        if not _allows(sim) or self._all_woke:
            woke, self._all_woke = self._all_woke, False
            return woke
        p, n = sim.particles, sim.particles.owned
        before = p.asleep[:n] != 0
        after = self._calm(sim)
        if self.share > 0.0:
            after = np.where(before, ~self._around(sim, self._loud(sim), _WAKENED), after)
        p.quiet[before & ~after] = 0
        p.guard[:] = np.where(after, self._around(sim, ~after), self._around(sim, after))
        self._lay_down(sim, np.flatnonzero(after & ~before))
        p.asleep[:n] = np.where(after, np.maximum(p.asleep[:n], 1), 0)
        sim.halo.update(p, "asleep")
        counts = np.array([int(after.sum()), n, int((after & ~before).sum()), int((before & ~after).sum())])
        asleep, total, fell, woke = sim.comm.allreduce(counts).tolist()
        self.share = asleep / max(total, 1)
        if woke:
            sim.time_step.expire()  # which those that are awake have set
        return fell + woke > 0

    def wake_all(self, sim) -> None:
        """Wake every point, at the start of a stage: its conditions are others; collective."""
        sim.particles.quiet[:] = 0
        if self.share == 0.0:
            return
        sim.particles.asleep[:] = 0
        self.share, self._all_woke = 0.0, True
        rebuild(sim)
        sim.find_shapes()

    def put_back(self, p, halo, owned: dict[str, np.ndarray]) -> None:
        """Set what neighbours see of the points to what it was when the fields `owned` were taken down."""
        for name in self._kept:
            getattr(p, name)[: p.owned] = owned[name]
        halo.update(p, *self._kept)

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        return {"set_aside": self.set_aside, "share": self.share}

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        self.set_aside, self.share = memory["set_aside"], memory["share"]

    def _lay_down(self, sim, rows) -> None:
        """Take the velocity of the owned `rows`, and keep what their neighbours see of them."""
        p = sim.particles
        kinetic = 0.5 * p.mass[rows] * square_lengths(p.velocity[rows])
        self.set_aside += float(exact_sum(sim.comm, kinetic)[0])
        p.velocity[rows] = 0.0
        p.held_flux[rows] = p.flux[rows]
        if "flow" in p.fields:
            sim.scheme.stop_flow(p, rows)

    def _calm(self, sim) -> np.ndarray:
        """Which owned points may sleep: with all around them they have been quiet for long enough, or sleep already."""
        p, n = sim.particles, sim.particles.owned
        return ~self._around(sim, ((p.quiet < self._looks) & (p.asleep[:n] == 0)) | _moved_by_others(sim))

    def _loud(self, sim) -> np.ndarray:
        """Which owned points wake others: they are fast, or moved from outside, or sleep no more under their load."""
        p, loud = sim.particles, np.empty(sim.particles.owned, np.bool_)
        _find_loud(
            p.awake, p.velocity, p.asleep, _loads(sim), p.held_load, p.mass, _LOUD * self.speed, self.steps * sim.dt,
            loud, p.dim,
        )  # fmt: skip
        return loud | _moved_by_others(sim)

    def _around(self, sim, chosen, steps: int = 2) -> np.ndarray:
        """Which owned points are the `chosen` (owned,), or within `steps` of `_REACH` horizons of one; collective."""
        p = sim.particles
        sim.halo.update(p, "position")
        for _ in range(steps):
            p.disturbed[: p.owned] = chosen
            sim.halo.update(p, "disturbed")
            chosen = near(p, p.disturbed != 0.0, _REACH * sim.scheme.horizon)
        return chosen


def _allows(sim) -> bool:
    """Whether points may sleep in the present stage."""
    return bool(sim.stages) and sim.stages[sim.stage_number].sleeps


def _loads(sim) -> tuple[np.ndarray, ...]:
    """What loads and contacts exert on the points, arrays (total, d) N."""
    names = [name for name in sim.forces.names if name not in ("internal", "damping", "inertia")]
    return tuple(getattr(sim.particles, f"{name}_force") for name in names)


@kernel
def _find_loud(awake, velocity, asleep, loads, held, mass, speed, time, loud, dim):
    """Points that are faster than `speed`, or would be in the `time` by what loads have changed; NaN is loud."""
    for i in range(loud.shape[0]):
        if i < awake:
            v = vectors.row(velocity, i, dim)
            loud[i] = not vectors.dot(v, v) <= speed * speed
            continue
        change = vectors.zero(dim) - vectors.row(held, i, dim)
        for load in loads:
            change += vectors.row(load, i, dim)
        loud[i] = asleep[i] == 2 and not np.sqrt(vectors.dot(change, change)) * time <= speed * mass[i]


def _moved_by_others(sim) -> np.ndarray:
    """Which owned points (owned,) a prescribed motion moves, or is to move, or an obstacle that moves may touch."""
    p, n = sim.particles, sim.particles.owned
    moved = np.zeros(n, np.bool_)
    for motion in sim.prescribed_motions:
        velocity, free = np.zeros((n, p.dimension)), np.ones((n, p.dimension))
        motion.foresee(p, sim.time + 0.5 * sim.dt, sim.dt, velocity)
        if motion.end > sim.time:
            motion.hold_zero(p, free)
        moved |= velocity.any(axis=1) | ~free.all(axis=1)
    for contact in sim.contacts:
        if getattr(contact, "motion", None) is not None:
            moved[contact.within_reach(p)] = True
    return moved
