"""The force that point fluxes exert along the bonds: conjugate of the points' velocity gradients.

A flux begins as Z_i, what is conjugate to L_i: of stress, and, with the opposite sign, of the moments R (x) d of loads
that act on a point's face (`periporo.core.points.faces`). It is closed to B_i = Z_i K_i^-1 / V_i, of which forces are
made.
"""

import numpy as np

from periporo.core.numerics import algebra as la
from periporo.core.numerics import vectors
from periporo.core.numerics.jit import kernel


def begin_flux(particles, moment: np.ndarray | None) -> None:
    """Fill the flux of the points with what balances the `moment` (at least awake, d^2) N m of loads; zero without any.

    That of points that sleep is held.
    """
    p = particles
    p.flux[p.owned :] = 0.0
    if moment is None:
        p.flux[: p.awake] = 0.0
    else:
        np.negative(moment[: p.awake], out=p.flux[: p.awake])


def close_flux(particles) -> None:
    """From Z to B of the owned points."""
    p = particles
    _close_flux(p.owned, p.volume, p.shape_inverse, p.flux, p.dim)


@kernel
def _close_flux(owned, volume, shape_inverse, flux, dim):
    for i in range(owned):
        z = la.scaled(la.matrix_at(flux, i, 0, dim), 1.0 / volume[i])
        la.store(flux, i, 0, la.times_shape(z, la.shape_at(shape_inverse, i, 0, dim)))


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
