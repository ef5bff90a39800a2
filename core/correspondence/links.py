"""The links of point-state correspondence: what they need to know of their ends, and what they are strained by.

The equations stand in `periporo.core.correspondence.point_state`.
"""

import numpy as np

from periporo.core.numerics import algebra as la
from periporo.core.numerics import vectors
from periporo.core.numerics.algebra import LANES
from periporo.core.numerics.jit import inlined, kernel

_LEAST = 1e-4  # of the stress: a smaller deviator, or mean, counts as that


@inlined
def _lengths(s):
    """Lengths of the deviator and of the mean part of a symmetric tensor (4|6)."""
    mean = (s[0] + s[1] + s[2]) / 3.0
    square = (s[0] - mean) ** 2 + (s[1] - mean) ** 2 + (s[2] - mean) ** 2
    for c in range(3, len(s)):
        square += 2.0 * s[c] ** 2
    return np.sqrt(square), np.sqrt(3.0) * abs(mean)


@inlined
def _kept_share(kept, lost):
    return kept / (kept + lost) if kept + lost != 0.0 else 1.0


@kernel
def find_ends(point, active, bulk, shear, volume, share, link):
    """Stiffness E of the links of the points with a row here, r = 1, and the factors of their volumes; or zeros."""
    for n in range(point.shape[0]):
        i = point[n]
        link[i, 0] = bulk[n] + 4.0 / 3.0 * shear[n] if active[n] else 0.0
        link[i, 1] = 1.0 if active[n] else 0.0
        link[i, 2] = volume[i] * share[i, 0] if active[n] else 0.0
        link[i, 3] = volume[i] * share[i, 1] if active[n] else 0.0


@kernel
def find_response(point, active, bulk, shear, turned, strain, stress, link, dim):
    """The part r of the trial stress that the laws kept; `turned` is the stress before they were asked.

    Rows are worked on by the tile, all lanes of it in vectors, so that a row's bits do not depend on its lane.
    """
    like = la.zero_symmetric(dim)
    c = len(like)
    tile, response = np.zeros(LANES * (3 * c + 2)), np.zeros(LANES)
    for start in range(0, point.shape[0], LANES):
        used = min(LANES, point.shape[0] - start)
        for k in range(used):
            la.to_lane(tile, 0, k, la.symmetric_at(turned, start + k, 0, dim))
            la.to_lane(tile, c, k, la.symmetric_at(strain, start + k, 0, dim))
            la.to_lane(tile, 2 * c, k, la.symmetric_at(stress, start + k, 0, dim))
            la.to_lane(tile, 3 * c, k, (bulk[start + k], shear[start + k]))
        for k in range(LANES):
            k_bulk, k_shear = la.from_lane(tile, 3 * c, k, (0.0, 0.0))
            strain_k, now = la.from_lane(tile, c, k, like), la.from_lane(tile, 2 * c, k, like)
            volumetric = (k_bulk - 2.0 / 3.0 * k_shear) * (strain_k[0] + strain_k[1] + strain_k[2])
            for e in range(c):  # from before to what the laws took away
                tile[e * LANES + k] += 2.0 * k_shear * strain_k[e] + (volumetric if e < 3 else 0.0) - now[e]
            deviator, mean = _lengths(now)
            lost_deviator, lost_mean = _lengths(la.from_lane(tile, 0, k, like))
            lost_deviator *= (k_bulk + 4.0 / 3.0 * k_shear) / (2.0 * k_shear)
            least = _LEAST * np.sqrt(deviator**2 + mean**2)
            response[k] = min(_kept_share(deviator + least, lost_deviator), _kept_share(mean + least, lost_mean))
        for k in range(used):
            if active[start + k]:
                link[point[start + k], 1] = response[k]


@kernel
def let_go(point, active, opened, link):
    """Links of opened points keep nothing."""
    for r in range(point.shape[0]):
        if active[r] and opened[r] > 0.0:
            link[point[r], 1] = 0.0


@kernel
def strain_links(
    first, second, weight, position, velocity, gradient, link, seen, closest, dt, active, stress, pull, flux, dim
):
    """New s of every pair, and what links and neighbours give to Z of both ends, in `flux`.

    `pull` becomes c s / max(|xi|, closest)^2.
    """
    matrix, last, own = la.zero_matrix(dim), -1, vectors.zero(la.zero_matrix(dim))
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        w = weight[b]
        c = w * (link[i, 2] * link[j, 3] + link[j, 2] * link[i, 3])
        active[b] = c != 0.0
        if c == 0.0:
            stress[b, 0] = pull[b] = 0.0
            continue
        xi = vectors.difference(position, i, j, dim)
        dv = vectors.difference(velocity, i, j, dim)
        mean = (vectors.row(gradient, i, matrix) + vectors.row(gradient, j, matrix)) * 0.5
        residual = dv - vectors.apply(mean, xi)
        residual += vectors.apply(mean, residual) * (0.5 * dt)  # from the start of the step
        middle = xi - dv * (0.5 * dt)  # to its middle
        # rate = middle . residual / max(|middle|, closest)^2 and c s / max(|xi|, closest)^2, by one division
        stiffness = (link[i, 0] + link[j, 0]) * max(vectors.dot(middle, middle), closest * closest)
        square = max(vectors.dot(xi, xi), closest * closest)
        over = 1.0 / (stiffness * square)
        s = stress[b, 0] + 2.0 * dt * link[i, 0] * link[j, 0] * vectors.dot(middle, residual) * (square * over)
        s *= min(link[i, 1], link[j, 1])
        stress[b, 0] = s
        pull[b] = c * s * (stiffness * over)
        to_i = to_j = vectors.dyad(xi * (-0.5 * pull[b]), xi)
        if seen.shape[0] > 0:
            sharper = (vectors.row(seen, j, matrix) - vectors.row(seen, i, matrix)) * (0.5 * c)
            to_i = to_i - sharper
            to_j += sharper
        last, own = vectors.add_to_ends(flux, i, j, to_i, to_j, last, own)


@kernel
def close_flux(point, active, stress, volume, share, shape_inverse, flux, dim):
    """B_i of the points with a row here."""
    for r in range(point.shape[0]):
        if active[r]:
            i = point[r]
            own = share[i, 2] * volume[i]
            sigma = la.full(la.symmetric_at(stress, r, 0, dim))
            for c in range(len(sigma)):
                flux[i, c] += own * sigma[c]
            z = la.scaled(la.matrix_at(flux, i, 0, dim), 1.0 / volume[i])
            la.store(flux, i, 0, la.times_shape(z, la.shape_at(shape_inverse, i, 0, dim)))
