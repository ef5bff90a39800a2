"""Sharpened gradients: laws see all of a wave exp(ikx) but a part of fourth order in k.

The gradient L of a point sees the part 1 - a k^2 of the wave, and its mean over the neighbours 1 - b k^2 of that. With
g = a/b laws see M in place of L,

    M_i = (1 + g) L_i - g sum_j w V_j beta_j L_j / N_i,  N_i = sum_j w V_j beta_j,

and from the internal power S_i : M_i follows the conjugate of L_i,

    (1 + g) S_i - sum_j w V_i beta_i g S_j / N_j.

On a grid g = d/(d + 2) (sum w) (sum w |xi|^4) / (sum w |xi|^2)^2. All points have the g of the grid: where neighbours
are few and far, as in a toe that comes apart, the moments of a point's own neighbourhood make g twice as large and the
step smaller, and nowhere do they make waves better.
"""

import itertools

import numpy as np

from periporo.core.correspondence.influence import influence_table, influences
from periporo.core.numerics import algebra as la
from periporo.core.numerics import vectors
from periporo.core.numerics.jit import kernel
from periporo.core.points.particles import Field

_ROW = {2: (0.0,) * 8, 3: (0.0,) * 16}  # columns of the point fields, room for a matrix and N: one vector


def fields(dimension: int) -> tuple[Field, ...]:
    """What points need for it."""
    width = len(_ROW[dimension])
    return (
        Field("weighed", width, "m^3/s, m^3", migrates=False),  # V beta L, V beta
        Field("sharp", width, "1/s, m^3", migrates=False),  # M, N
        Field("spread", dimension**2, "N/m^2", migrates=False),  # g S / N
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
    p, row = particles, _ROW[particles.dimension]
    _weigh(p.volume, p.share, p.gradient, p.weighed, p.dim)
    p.sharp[:] = 0.0
    _sum_neighbours(pairs.first, pairs.second, pairs.weight, p.weighed, p.sharp, row)
    _combine(p.owned, g, p.activity, p.gradient, p.sharp, p.uneven_rate, p.dim)


@kernel
def _weigh(volume, share, gradient, weighed, dim):
    """V beta (L, 1) of all points; the other columns stay zero."""
    for i in range(volume.shape[0]):
        x = volume[i] * share[i, 1]
        la.store(weighed, i, 0, la.scaled(la.matrix_at(gradient, i, 0, dim), x))
        weighed[i, len(dim) * len(dim)] = x


@kernel
def _sum_neighbours(first, second, weight, weighed, sharp, row):
    """Sums of w V beta (L, 1) over the neighbours of each point."""
    last, own = -1, vectors.zero(row)
    for b in range(first.shape[0]):
        w = weight[b]
        if w != 0.0:
            i, j = first[b], second[b]
            of_i, of_j = vectors.row(weighed, i, row) * w, vectors.row(weighed, j, row) * w
            last, own = vectors.add_to_ends(sharp, i, j, of_j, of_i, last, own)


@kernel
def _combine(owned, g, activity, gradient, sharp, uneven_rate, dim):
    """M of the owned points from the sums, and tr L less its mean; M is L where all neighbours are degenerate."""
    d = len(dim)
    n = d * d
    for i in range(owned):
        total = sharp[i, n]
        own = g * (1.0 - activity[i])
        uneven_rate[i] = 0.0
        if total != 0.0:
            for a in range(d):
                uneven_rate[i] += gradient[i, (d + 1) * a] - sharp[i, (d + 1) * a] / total
        for c in range(n):
            sharp[i, c] = gradient[i, c] if total == 0.0 else (1.0 + own) * gradient[i, c] - own / total * sharp[i, c]


@kernel
def spread_stress(point, active, stress, viscous, volume, share, g, activity, sharp, spread, dim):
    """(g S + Q) / N of the points with a row here, S = J V beta sigma and Q = J V beta q I; zero of inactive ones."""
    d = len(dim)
    for r in range(point.shape[0]):
        i = point[r]
        if active[r] and sharp[i, d * d] != 0.0:
            factor = volume[i] * share[i, 2] / sharp[i, d * d]
            sigma = la.full(la.symmetric_at(stress, r, 0, dim))
            la.store(spread, i, 0, la.scaled(sigma, g * (1.0 - activity[i]) * factor))
            for a in range(d):
                spread[i, (d + 1) * a] += factor * viscous[i]
        else:
            la.store(spread, i, 0, la.zero_matrix(dim))
