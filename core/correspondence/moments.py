"""Moments of the points' neighbourhoods, on which every scheme is built: shape tensor and velocity gradient."""

import numpy as np

from periporo.core.correspondence.influence import influence
from periporo.core.numerics import algebra as la
from periporo.core.numerics import vectors
from periporo.core.numerics.algebra import LANES
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.numerics.vectors import WIDTH

DEGENERATE, REGULAR = 0.01, 0.05  # of the width of a neighbourhood, squared, over the horizon squared


def update_neighbourhoods(particles, pairs, horizon: float, table: np.ndarray, dt: float) -> tuple[int, int]:
    """Weights of the pairs, and what every scheme needs of the owned points, over the step `dt` that ends here.

    Returns how many pairs crossed the horizon since their weights were last found, and how many points are
    degenerate.
    """
    p = particles
    p.clear(p.sums)
    crossed = _sum_moments(
        pairs.first, pairs.second, pairs.weight, pairs.count, p.position, p.velocity, p.volume, p.widths(), horizon,
        table, p.sums, p.dim,
    )  # fmt: skip
    degenerate = _close_points(
        p.awake, dt, horizon, p.volume, pairs.count, p.sums, p.dilation, p.share, p.shape_inverse, p.gradient,
        p.jacobian, p.dim,
    )  # fmt: skip
    return crossed, degenerate


@inlined
def integrity_of(square_width, horizon):
    """beta of a neighbourhood: 1 if it is wide, 0 if it is degenerate, quadratic in between.

    The square of the width is the harmonic mean of the eigenvalues of K/W: small where neighbours do not span space,
    or are a lump much smaller than the horizon. What a velocity does to the gradient grows like one over the width,
    and with it the frequency of the point; without a fade a few lumps would set the time step of the whole scene. The
    corner of a lattice has .08 or more, its inside .1 to .2, with any influence function and m = 2 to 3.
    """
    wide = (square_width / (horizon * horizon) - DEGENERATE) / (REGULAR - DEGENERATE)
    return min(wide, 1.0) ** 2 if wide > 0.0 else 0.0


@kernel
def _sum_moments(first, second, weight, count, position, velocity, volume, width, horizon, table, sums, dim):
    """Weight of each pair, neighbour counts, and V_i times W, K and the velocity moment of both ends added to `sums`.

    Pairs are worked on by the tile: their ends are looked up one by one, their weights found in vectors, and the
    terms added one by one again, which keeps the order. Rings weigh by the root of their volumes
    (`periporo.core.correspondence.hoop`). Returns how many pairs crossed the horizon.
    """
    crossed = 0
    terms = np.zeros(LANES * WIDTH)
    terms[::WIDTH] = 1.0
    square, factor, rings = np.zeros(LANES), np.zeros(LANES), np.ones(LANES)
    last, own = -1, vectors.moments(terms, 0, dim)
    for start in range(0, first.shape[0], LANES):
        used = min(LANES, first.shape[0] - start)
        for k in range(used):
            i, j = first[start + k], second[start + k]
            xi = vectors.difference(position, i, j, dim)
            vectors.put_at(terms, WIDTH * k + 1, xi)
            vectors.put_at(terms, WIDTH * k + 1 + len(dim), vectors.difference(velocity, i, j, dim))
            square[k] = vectors.dot(xi, xi)
            factor[k] = volume[i] * volume[j]
            if width.shape[0] > 0:
                rings[k] = 1.0 / np.sqrt(width[i] * width[j])
        for k in range(LANES):  # all of them, in vectors, so that a pair's bits do not depend on its lane
            square[k] = influence(1.0 - np.sqrt(square[k]) / horizon, table) * rings[k]
            factor[k] *= square[k]
        before, tile_crossed = weight[start : start + used], 0
        for k in range(used):
            tile_crossed += (square[k] > 0.0) != (before[k] > 0.0)
        if tile_crossed:
            crossed += tile_crossed
            for k in range(used):
                change = (square[k] > 0.0) - (before[k] > 0.0)
                count[first[start + k]] += change
                count[second[start + k]] += change
        for k in range(used):
            before[k] = square[k]
        for k in range(used):
            if square[k] > 0.0:
                i, j = first[start + k], second[start + k]
                term = vectors.moments(terms, k, dim) * factor[k]
                last, own = vectors.add_to_ends(sums, i, j, term, term, last, own)
    return crossed


@kernel
def _close_points(owned, dt, horizon, volume, count, sums, dilation, share, shape_inverse, gradient, jacobian, dim):
    """Share, integrity, inverse shape tensor, velocity gradient and volume ratio of the owned points.

    A share counts the volume that its point has at the end of this step. Were it the volume of the step before, a
    part of the force would lag behind the motion and feed vibrations, in proportion to dt and stress. The weights
    w V inside the sums only divide, and keep the initial volumes. Returns how many points are degenerate.
    """
    degenerate = 0
    d = len(dim)
    n_shape = d * (d + 1) // 2
    fewest = 3 if d == 2 else 5
    for i in range(owned):
        inverse, _ = la.inverse_shape(la.shape_at(sums, i, 1, dim))
        trace = la.trace_shape(inverse)
        integrity = 0.0
        if count[i] >= fewest and trace > 0.0:
            integrity = integrity_of(d / (trace * sums[i, 0]), horizon)
        if integrity > 0.0:
            g = la.times_shape(la.matrix_at(sums, i, 1 + n_shape, dim), inverse)
            for c in range(n_shape):
                shape_inverse[i, c] = volume[i] * inverse[c]
            for c in range(d * d):
                gradient[i, c] = g[c]
            jacobian[i] = 1.0 / la.determinant_minus(la.scaled(g, dt))
            share[i, 2] = integrity * dilation[i] * jacobian[i]
            share[i, 0] = share[i, 2] * volume[i] / sums[i, 0]
        else:
            degenerate += 1
            share[i, 0] = share[i, 2] = 0.0
            for c in range(n_shape):
                shape_inverse[i, c] = 0.0
            for c in range(d * d):
                gradient[i, c] = 0.0
            jacobian[i] = 1.0
        share[i, 1] = integrity
    return degenerate
