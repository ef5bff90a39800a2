"""Points that leave a box around the scene, or whose law failed, are taken away; what they took along is booked."""

import numpy as np

from periporo.core.numerics.tensors import square_lengths
from periporo.core.points.forces import WORK
from periporo.core.points.particles import Particles

GONE = -1
"""Owner of a point that is taken away."""

LOOK_INTERVAL = 10  # steps

UNITS = {"departed_points": "1", "departed_energy": "J"}
"""What the energy ledger says of them, with units."""


class Departures:
    """The box from `lower` to `upper` (d,) m, in which points stay; infinite where it is open.

    If `failed` are to go, `condemned` are the ids of this rank's points that leave at the next rebuild. `count` points
    have left; `sums` (1 + len(WORK),) J are the kinetic energy that they had, and the work that was done on them.
    """

    def __init__(self, lower: np.ndarray, upper: np.ndarray, failed: bool = False):
        self.lower, self.upper, self.failed = lower, upper, failed
        self.count, self.sums = 0, np.zeros(1 + len(WORK))
        self.condemned = np.empty(0, np.int64)

    def condemn(self, ids: np.ndarray) -> None:
        """Let the points with these ids leave, for their law has failed."""
        if self.failed and len(ids):
            self.condemned = np.union1d(self.condemned, ids)

    def leaving(self, p: Particles) -> np.ndarray:
        """Which owned points leave now, (owned,) bool."""
        gone = self.outside(p)
        return gone | np.isin(p.id[: p.owned], self.condemned) if len(self.condemned) else gone

    def outside(self, p: Particles) -> np.ndarray:
        """Which owned points have left the box, (owned,) bool; one that is nowhere (NaN) has not."""
        x = p.position[: p.owned]
        return np.any((x < self.lower) | (x > self.upper), axis=1)

    def energies(self, p: Particles, leaving: np.ndarray) -> np.ndarray:
        """Kinetic energy and work (n, 1 + len(WORK)) J of the points `leaving` (owned,) bool."""
        kinetic = 0.5 * p.mass[leaving] * square_lengths(np.ascontiguousarray(p.velocity[: p.owned][leaving]))
        return np.concatenate([kinetic[:, None], p.work[leaving]], axis=1)

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        return {"count": self.count, "sums": self.sums.tolist(), "condemned": self.condemned.tolist()}

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        self.count, self.sums = memory["count"], np.array(memory["sums"])
        self.condemned = np.array(memory["condemned"], np.int64)
