"""The force that point fluxes exert along the bonds: conjugate of the points' velocity gradients."""

import numpy as np

from periporo.core.numerics import algebra as la
from periporo.core.numerics import vectors
from periporo.core.numerics.jit import kernel


def add_flux_force(particles, pairs, force: np.ndarray, pull: np.ndarray | None = None) -> None:
    """Add w V_i V_j (B_i + B_j) xi of every pair to `force` (total, d) N, with B the `flux` of its points.

    `pull` (pairs,) N/m times xi is added, too.
    """
    p = particles
    pull = np.empty(0) if pull is None else pull
    _add_flux_force(pairs.first, pairs.second, pairs.weight, p.position, p.volume, p.flux, pull, force, p.dim)


@kernel
def _add_flux_force(first, second, weight, position, volume, flux, pull, force, dim):
    matrix, last, own = la.zero_matrix(dim), -1, vectors.zero(dim)
    for b in range(first.shape[0]):
        if weight[b] == 0.0:
            continue
        i, j = first[b], second[b]
        xi = vectors.difference(position, i, j, dim)
        both = vectors.row(flux, i, matrix) + vectors.row(flux, j, matrix)
        f = vectors.apply(both, xi) * (weight[b] * volume[i] * volume[j])
        if pull.shape[0] > 0:
            f += xi * pull[b]
        last, own = vectors.add_to_ends(force, i, j, f, f * -1.0, last, own)
