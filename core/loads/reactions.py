"""What boundaries that hold or drive points bear."""

import numpy as np

from periporo.core.numerics.tensors import moments
from periporo.core.ranks.reductions import exact_sums


class BoundaryReactions:
    """Force (N) on boundary conditions, torque (N m) about the places `about` (name -> (d,) m), and power (W).

    In whatever stage they are in force; summed up when they are told.
    """

    def __init__(self, about: dict[str, np.ndarray]):
        self._about = about

    @property
    def units(self) -> dict[str, str]:
        """Units of the histories."""
        units: dict[str, str] = {}
        for name, about in self._about.items():
            axes, turns = "xyz"[: len(about)], ("",) if len(about) == 2 else ("_x", "_y", "_z")
            units |= {f"{name}_force_{a}": "N" for a in axes} | {f"{name}_torque{a}": "N m" for a in turns}
            units |= {f"{name}_power": "W"}
        return units

    def histories(self, sim) -> dict[str, float]:
        """What is told at the end of a step, by history name; collective."""
        p, d = sim.particles, sim.particles.dimension
        empty = np.zeros((0, 4 if d == 2 else 7))
        tables = {name: [empty] for name in self._about}
        for motion in sim.prescribed_motions:
            if motion.name in tables and hasattr(motion, "reactions"):
                rows, force, power = motion.reactions(p, sim.forces)
                torque = moments(p.position[rows] - self._about[motion.name], force)
                tables[motion.name].append(np.column_stack([-force, -torque, power]))
        sums = exact_sums(sim.comm, [np.concatenate(t) for t in tables.values()])
        return dict(zip(self.units, np.concatenate(sums).tolist(), strict=True))
