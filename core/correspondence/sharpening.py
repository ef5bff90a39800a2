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
neighbourhood make g twice as large and the step smaller, and nowhere do they make waves better. A point that has
flowed far is not on a grid any more: there g would only raise the highest frequencies, and does not come back.
"""

import itertools

import numpy as np

from periporo.core.correspondence.influence import influence_table, influences
from periporo.core.numerics import algebra as la
from periporo.core.numerics import vectors
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.points.particles import Field, matrix

ORDERED, DISORDERED = 0.1, 0.3  # shear strain of flow, up to which points are on a grid, and beyond which on none

_STIFFER = 0.35  # what sharpening adds to the highest frequency of a grid


def fields(dimension: int) -> tuple[Field, ...]:
    """What points need for it."""
    return (
        Field("sharp", dimension**2, "1/s", migrates=False, axes=matrix(dimension)),  # M
        # g sigma + q I, as neighbours see it
        Field("seen", dimension**2, "Pa", migrates=False, axes=matrix(dimension)),
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
    """Find M of the owned points from L of these and of the ghosts; in soil that flows, or has flowed far, g fades."""
    p = particles
    p.clear(p.sharp)
    asks = np.zeros(p.total, np.bool_)
    _find_asking(p.awake, p.activity, p.flowed, asks)
    _sum_differences(pairs.first, pairs.second, pairs.weight, p.volume, p.share, p.gradient, asks, p.sharp, p.dim)
    _combine(p.awake, g, asks, p.activity, p.flowed, p.volume, p.share, p.gradient, p.sharp, p.uneven_rate, p.dim)


@inlined
def sharpness_of(activity, flowed):
    """The part of g that is left to a point with this activity, which has flowed by that shear strain."""
    return (1.0 - activity) * min(max((DISORDERED - flowed) / (DISORDERED - ORDERED), 0.0), 1.0)


@kernel
def _find_asking(owned, activity, flowed, asks):
    """Which points have use for U: not those that have flowed, and rest."""
    for i in range(owned):
        asks[i] = activity[i] > 0.0 or sharpness_of(activity[i], flowed[i]) > 0.0


@kernel
def _sum_differences(first, second, weight, volume, share, gradient, asks, sums, dim):
    """Sums of (c/2) (L_i - L_j) over the neighbours of each point that asks."""
    matrix, last, own = la.zero_matrix(dim), -1, vectors.zero(la.zero_matrix(dim))
    for b in range(first.shape[0]):
        w, i, j = weight[b], first[b], second[b]
        if w != 0.0 and (asks[i] or asks[j]):
            half = 0.5 * w * volume[i] * volume[j] * (share[i, 0] * share[j, 1] + share[j, 0] * share[i, 1])
            to_j = (vectors.row(gradient, j, matrix) - vectors.row(gradient, i, matrix)) * half
            last, own = vectors.add_to_ends(sums, i, j, to_j * -1.0, to_j, last, own)


@kernel
def _combine(owned, g, asks, activity, flowed, volume, share, gradient, sharp, uneven_rate, dim):
    """M of the owned points, and tr U, from the sums; zero, as L, of degenerate ones."""
    d = len(dim)
    for i in range(owned):
        own = volume[i] * share[i, 2]
        over = 1.0 / own if own > 0.0 else 0.0
        uneven_rate[i] = 0.0
        if not asks[i]:
            for c in range(d * d):
                sharp[i, c] = gradient[i, c]
            continue
        sharpness = sharpness_of(activity[i], flowed[i])
        for a in range(d):
            uneven_rate[i] += over * sharp[i, (d + 1) * a]
        for c in range(d * d):
            sharp[i, c] = gradient[i, c] + g * sharpness * over * sharp[i, c]


def softening(particles, points) -> np.ndarray:
    """About which part of the stiffness of a grid to its highest mode the `points` (n,) have."""
    p, found = particles, np.empty(len(points))
    _find_softening(points, p.activity, p.flowed, found)
    return found


@kernel
def _find_softening(points, activity, flowed, found):
    for r in range(points.shape[0]):
        sharpness = sharpness_of(activity[points[r]], flowed[points[r]])
        found[r] = ((1.0 + _STIFFER * sharpness) / (1.0 + _STIFFER)) ** 2


@kernel
def show_stress(point, active, stress, viscous, g, activity, flowed, seen, dim):
    """g sigma + q I of the points with a row here; zero of inactive ones."""
    d = len(dim)
    for r in range(point.shape[0]):
        i = point[r]
        if active[r]:
            sigma = la.full(la.symmetric_at(stress, r, 0, dim))
            la.store(seen, i, 0, la.scaled(sigma, g * sharpness_of(activity[i], flowed[i])))
            for a in range(d):
                seen[i, (d + 1) * a] += viscous[i]
        else:
            la.store(seen, i, 0, la.zero_matrix(dim))
