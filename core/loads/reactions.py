"""What boundaries that hold or drive points bear."""

import numpy as np

from periporo.core.ranks.reductions import exact_sum


class BoundaryReaction:
    """Force (N) on a boundary condition, and torque (N m) about the place `about` (d,) m; power (W) that it gives.

    In whatever stage it is in force; summed up when it is told.
    """

    def __init__(self, name: str, about: np.ndarray):
        self.name, self.about = name, np.asarray(about, float)

    @property
    def units(self) -> dict[str, str]:
        """Units of the histories."""
        d = len(self.about)
        axes, turns = "xyz"[:d], ("",) if d == 2 else ("_x", "_y", "_z")
        return (
            {f"{self.name}_force_{a}": "N" for a in axes} | {f"{self.name}_torque{a}": "N m" for a in turns}
            | {f"{self.name}_power": "W"}
        )  # fmt: skip

    def histories(self, sim) -> dict[str, float]:
        """What is told at the end of a step, by history name; collective."""
        p, d = sim.particles, len(self.about)
        table = [np.zeros((0, len(self.units)))]
        for motion in sim.prescribed_motions:
            if motion.name == self.name:
                rows, force, power = motion.reactions(p, sim.forces)
                arm = p.position[rows] - self.about
                pairs = [(0, 1)] if d == 2 else [(1, 2), (2, 0), (0, 1)]
                torque = [arm[:, a] * force[:, b] - arm[:, b] * force[:, a] for a, b in pairs]
                table.append(np.column_stack([-force, *(-t for t in torque), power]))
        return dict(zip(self.units, exact_sum(sim.comm, np.concatenate(table)).tolist(), strict=True))
