"""Moments of the points' neighbourhoods, on which every scheme is built: shape tensor and velocity gradient."""

import numpy as np

from periporo.core import algebra as la
from periporo.core.correspondence.influence import influence
from periporo.core.jit import inlined, kernel

DEGENERATE, REGULAR = 0.01, 0.1  # of det K / (tr K / d)^d


@inlined
def inverse_and_regularity(k):
    """Inverse of a shape tensor, and det K / (tr K / d)^d: 1 if it is isotropic, 0 if it does not span space."""
    d = 2 if len(k) == 3 else 3
    inverse, determinant = la.inverse_shape(k)
    mean = la.trace_shape(k) / d
    return inverse, determinant / mean**d if mean > 0.0 else 0.0


@inlined
def integrity_of(regularity):
    """beta: 1 in a regular neighbourhood, 0 in a degenerate one, quadratic in between.

    The stiffness of a gradient grows like one over the regularity; beta falls faster, so that a point which
    leaves its neighbours never becomes stiffer than those that stay.
    """
    if not regularity > DEGENERATE:
        return 0.0
    return min((regularity - DEGENERATE) / (REGULAR - DEGENERATE), 1.0) ** 2


@kernel
def sum_moments(first, second, weight, position, velocity, volume, horizon, table, sums, dim):
    """Weight of each pair; neighbour count, W, K and the velocity moment of both ends in `sums`.

    Returns how many pairs crossed the horizon since their weights were last found.
    """
    sums[:] = 0.0
    crossed = 0
    n_shape = len(dim) * (len(dim) + 1) // 2
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        xi = la.difference(position, i, j, dim)
        r2 = la.dot(xi, xi)
        if not r2 < horizon * horizon:
            crossed += weight[b] > 0.0
            weight[b] = 0.0
            continue
        w = influence(1.0 - np.sqrt(r2) / horizon, table)
        crossed += weight[b] == 0.0
        weight[b] = w
        dyad = la.square(xi)
        moment = la.dyad(la.difference(velocity, i, j, dim), xi)
        wi = w * volume[j]
        wj = w * volume[i]
        sums[i, 0] += 1.0
        sums[j, 0] += 1.0
        sums[i, 1] += wi
        sums[j, 1] += wj
        la.add(sums, i, 2, dyad, wi)
        la.add(sums, j, 2, dyad, wj)
        la.add(sums, i, 2 + n_shape, moment, wi)
        la.add(sums, j, 2 + n_shape, moment, wj)
    return crossed


@kernel
def close_points(owned, dt, sums, dilation, share, shape_inverse, gradient, jacobian, dim):
    """Share, integrity, inverse shape tensor, velocity gradient and volume ratio of the owned points.

    A share counts the volume that its point has at the end of this step. Were it the volume of the step before, a
    part of the force would lag behind the motion and feed vibrations, in proportion to dt and stress. The weights
    w V inside the sums only divide, and keep the initial volumes. Returns how many points are degenerate.
    """
    degenerate = 0
    d = len(dim)
    n_shape = d * (d + 1) // 2
    fewest = 3.0 if d == 2 else 5.0
    for i in range(owned):
        inverse, regularity = inverse_and_regularity(la.shape_at(sums, i, 2, dim))
        integrity = integrity_of(regularity) if sums[i, 0] >= fewest else 0.0
        if integrity > 0.0:
            g = la.times_shape(la.matrix_at(sums, i, 2 + n_shape, dim), inverse)
            for c in range(n_shape):
                shape_inverse[i, c] = inverse[c]
            for c in range(d * d):
                gradient[i, c] = g[c]
            jacobian[i] = 1.0 / la.determinant_minus(la.scaled(g, dt))
            share[i, 2] = integrity * (dilation[i] * jacobian[i])
            share[i, 0] = share[i, 2] / sums[i, 1]
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
