"""A length for softening: the strain that softens a point is shared with all within that length.

A law names by `averaged` a state column and a length R. What the law adds to the column in a step, e, is shared after
it: e_i + m sum_j V_j w(x_ij) (e_j - e_i) counts at point i, with w = c (1 - r^2/R^2)^2 whose integral over space is 1.
The weight is symmetric, so that nothing is lost or won, and what is uniform stays (Borino, Failla & Parrinello 2003,
eq. 22). A plain average, m = 1, would let strain gather on a line of points whatever the length; m = 2 gives bands a
width (Vermeer & Brinkgreve 1994). Increments are shared, not sums: soil that comes near later has its own past.
"""

import math

import numpy as np

from periporo.core.numerics.jit import kernel
from periporo.core.points.material import Material, state_column
from periporo.core.points.neighbours import find_pairs
from periporo.core.points.particles import Field

FEWEST = 2.0
"""Spacings in a length: with fewer the sum over points is not the integral."""

_OVER = 2.0
_MARGIN = 1.0 + 1e-9  # pairs are listed a bit farther, whatever the rounding


def averaged(material: Material) -> tuple[str, float] | None:
    """The state column that a law wants averaged, and over which length (m); None if it does not."""
    return getattr(material, "averaged", None)


class NonlocalStrain:
    """Shares the softening strain of the points of each material that has a length; schemes with a row for each point.

    The fields are what a point has counted so far, and what it adds in a step. Points that sleep take no part.
    """

    output: tuple[str, ...] = ()

    def attach(self, sim) -> None:
        """Declare the fields; points of other ranks are needed as far as the longest length."""
        self._sim, self._listed = sim, -1
        self._pairs: list[np.ndarray] = []
        found = [(k, averaged(m)) for k, m in enumerate(sim.materials)]
        self._wanted = [(k, *what) for k, what in found if what is not None]
        sim.particles.add_field(Field("counted_strain", None, "1", sent=False))
        sim.particles.add_field(Field("strain_to_share", None, "1", migrates=False))
        longest = max(length for *_, length in self._wanted)
        sim.reaches.append(lambda owned: (longest + sim.skin) * _MARGIN)

    def update(self, p, bonds, dt: float) -> None:
        """Share what the laws have added in this step."""
        if self._listed != self._sim.rebuild_count:
            self._list_pairs(p)
        rows = []
        for number, name, _ in self._wanted:
            block, column = bonds.blocks[number], state_column(self._sim.materials[number], name, p.components)
            points = block.first.astype(np.int64)
            p.strain_to_share[points] = block.state[:, column] - p.counted_strain[points]
            rows.append((block, column, points))
        self._sim.halo.update(p, "strain_to_share")
        for (block, column, points), pairs, (*_, length) in zip(rows, self._pairs, self._wanted, strict=True):
            gain = np.zeros(p.total)
            factor = _OVER * (3.0 / math.pi / length**2 if p.dimension == 2 else 105.0 / (32.0 * math.pi) / length**3)
            _share(*pairs, p.position, p.volume, p.strain_to_share, length, factor, gain, p.dim)
            block.state[:, column] = np.maximum(block.state[:, column] + gain[points], 0.0)
            p.counted_strain[points] = block.state[:, column]

    def _list_pairs(self, p) -> None:
        asleep = p.asleep != 0 if "asleep" in p.fields else None
        self._pairs = [
            find_pairs(p, np.flatnonzero(p.material == k), p.group, (length + self._sim.skin) * _MARGIN, asleep=asleep)
            for k, _, length in self._wanted
        ]
        self._listed = self._sim.rebuild_count


@kernel
def _share(first, second, position, volume, strain, length, factor, gain, dim):
    """Add to `gain` what points get from each other; pairs stand in the order of ids, so that sums have one order."""
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        difference = strain[j] - strain[i]
        if difference == 0.0:
            continue
        square = 0.0
        for a in range(len(dim)):
            square += (position[j, a] - position[i, a]) ** 2
        far = square / (length * length)
        if far < 1.0:
            flow = factor * (1.0 - far) ** 2 * difference
            gain[i] += volume[j] * flow
            gain[j] -= volume[i] * flow
