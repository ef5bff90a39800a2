"""Sub-horizon correspondence as published: Menon & Song 2022, eqs 22-33 and 51-58.

The sub-families are those of `periporo.core.correspondence.sub_horizon`, but the stress of a bond acts on that bond
alone, in proportion to the volume of its sub-family:

    T_ij = phi_ij w_ij sigma_ij K_ij^-1 xi_ij,  phi_ij = sum_{k in H_ij} V_k / sum_{k in H_i} V_k.

This is not the conjugate of the strain: sum_j T_ij (x) xi_ij V_j is not the stress, the elastic operator is not
symmetric, and free motion grows without bound. Angular momentum is not conserved. The scheme is here to
reproduce the publication; `docs/explanation/schemes/` has the evidence.
"""

import numpy as np

from periporo.core.correspondence.sub_horizon import SubHorizon
from periporo.core.numerics import algebra as la
from periporo.core.numerics.jit import kernel


class SubHorizonPublished(SubHorizon):
    """The scheme's two halves of a step: strain from velocity, force from stress."""

    name = "sub_horizon_published"

    def __init__(self, horizon: float, influence_name: str, *, self_point: bool = True, average_ends: bool = True):
        """`horizon` m; `influence_name` one of `influence.NAMES`.

        `self_point` counts a point in its own horizon and sub-horizons (eq. 1), which matters in phi only;
        `average_ends` gives both ends of a bond the mean of their gradients (eq. 58).
        """
        super().__init__(horizon, influence_name)
        self.self_point = self_point
        self.average_ends = average_ends

    def _share_volume(self, p, pairs, block, sub_family_volume):
        _volume_fractions(
            block.start, block.pair, block.second, pairs.weight, p.volume, p.share, block.integrity,
            sub_family_volume, self.self_point, block.fraction,
        )  # fmt: skip

    def _combine_ends(self, p, bonds, halo):
        if not self.average_ends:
            return
        sides = np.zeros((len(bonds.pairs.first), 2, 1 + p.dimension**2))
        for block in bonds.blocks:
            sides[block.pair, block.side - 1, 0] = block.integrity
            sides[block.pair, block.side - 1, 1:] = block.gradient
        self.exchange(p, bonds.pairs, halo, sides)
        for block in bonds.blocks:
            _average_gradients(block.pair, block.integrity, sides, block.gradient)

    def _fill_force_states(self, p, pairs, block, states):
        _fill_states(
            block.first, block.second, block.pair, block.side, block.active, pairs.weight, p.position, block.fraction,
            block.total_stress, block.shape_inverse, states, p.dim,
        )  # fmt: skip


@kernel
def _volume_fractions(
    start, pair, second, weight, volume, share, integrity, sub_family_volume, self_point, fraction
):
    """J_i phi_ij, faded out where point or sub-family are degenerate."""
    for i in range(start.shape[0] - 1):
        own = volume[i] if self_point else 0.0
        whole = own
        for r in range(start[i], start[i + 1]):
            if weight[pair[r]] > 0.0:
                whole += volume[second[r]]
        for r in range(start[i], start[i + 1]):
            fraction[r] = 0.0
            if integrity[r] > 0.0:
                fraction[r] = share[i, 2] * integrity[r] * (own + sub_family_volume[r]) / whole


@kernel
def _average_gradients(pair, integrity, sides, gradient):
    """Mean of both ends' gradients; a degenerate sub-family has no say."""
    for r in range(pair.shape[0]):
        if integrity[r] > 0.0:
            b = pair[r]
            one, other = sides[b, 0, 0], sides[b, 1, 0]
            for c in range(gradient.shape[1]):
                gradient[r, c] = (one * sides[b, 0, 1 + c] + other * sides[b, 1, 1 + c]) / (one + other)


@kernel
def _fill_states(
    first, second, pair, side, active, weight, position, fraction, stress, shape_inverse, states, dim
):
    """T_ij of every row, as the side of its pair."""
    for r in range(pair.shape[0]):
        if active[r]:
            s = la.scaled(la.full(la.symmetric_at(stress, r, 0, dim)), fraction[r] * weight[pair[r]])
            s = la.times_shape(s, la.shape_at(shape_inverse, r, 0, dim))
            t = la.apply(s, la.difference(position, first[r], second[r], dim))
            for a in range(len(dim)):
                states[pair[r], side[r] - 1, a] = t[a]
