"""Work of the soil on its water, for the ledger of a scene that asks for it.

Forces are linear in the stress, so those of the pore stress pi = p_f - chi p do a part of the internal work. By the
conjugate rows f . v = -sum_r c_r pi_r tr L_r, at one and the same configuration: exactly so in the second half of a
step, while the first half has the forces of the places before it and wants their gradients at the new velocity, which
nothing else needs, and which take a pass over all pairs. In place of it the mean stress of a step works on its change
of volume,

    W = sum_r 1/2 (pi_0 + pi_1) c_r tr(de) (1 - tr(de)/2),

c_r the volume at the end. This differs from the work of the forces by terms of second order in the step.
"""

import numpy as np

from periporo.core.points.particles import Field

FIELD = Field("water_work", None, "J", sent=False)


def add_work(p, bonds, before: np.ndarray) -> None:
    """Add to `water_work` that of the step, `before` (total,) Pa the pore stress at its start."""
    for block in bonds.blocks:
        rows = np.flatnonzero(block.active)
        index, first, second, _ = bonds.layout.holders(block, bonds.pairs)
        stress = 0.25 * sum(before[end] + p.pore_stress[end] for end in (first[index[rows]], second[index[rows]]))
        strain = block.strain_increment[rows, :3].sum(axis=1)
        work = bonds.layout.volumes(block, bonds.pairs, p, rows) * stress * strain * (1.0 - 0.5 * strain)
        bonds.book(p, block, rows, work, p.water_work)
