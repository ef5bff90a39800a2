"""Soft repulsion of points that come too close.

Shear along a row of points makes neighbours drift together: nothing in the bond's stress, which is at its yield
limit, holds them apart. Close pairs add nothing but stiffness, and so cost time step. A conservative spring that
acts below a fraction of the spacing keeps them apart; it is soft compared with the material, but not compared
with the stress of a flow.
"""

import numpy as np

from periporo.core.numerics import algebra as la
from periporo.core.numerics.algebra import LANES
from periporo.core.numerics.jit import kernel
from periporo.core.points.forces import ForceChannels
from periporo.core.points.particles import Particles


class Repulsion:
    """Spring of `stiffness` N/m between points closer than `distance` m; its energy counts as contact.

    `closest` is the influence at that distance: pairs of a smaller weight are further apart and cost nothing.
    """

    damping = 0.0  # share of critical damping

    def __init__(self, pairs, *, distance: float, stiffness: float, closest: float):
        self.pairs = pairs
        self.distance = distance
        self.stiffness = stiffness
        self.closest = closest

    def attach(self, p: Particles, forces: ForceChannels) -> None:
        """Declare the force channel."""
        forces.need("contact")

    def appear(self, p: Particles, time: float, before: list | None) -> None:
        """Begin to act: nothing to be done."""

    def add_force(self, p: Particles, time: float, dt: float) -> None:
        """Add the repulsion of all pairs."""
        width = p.widths()  # rings have other weights
        _repel(
            self.pairs.first, self.pairs.second, self.pairs.weight, 0.0 if len(width) else self.closest, p.position,
            self.distance, self.stiffness, width, p.contact_force, p.dim,
        )  # fmt: skip

    def add_stiffness(self, p: Particles, time: float, ahead: float, stiffness) -> None:
        """Nothing: the spring is too soft to matter for the time step."""

    def will_push(self, p: Particles, time: float, until: float) -> bool:
        """Nothing that moves by itself."""
        return False

    def resist(self, p: Particles, dt: float, force, moment) -> None:
        """Nothing, as above."""


@kernel
def _repel(first, second, weight, closest, position, distance, stiffness, width, force, dim):
    for start in range(0, first.shape[0], LANES):
        tile = weight[start : start + LANES]
        near = 0
        for k in range(tile.shape[0]):  # in vectors: most tiles have no close pair
            near += 0 if tile[k] < closest else 1
        if near == 0:
            continue
        for b in range(start, start + tile.shape[0]):
            if weight[b] < closest:
                continue
            i, j = first[b], second[b]
            xi = la.difference(position, i, j, dim)
            r = np.sqrt(la.dot(xi, xi))
            if not r < distance:
                continue
            both = 0.5 * (width[i] + width[j]) if width.shape[0] > 0 else 1.0
            pull = both * stiffness * (distance - r) / max(r, 1e-3 * distance)
            for a in range(len(dim)):
                force[i, a] -= pull * xi[a]
                force[j, a] += pull * xi[a]
