"""Displaced points in balance: a uniform stress exerts no force on points inside a body.

Off a grid the forces of equal volumes do not balance in a uniform stress. Points give way until they do, so that a
cloud is softer than its material, in proportion to the square of the displacement and whatever the spacing. With one
vector a_i for each point, the tilt, a bond takes

    L_ij = L + (v_j - v_i - L xi) (x) q_ij,  q_ij = xi/|xi|^2 + a_j - a_i

in place of xi/|xi|^2. As the residual v_j - v_i - L xi vanishes in any affine motion, this leaves linear fields exact,
momenta conserved and the elastic operator symmetric and positive; and the forces of a uniform stress,
sigma sum_b c_b dL_b/dv_i, depend linearly on the tilts, which are chosen so that they vanish. For points see
`periporo.core.correspondence.point_tilts`. This is the integration constraint of Chen et al. (2001) and of
variationally consistent integration (Chen, Hillman & Rueter 2013), met by the gradients that trial and test functions
share.
"""

import math

import numpy as np

from periporo.core.numerics import algebra as la
from periporo.core.numerics.jit import kernel
from periporo.core.points.particles import Field, vector
from periporo.core.ranks.reductions import inner

ITERATIONS = 40
EXHAUSTED = 1e-8  # part of a direction that is new
CUT = {
    2: 0.2,
    3: 0.15,
}  # lopsidedness of points at a surface, by dimension; inside, chance makes it up to 0.18 and 0.09


def tilt_field(dimension: int) -> Field:
    """The tilts of points, for `Particles.add_field`; a bond-projected scheme with `balance` needs it."""
    return Field("tilt", dimension, "1/m", axes=vector(dimension))


def balance(sim) -> None:
    """Choose the tilts of inner points so that forces of a uniform stress vanish there, and make the forces anew.

    For the present configuration, by `ITERATIONS` of generalised conjugate residuals (Eisenstat, Elman & Schultz 1983)
    through the production kernels. Points within two horizons of a surface, where such forces need not vanish, keep a
    tilt of zero.
    """
    p, n = sim.particles, sim.particles.owned
    kept = [(block.stress.copy(), block.total) for block in sim.bonds.blocks]
    for block in sim.bonds.blocks:
        block.stress[:], block.total = 0.0, None
        block.stress[:, : p.dimension] = 1.0
    inside = inner_points(sim)
    unbalanced = _force(sim, inside, np.zeros((n, p.dimension)))
    residual, tilt = -unbalanced, np.zeros((n, p.dimension))
    directions: list[tuple[np.ndarray, np.ndarray]] = []
    for _ in range(ITERATIONS):
        step, image = residual, _force(sim, inside, residual) - unbalanced
        length = math.sqrt(inner(sim.comm, image, image))
        for other, of_other in directions:
            overlap = inner(sim.comm, image, of_other)
            step, image = step - overlap * other, image - overlap * of_other
        size = math.sqrt(inner(sim.comm, image, image))
        if not size > EXHAUSTED * length:  # what is left is rounding: on a grid, or where few points are inside
            break
        step, image = step / size, image / size
        directions.append((step, image))
        advance = inner(sim.comm, residual, image)
        tilt, residual = tilt + advance * step, residual - advance * image
    p.tilt[:n] = tilt
    sim.halo.update(p, "tilt")
    for block, (stress, total) in zip(sim.bonds.blocks, kept, strict=True):
        block.stress[:], block.total = stress, total
    sim.scheme.internal_force(p, sim.bonds, sim.halo, p.internal_force)


def _force(sim, inside, tilt):
    """Force (owned, d) N of a stress of 1 Pa all around with these tilts (owned, d), at inner points alone."""
    p = sim.particles
    p.tilt[: p.owned] = tilt
    sim.halo.update(p, "tilt")
    force = np.zeros((p.total, p.dimension))
    sim.scheme.internal_force(p, sim.bonds, sim.halo, force)
    return force[: p.owned] * inside[:, None]


def inner_points(sim) -> np.ndarray:
    """1 for each owned point that neighbours surround and that has no neighbour near a surface, 0 for others.

    At a surface a point and its neighbours are lopsided the same way, sum w V xi / sum w V |xi|. Displaced points
    inside are so in many ways: the mean of a point's own vector and that of its neighbours tells which it is.
    """
    p, pairs, n = sim.particles, sim.bonds.pairs, sim.particles.owned
    ends = pairs.first, pairs.second, pairs.weight
    sums = np.zeros((p.total, p.dimension + 1))
    _sum_first_moments(*ends, p.position, p.volume, sums, p.dim)
    p.tilt[:n] = _over(sums[:n])  # the tilts are not known yet: their ghosts carry the vectors, then the marks
    sim.halo.update(p, "tilt")
    sums[:] = 0.0
    _sum_neighbours(*ends, p.volume, p.tilt, sums, p.dim)
    lopsided = 0.5 * np.sqrt(((p.tilt[:n] + _over(sums[:n])) ** 2).sum(axis=1))
    regular = (lopsided < CUT[p.dimension]) & (p.share[:n, 1] == 1.0)
    p.tilt[:n, 0] = np.where(regular, 0.0, 1.0)
    sim.halo.update(p, "tilt")
    marks, near = p.tilt[:, 0].copy(), p.tilt[:, 0].copy()
    bonded = pairs.weight > 0.0
    first, second = pairs.first[bonded], pairs.second[bonded]
    near[first[marks[second] > 0.0]] = 1.0
    near[second[marks[first] > 0.0]] = 1.0
    return 1.0 - near[:n]


def _over(sums):
    """All columns but the last over the last one; 0 for a point without neighbours."""
    return sums[:, :-1] / np.where(sums[:, -1:] > 0.0, sums[:, -1:], np.inf)


@kernel
def _sum_first_moments(first, second, weight, position, volume, moments, dim):
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        xi = la.difference(position, i, j, dim)
        length = np.sqrt(la.dot(xi, xi))
        for a in range(len(dim)):
            moments[i, a] += weight[b] * volume[j] * xi[a]
            moments[j, a] -= weight[b] * volume[i] * xi[a]
        moments[i, len(dim)] += weight[b] * volume[j] * length
        moments[j, len(dim)] += weight[b] * volume[i] * length


@kernel
def _sum_neighbours(first, second, weight, volume, vectors, sums, dim):
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        for a in range(len(dim)):
            sums[i, a] += weight[b] * volume[j] * vectors[j, a]
            sums[j, a] += weight[b] * volume[i] * vectors[i, a]
        sums[i, len(dim)] += weight[b] * volume[j]
        sums[j, len(dim)] += weight[b] * volume[i]
