"""Sharpened gradients: laws see all of a wave exp(ikx) but a part of fourth order in k.

The gradient L of a point sees the part 1 - a k^2 of the wave, and its mean over the neighbours 1 - b k^2 of that. With
g = a/b laws see M in place of L,

    M_i = L_i + g U_i,  U_i = sum_j (c_ij/2) (L_i - L_j) / (J_i beta_i V_i),

where c_ij is the volume of the pair that links count with, and from the internal power sum_i S_i : M_i,
S_i = J_i beta_i V_i sigma_i, follows the conjugate of L_i,

    S_i + sum_j (c_ij/2) (g sigma_i - g sigma_j).

As c is symmetric, a uniform stress exerts the forces that it would exert without sharpening, at surfaces too. Bulk
viscosity q of a flow (`periporo.core.correspondence.regularity`) works on tr U and is conjugate to it in the same way.
On a grid g = d/(d + 2) (sum w) (sum w |xi|^4) / (sum w |xi|^2)^2. All points have the g of the grid, which fades with
their activity in a flow: where neighbours are few and far, as in a toe that comes apart, the moments of a point's own
neighbourhood make g twice as large and the step smaller, and nowhere do they make waves better.
"""

import itertools

import numpy as np

from periporo.core.correspondence.influence import influence_table, influences
from periporo.core.numerics import algebra as la
from periporo.core.numerics import vectors
from periporo.core.numerics.jit import kernel
from periporo.core.points.particles import Field


def fields(dimension: int) -> tuple[Field, ...]:
    """What points need for it."""
    return (
        Field("sharp", dimension**2, "1/s", migrates=False),  # M
        Field("seen", dimension**2, "Pa", migrates=False),  # g sigma + q I, as neighbours see it
    )


def factor(dimension: int, m: float, influence_name: str) -> float:
    """g of a grid whose points interact up to `m` spacings."""
    n = int(m)
    offsets = np.array(list(itertools.product(range(-n, n + 1), repeat=dimension)), float)
    r = np.sqrt((offsets**2).sum(axis=1))
    r = r[(r > 0.0) & (r < m)]
    table = influence_table(influence_name)
    w = influences(1.0 - r / m, table)
    return dimension / (dimension + 2.0) * w.sum() * (w * r**4).sum() / (w * r**2).sum() ** 2


def sharpen(particles, pairs, g: float) -> None:
    """Find M of the owned points from L of these and of the ghosts; in flowing soil g fades with the activity."""
    p = particles
    p.sharp[:] = 0.0
    _sum_differences(pairs.first, pairs.second, pairs.weight, p.volume, p.share, p.gradient, p.sharp, p.dim)
    _combine(p.awake, g, p.activity, p.volume, p.share, p.gradient, p.sharp, p.uneven_rate, p.dim)


@kernel
def _sum_differences(first, second, weight, volume, share, gradient, sums, dim):
    """Sums of (c/2) (L_i - L_j) over the neighbours of each point."""
    matrix, last, own = la.zero_matrix(dim), -1, vectors.zero(la.zero_matrix(dim))
    for b in range(first.shape[0]):
        w = weight[b]
        if w != 0.0:
            i, j = first[b], second[b]
            half = 0.5 * w * volume[i] * volume[j] * (share[i, 0] * share[j, 1] + share[j, 0] * share[i, 1])
            to_j = (vectors.row(gradient, j, matrix) - vectors.row(gradient, i, matrix)) * half
            last, own = vectors.add_to_ends(sums, i, j, to_j * -1.0, to_j, last, own)


@kernel
def _combine(owned, g, activity, volume, share, gradient, sharp, uneven_rate, dim):
    """M of the owned points, and tr U, from the sums; zero, as L, of degenerate ones."""
    d = len(dim)
    for i in range(owned):
        own = volume[i] * share[i, 2]
        over = 1.0 / own if own > 0.0 else 0.0
        uneven_rate[i] = 0.0
        for a in range(d):
            uneven_rate[i] += over * sharp[i, (d + 1) * a]
        for c in range(d * d):
            sharp[i, c] = gradient[i, c] + g * (1.0 - activity[i]) * over * sharp[i, c]


@kernel
def show_stress(point, active, stress, viscous, g, activity, seen, dim):
    """g sigma + q I of the points with a row here; zero of inactive ones."""
    d = len(dim)
    for r in range(point.shape[0]):
        i = point[r]
        if active[r]:
            sigma = la.full(la.symmetric_at(stress, r, 0, dim))
            la.store(seen, i, 0, la.scaled(sigma, g * (1.0 - activity[i])))
            for a in range(d):
                seen[i, (d + 1) * a] += viscous[i]
        else:
            la.store(seen, i, 0, la.zero_matrix(dim))
