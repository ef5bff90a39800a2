"""What the pairs of points of two bodies in contact exert on each other, see `periporo.contact.bodies`.

A pair joins point i of one body and point j of another, `first` and `second`. `face` is that of the points, `bulge` and
`modulus` (points,) their q and M, Pa, `gradient` what moves their faces, `stress` theirs, and `stiffness`, `friction`
and `damping` are arrays by the numbers of the two bodies.
"""

import numpy as np

from periporo.contact.entry import elastic_force
from periporo.contact.gaps import (
    depth_rate,
    facing,
    find_gap,
    find_slip,
    gap_rate,
    normal_stress,
    opposition,
    push,
    weigh,
)  # fmt: skip
from periporo.core.numerics.jit import inlined, kernel

SOON = 0.5
"""Spacings of a gap within which a pair counts as one that may touch soon."""
ALONG = 0.25  # stiffness along a face over that along its normal
_HASTE = 1.5  # times the present speed, which points may reach before they are looked at again


@kernel
def find_overlaps(first, second, body, position, face, bulge, spacing, pairs, least, deepest, dim):
    """Deepest overlap (points,) m of each point in the `pairs` of bodies, of pairs with a weight above the `least`."""
    d = len(dim)
    xi, slope, arm, turn = np.zeros(d), np.zeros(d), np.zeros(2 * d), np.zeros(2 * d * d)
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        if not pairs[body[i], body[j]]:
            continue
        gap = find_gap(position, face, bulge, i, j, spacing, xi, slope, arm, turn, d)
        weight, _ = weigh(xi, gap, face[i, 1] + face[j, 1], spacing, d)
        if gap < 0.0 and weight > least:
            deepest[i] = max(deepest[i], -gap)
            deepest[j] = max(deepest[j], -gap)


@kernel
def add_pair_stiffness(
    first, second, owned, body, position, velocity, ahead, face, bulge, spacing, stiffness, acts, total, dim
):
    """Add the stiffness (N/m) of pairs that touch, or may `ahead` (s), to the `total` of their owned points.

    Fills which pairs these are, `acts`. Returns the largest speed (m/s) with which two of them come near.
    """
    d, closing = len(dim), 0.0
    xi, slope, arm, turn = np.zeros(d), np.zeros(d), np.zeros(2 * d), np.zeros(2 * d * d)
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        gap, approach = find_gap(position, face, bulge, i, j, spacing, xi, slope, arm, turn, d), 0.0
        for a in range(d):
            approach += slope[a] * (velocity[i, a] - velocity[j, a])
        acts[b] = gap < max(SOON * spacing, _HASTE * ahead * approach)
        if not acts[b]:
            continue
        weight, _ = weigh(xi, gap, face[i, 1] + face[j, 1], spacing, d)
        k = 2.0 * stiffness[body[i], body[j]] * face[i, 0] * face[j, 0] * weight
        if k > 0.0:
            closing = max(closing, approach)
        if i < owned:
            total[i] += k
        if j < owned:
            total[j] += k
    return closing


@inlined
def _relieve(face, bulge, stress, modulus, share, i, j, owned, slope, area, moment, d):
    """Give the outer halves of the cells of a pair to the contact, as moments; the energy (J) that these bear.

    A cell has its point's integrity, and is as much thinner as its point has less volume.
    """
    softness, strain = 0.0, 0.0
    for side in range(2):
        p, sign = (i, 1.0) if side == 0 else (j, -1.0)
        depth, n = facing(face, p, slope, sign, d)
        if n >= 0:
            softness += share[p, 2] * depth / modulus[p]
            strain += share[p, 2] * depth / modulus[p] * normal_stress(stress, face, p, n, d)
    if softness == 0.0:  # two balls, or points in lumps
        return 0.0
    tau = strain / softness
    for side in range(2):
        p, sign = (i, 1.0) if side == 0 else (j, -1.0)
        depth, n = facing(face, p, slope, sign, d)
        if n >= 0 and p < owned:
            load = share[p, 2] * area * depth * tau
            for a in range(d):
                for c in range(d):
                    through = face[p, n + a] * face[p, n + c] - depth_rate(face, n, bulge, p, a, c)
                    moment[p, a * d + c] += load * through
    return 0.5 * area * softness * tau**2


@kernel
def resist_pairs(
    first, second, acts, owned, body, position, velocity, face, bulge, gradient, stress, modulus, share, dt, spacing,
    stiffness, friction, force, moment, dim,
):  # fmt: skip
    """Force and moments of linear springs in place of the pairs that act."""
    d = len(dim)
    n = d * d
    xi, slope, arm, turn, slip = np.zeros(d), np.zeros(d), np.zeros(2 * d), np.zeros(2 * n), np.zeros(d)
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        if not acts[b]:
            continue
        gap = find_gap(position, face, bulge, i, j, spacing, xi, slope, arm, turn, d)
        weight, _ = weigh(xi, gap, face[i, 1] + face[j, 1], spacing, d)
        part = face[i, 0] * face[j, 0] * weight
        _relieve(face, bulge, stress, modulus, share, i, j, owned, slope, part * spacing ** (d - 1), moment, d)
        k = dt * stiffness[body[i], body[j]] * part
        pull = k * gap_rate(velocity, gradient, i, j, slope, turn, d)
        find_slip(velocity, gradient, i, j, slope, arm, slip, d)
        along = ALONG * k if friction[body[i], body[j]] > 0.0 else 0.0
        for a in range(d):
            force[i, a] += pull * slope[a] - along * slip[a]
            force[j, a] -= pull * slope[a] - along * slip[a]
            for c in range(d):
                if i < owned:
                    moment[i, a * d + c] += share[i, 1] * (pull * turn[a * d + c] - along * slip[a] * arm[c])
                if j < owned:
                    moment[j, a * d + c] += share[j, 1] * (pull * turn[n + a * d + c] + along * slip[a] * arm[d + c])


@kernel
def add_normal_force(
    first, second, owned, body, position, velocity, face, bulge, gradient, stress, modulus, share, mass, dt, soon,
    spacing, stiffness, friction, damping, pressures, arms, sums, contact, contact_moment, shear, shear_moment,
    internal_moment, dim,
):  # fmt: skip
    """Add the elastic and the damping force of all pairs, and their moments.

    Fills each pair's pressure and arms, and for each owned point the sums over its pairs: of pressure, friction times
    pressure, the largest stiffness, pressure times slip (d), pressure times normal (d).
    """
    d = len(dim)
    n = d * d
    xi, slope, arm, turn, slip = np.zeros(d), np.zeros(d), np.zeros(2 * d), np.zeros(2 * n), np.zeros(d)
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        pressures[b] = 0.0
        gap = find_gap(position, face, bulge, i, j, spacing, xi, slope, arm, turn, d)
        if gap >= soon:
            continue
        way = dt * gap_rate(velocity, gradient, i, j, slope, turn, d)
        if gap >= max(way, 0.0):
            continue
        reach = face[i, 1] + face[j, 1]
        weight, steepness = weigh(xi, gap, reach, spacing, d)
        opposed, rise, n_i, n_j = opposition(face, i, j, d)
        weight, steepness, rise = opposed * weight, opposed * steepness, rise * weight
        if weight == 0.0:
            continue
        law = stiffness[body[i], body[j]]
        k = law * face[i, 0] * face[j, 0]
        reduced = mass[i] * mass[j] / (mass[i] + mass[j])
        elastic = elastic_force(k * weight, -gap, -way, dt * dt / reduced)
        pushed, pushing = push(min(gap, 0.0), spacing)
        elastic += k * weight * (min(gap, 0.0) - pushing)  # where it fades
        energy = k * pushed
        if gap < 0.0:
            area = weight * face[i, 0] * face[j, 0] * spacing ** (d - 1)
            energy -= (
                _relieve(face, bulge, stress, modulus, share, i, j, owned, slope, area, internal_moment, d) / weight
            )
        sideways = energy * steepness  # d energy/d xi, over xi
        deeper = -elastic - sideways * (gap + reach)  # d energy/d gap at the same xi
        viscous = -2.0 * damping[body[i], body[j]] * np.sqrt(k * weight * reduced) * way / dt if dt > 0.0 else 0.0
        viscous = max(viscous, -elastic) if elastic > 0.0 else 0.0
        for a in range(d):
            f = -deeper * slope[a] - sideways * xi[a]
            contact[i, a] -= f
            contact[j, a] += f
            f = viscous * slope[a]
            shear[i, a] -= f
            shear[j, a] += f
        for side in range(2):
            p = i if side == 0 else j
            nearest = sideways * (gap + reach) * face[p, 1]  # through the depth of the first face
            for a in range(d if p < owned else 0):
                for c in range(d):
                    part = share[p, 1] * turn[side * n + a * d + c]
                    through = share[p, 1] * nearest * depth_rate(face, 2, bulge, p, a, c)
                    contact_moment[p, a * d + c] += deeper * part + through
                    shear_moment[p, a * d + c] -= viscous * part
        if rise != 0.0:
            _oppose(face, share, i, j, owned, n_i, n_j, energy * rise, contact_moment, d)
        pressure = max(elastic + viscous, 0.0)
        pressures[b], arms[b] = pressure, arm
        find_slip(velocity, gradient, i, j, slope, arm, slip, d)
        for side in range(2):
            p, sign = (i, 1.0) if side == 0 else (j, -1.0)
            if p < owned:
                sums[p, 0] += pressure
                sums[p, 1] += friction[body[i], body[j]] * pressure
                sums[p, 2] = max(sums[p, 2], law)
                for a in range(d):
                    sums[p, 3 + a] += sign * pressure * slip[a]
                    sums[p, 3 + d + a] += sign * pressure * slope[a]


@inlined
def _oppose(face, share, i, j, owned, n_i, n_j, rate, moment, d):
    """Add what turns faces of a pair whose energy grows by `rate` (J) with the cosine between them."""
    cosine = 0.0
    for a in range(d):
        cosine += face[i, n_i + a] * face[j, n_j + a]
    for side in range(2):
        p, n, q, m = (i, n_i, j, n_j) if side == 0 else (j, n_j, i, n_i)
        for a in range(d if p < owned else 0):
            for c in range(d):
                across = face[q, m + c] - cosine * face[p, n + c]
                moment[p, a * d + c] -= share[p, 1] * rate * face[p, n + a] * across


@kernel
def stretch_springs(sums, dt, spring, drag, dim):
    """Stretch the points' springs by their mean slip; `drag` is the force of the spring over the pressure."""
    d = len(dim)
    for i in range(sums.shape[0]):
        pressure = sums[i, 0]
        if pressure == 0.0:
            spring[i, :] = 0.0
            drag[i, :] = 0.0
            continue
        square, along, size = 0.0, 0.0, 0.0
        for a in range(d):
            spring[i, a] += dt * sums[i, 3 + a] / pressure
            square += sums[i, 3 + d + a] ** 2
            along += spring[i, a] * sums[i, 3 + d + a]
        for a in range(d):
            if square > 0.0:
                spring[i, a] -= along / square * sums[i, 3 + d + a]  # the interface may have turned
            size += spring[i, a] ** 2
        size = np.sqrt(size)
        k = 0.5 * ALONG * sums[i, 2]
        limit = 0.5 * sums[i, 1] / k
        scale = limit / size if size > limit else 1.0
        for a in range(d):
            spring[i, a] *= scale
            drag[i, a] = k * spring[i, a] / pressure


@kernel
def add_friction_force(first, second, owned, pressures, arms, share, drag, shear, moment, dim):
    """Add what the springs of both points hold, by the pressures of the pairs."""
    d = len(dim)
    for b in range(first.shape[0]):
        pressure = pressures[b]
        if pressure == 0.0:
            continue
        i, j = first[b], second[b]
        for a in range(d):
            f = pressure * (drag[j, a] - drag[i, a])
            shear[i, a] += f
            shear[j, a] -= f
            for c in range(d):
                if i < owned:
                    moment[i, a * d + c] += share[i, 1] * f * arms[b, c]
                if j < owned:
                    moment[j, a * d + c] -= share[j, 1] * f * arms[b, d + c]
