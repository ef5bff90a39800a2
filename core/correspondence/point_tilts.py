"""Displaced points in balance, for the point-state scheme.

As `periporo.core.correspondence.balance` tilts bonds, so here gradients of points are tilted, by one vector a_i each.
With the moments m_i = sum w V_j xi and u_i = sum w V_j (v_j - v_i) the gradient that everything sees is

    L_i + rho_i (x) a_i,  rho_i = (u_i - L_i m_i)/W_i,

in place of L_i. As rho vanishes in any affine motion, strain stays exact; the force, being the conjugate, depends
linearly on the tilts, and those are chosen so that a uniform stress exerts none inside. Of Z_i, the conjugate of the
tilted gradient, t_i = Z_i a_i moves with rho_i. So L_i has the conjugate Z_i - t_i (x) m_i/W_i, and each bond besides
the force w V_i V_j (T_i - T_j), T_i = t_i/(W_i V_i).
"""

from periporo.core.numerics import algebra as la
from periporo.core.numerics.jit import kernel
from periporo.core.points.faces import turn
from periporo.core.points.particles import Field, vector


def fields(dimension: int) -> tuple[Field, ...]:
    """What points need for it, but for their tilts."""
    return (
        Field("first_moments", 2 * dimension, "m, m/s", migrates=False, axes=2 * vector(dimension)),  # m/W, rho
        Field("tilt_force", dimension, "N/m^6", migrates=False, axes=vector(dimension)),  # T
    )


def tilt_gradients(particles, pairs, dt: float) -> None:
    """Turn the tilts of the owned points to the end of the step of `dt` s, and tilt their gradients."""
    p = particles
    turn(p.tilt, p.gradient, dt)
    p.first_moments[:] = 0.0
    _sum_first_moments(
        pairs.first, pairs.second, pairs.weight, p.volume, p.position, p.velocity, p.first_moments, p.dim
    )
    _tilt(p.owned, p.volume, p.sums, p.share, p.tilt, p.first_moments, p.gradient, p.dim)


def tilt_flux(block, particles) -> None:
    """From Z of the points with a row in `block`, whose stress is not yet added, to the conjugate of L; and T."""
    p = particles
    _tilt_flux(
        block.first, block.active, block.total_stress, p.volume, p.share, p.sums, p.tilt, p.first_moments,
        p.tilt_force, p.flux, p.dim,
    )  # fmt: skip


def add_force(particles, pairs, force) -> None:
    """Add the bonds' forces of T, which ghosts must have, to `force` (total, d) N."""
    p = particles
    _add_force(pairs.first, pairs.second, pairs.weight, p.volume, p.tilt_force, force)


@kernel
def _sum_first_moments(first, second, weight, volume, position, velocity, moments, dim):
    """m and u of the owned points."""
    for b in range(first.shape[0]):
        if weight[b] == 0.0:
            continue
        i, j = first[b], second[b]
        xi = la.difference(position, i, j, dim)
        dv = la.difference(velocity, i, j, dim)
        to_first, to_second = weight[b] * volume[j], weight[b] * volume[i]
        for a in range(len(dim)):
            moments[i, a] += to_first * xi[a]
            moments[j, a] -= to_second * xi[a]
            moments[i, len(dim) + a] += to_first * dv[a]
            moments[j, len(dim) + a] -= to_second * dv[a]


@kernel
def _tilt(owned, volume, sums, share, tilt, moments, gradient, dim):
    """Add rho (x) a to the gradients of the owned points, and divide their moments by W."""
    d = len(dim)
    for i in range(owned):
        if share[i, 1] == 0.0:
            continue
        for a in range(2 * d):
            moments[i, a] *= volume[i] / sums[i, 0]
        for a in range(d):
            rho = moments[i, d + a]
            for c in range(d):
                rho -= gradient[i, d * a + c] * moments[i, c]
            moments[i, d + a] = rho
        for a in range(d):
            for c in range(d):
                gradient[i, d * a + c] += moments[i, d + a] * tilt[i, c]


@kernel
def _tilt_flux(point, active, stress, volume, share, sums, tilt, moments, tilt_force, flux, dim):
    d = len(dim)
    for r in range(point.shape[0]):
        i = point[r]
        for a in range(d):
            tilt_force[i, a] = 0.0
        if not active[r]:
            continue
        own = share[i, 2] * volume[i]
        sigma = la.full(la.symmetric_at(stress, r, 0, dim))
        for a in range(d):
            t = 0.0
            for c in range(d):
                t += (flux[i, d * a + c] + own * sigma[d * a + c]) * tilt[i, c]
            tilt_force[i, a] = t / sums[i, 0]  # V W
            for c in range(d):
                flux[i, d * a + c] -= t * moments[i, c]


@kernel
def _add_force(first, second, weight, volume, tilt_force, force):
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        for a in range(force.shape[1]):
            f = weight[b] * volume[i] * volume[j] * (tilt_force[i, a] - tilt_force[j, a])
            force[i, a] += f
            force[j, a] -= f
