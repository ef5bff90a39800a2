"""Points that move alike: sides of a column of ground that goes on beyond them and is shaken from below."""

import numpy as np

from periporo.core.loads.boundary import Motion
from periporo.core.points.forces import INTEGRATION, PRESCRIBED
from periporo.core.points.particles import Particles


class Tied(Motion):
    """Points of the same `group` have the velocity of their common centre of mass along the axes `ids` names.

    `ids` maps an axis to the sorted ids of the points that are tied along it, `groups` to the number of each one's
    group. The forces that tie a group add up to nothing and do no work; all ranks take part in `apply`.
    """

    def __init__(self, comm, ids: dict[int, np.ndarray], groups: dict[int, np.ndarray], name: str = ""):
        self._comm, self.ids, self._groups, self.name = comm, ids, groups, name
        self._found: tuple = (None, {})

    def beside(self, motions: list) -> "Tied":
        """The same without points that one of the prescribed `motions` has along an axis."""
        ids, groups = {}, {}
        for axis, own in self.ids.items():
            taken = [m.ids for m in motions if axis in getattr(m, "velocities", ())]
            left = ~np.isin(own, np.concatenate([np.empty(0, np.int64), *taken]))
            ids[axis], groups[axis] = own[left], self._groups[axis][left]
        return Tied(self._comm, ids, groups, self.name)

    def foresee(self, p: Particles, time: float, dt: float, velocity: np.ndarray) -> None:
        """See `Motion.foresee`: about as fast as they are."""

    def apply(self, p: Particles, time: float, dt: float, closing_step: bool) -> None:
        """Impose the mean velocities: after the first kick, or the second (`closing_step`)."""
        for axis, (rows, group) in self._rows(p).items():
            kicked, before, mass = p.velocity[rows, axis], p.previous_velocity[rows, axis], p.mass[rows]
            imposed = self._means(p.id[rows], group, mass, kicked)
            half_step = before if closing_step else imposed
            p.work[rows, PRESCRIBED] += mass * (imposed - kicked) * half_step
            if closing_step:  # what the kick has booked, or the drift will
                p.work[rows, INTEGRATION] += 0.5 * mass * ((imposed - before) ** 2 - (kicked - before) ** 2)
            p.velocity[rows, axis] = imposed

    def hold_zero(self, p: Particles, free: np.ndarray) -> None:
        """Set the tied components of `free` (owned, d) to zero."""
        for axis, (rows, _) in self._rows(p).items():
            free[rows, axis] = 0.0

    def _means(self, ids, group, mass, velocity):
        """Velocity (n,) of each own point's group, summed in the order of ids whatever rank has them."""
        mine = np.stack([ids.astype(float), group.astype(float), mass, mass * velocity], axis=1)
        table = np.concatenate(self._comm.allgather(mine))
        table = table[np.argsort(table[:, 0], kind="stable")]
        groups = table[:, 1].astype(np.int64)
        count = int(groups.max(initial=-1)) + 1
        masses = np.bincount(groups, weights=table[:, 2], minlength=count)
        momenta = np.bincount(groups, weights=table[:, 3], minlength=count)
        return momenta[group] / masses[group]

    def _rows(self, p):
        """By axis, owned rows and their groups; found anew when a rebuild has moved them."""
        if self._found[0] is not p.id:
            own, found = p.id[: p.owned], {}
            for axis, ids in self.ids.items():
                rows = np.flatnonzero(np.isin(own, ids, assume_unique=True))
                found[axis] = rows, self._groups[axis][np.searchsorted(ids, own[rows])]
            self._found = p.id, found
        return self._found[1]
