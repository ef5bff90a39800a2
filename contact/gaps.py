"""The gap between two points by their faces, with everything that it depends on. For use inside kernels.

A row of `face` is as `periporo.contact.faces` describes it, xi the way from point i to point j. Scratch arrays of a
pair: `slope` (d,) is d gap/d xi; `arm` (2 d,) the ways from both points to where their faces meet; `turn` (2 d d,) what
the gap loses by the velocity gradient of either point, d gap/dt = slope.(v_j - v_i) - turn_i : L_i - turn_j : L_j.
`bulge` (points,) is q, by which depths follow the strain along faces.
"""

import numpy as np

from periporo.core.numerics.jit import inlined

WIDTH = 2.0
"""Spacings along a face up to which two points can press on each other."""
_DEEP, _BEHIND = 1.1, 1.6
"""Spacings behind a face at which what pushes a point out begins to fade, and from which on it lies on the far side."""
_LEVEL = 1.0, 0.6820926132672204  # of the spline in the plane and in space
_FACING, _OPPOSED = 0.05, 0.3  # cosines from which on two faces can meet, and do so with all of their energy
_BLEND = 0.25  # spacings by which the gaps of the two points' faces may differ for both to count


@inlined
def spline(t, d):
    """Cubic B-spline of t spacings, 2 to either side; it adds up to one along a row, and over a plane of rows."""
    level = _LEVEL[d - 2]
    if t < 1.0:
        return level * (2.0 / 3.0 - t * t + 0.5 * t**3)
    return level * (WIDTH - t) ** 3 / 6.0 if t < WIDTH else 0.0


@inlined
def weigh(xi, gap, reach, spacing, d):
    """W(t) of a pair and dW/dt / t, 1/m^2, with t^2 = |xi|^2 - (gap + reach)^2, or 0 where that is less."""
    square = -((gap + reach) ** 2)
    for a in range(d):
        square += xi[a] ** 2
    if square < 0.0:
        return spline(0.0, d), 0.0
    t, level = np.sqrt(square) / spacing, _LEVEL[d - 2]
    if t < 1.0:
        return spline(t, d), level * (1.5 * t - 2.0) / spacing**2
    if t < WIDTH:
        return spline(t, d), -level * 0.5 * (WIDTH - t) ** 2 / (t * spacing**2)
    return 0.0, 0.0


@inlined
def _is_ball(face, i, d):
    known = False
    for a in range(d):
        known = known or face[i, 2 + a] != 0.0
    return not known


@inlined
def _reach_of(face, i, own, n, d):
    """How far point i's body reaches along -n, in columns `n` ... of row `own`; which of its faces says so, or -1."""
    furthest, found = face[i, 1] if _is_ball(face, i, d) else 0.0, -1
    for s in range((face.shape[1] - 1) // (1 + d)):
        along = 0.0
        for a in range(d):
            along -= face[own, n + a] * face[i, 2 + s * (1 + d) + a]
        along *= face[i, 1 + s * (1 + d)]
        if along > furthest:
            furthest, found = along, s
    return furthest, found


@inlined
def _separation(xi, face, own, other, sign, d):
    """Largest gap by the faces of point `own` to `other`, at sign xi from it; which face, and which of the other's."""
    gap, best, partner = -np.inf, -1, -1
    for s in range((face.shape[1] - 1) // (1 + d)):
        n = 2 + s * (1 + d)
        along, known = 0.0, False
        for a in range(d):
            along += sign * xi[a] * face[own, n + a]
            known = known or face[own, n + a] != 0.0
        if not known:
            continue
        reach, found = _reach_of(face, other, own, n, d)
        if along - face[own, n - 1] - reach > gap:
            gap, best, partner = along - face[own, n - 1] - reach, s, found
    return gap, best, partner


@inlined
def depth_rate(face, n, bulge, i, a, c):
    """Component a, c of what a depth of point i, whose normal begins in column n, follows: d'/d over L."""
    return -bulge[i] * ((1.0 if a == c else 0.0) - face[i, n + a] * face[i, n + c])


@inlined
def _add_part(xi, face, bulge, own, other, best, partner, sign, part, slope, arm, turn, at, away, d):
    """Add what the face `best` of point `own` has in a gap: `part` of it."""
    n, o = 2 + best * (1 + d), 2 + max(partner, 0) * (1 + d)
    depth, far = face[own, n - 1], face[other, o - 1] if partner >= 0 else 0.0
    along, cosine = 0.0, 0.0
    for a in range(d):
        along += (sign * xi[a] + far * face[other, o + a]) * face[own, n + a]
        cosine += face[own, n + a] * face[other, o + a]
    for a in range(d):
        out, far_out = face[own, n + a], face[other, o + a]
        slope[a] += part * sign * out
        arm[at * d + a] += part * depth * out
        arm[away * d + a] += part * (far * far_out if partner >= 0 else -face[other, 1] * out)
        for c in range(d):
            across = sign * xi[c] + far * face[other, o + c] - along * face[own, n + c]
            turn[at * d * d + a * d + c] += part * (out * across + depth * depth_rate(face, n, bulge, own, a, c))
            across = face[own, n + c] - cosine * face[other, o + c]
            rate = depth_rate(face, o, bulge, other, a, c)
            turn[away * d * d + a * d + c] += part * far * (far_out * across - cosine * rate)


@inlined
def _meet(xi, arm, d):
    """From ways to the two faces to ways to the place between them."""
    for a in range(d):
        sum_of_arms = arm[a] + arm[d + a]
        arm[a], arm[d + a] = 0.5 * (sum_of_arms + xi[a]), 0.5 * (sum_of_arms - xi[a])


@inlined
def _most_opposed(face, i, j, d):
    """Cosine between those faces of two points that face each other most, and which these are; 1 for a ball."""
    most, own, other = 1.0 if _is_ball(face, i, d) or _is_ball(face, j, d) else 0.0, 0, 0
    for s in range((face.shape[1] - 1) // (1 + d)):
        for r in range((face.shape[1] - 1) // (1 + d)):
            cosine = 0.0
            for a in range(d):
                cosine -= face[i, 2 + s * (1 + d) + a] * face[j, 2 + r * (1 + d) + a]
            if cosine > most:
                most, own, other = cosine, s, r
    return most, own, other


@inlined
def opposition(face, i, j, d):
    """Part of their energy with which the faces of two points meet, by how they face each other.

    Also its slope over the cosine, and the columns in which the normals begin that this is of.
    """
    cosine, own, other = _most_opposed(face, i, j, d)
    n, m = 2 + own * (1 + d), 2 + other * (1 + d)
    part = (cosine - _FACING) / (_OPPOSED - _FACING)
    if part >= 1.0:
        return 1.0, 0.0, n, m
    if part <= 0.0:
        return 0.0, 0.0, n, m
    return part * part * (3.0 - 2.0 * part), 6.0 * part * (1.0 - part) / (_OPPOSED - _FACING), n, m


@inlined
def find_gap(position, face, bulge, i, j, spacing, xi, slope, arm, turn, d):
    """Gap of a pair (m); fills the scratch arrays.

    It is the larger of what the faces of either point say, and the mean where they say the same: neither comes first.
    Infinite where no faces of the two can meet, and where one lies so deep that it must be on the other's far side.
    """
    square = 0.0
    for a in range(d):
        xi[a] = position[j, a] - position[i, a]
        square += xi[a] ** 2
    slope[:] = 0.0
    arm[:] = 0.0  # first those to either face
    turn[:] = 0.0
    if _is_ball(face, i, d) and _is_ball(face, j, d):
        distance = np.sqrt(square)
        for a in range(d):
            slope[a] = xi[a] / distance
            arm[a], arm[d + a] = face[i, 1] * slope[a], -face[j, 1] * slope[a]
        _meet(xi, arm, d)
        return distance - face[i, 1] - face[j, 1]
    facing_most, _, _ = _most_opposed(face, i, j, d)
    if not facing_most > _FACING:
        return np.inf
    own, own_face, own_partner = _separation(xi, face, i, j, 1.0, d)
    other, other_face, other_partner = _separation(xi, face, j, i, -1.0, d)
    gap, larger, blend = max(own, other), 1.0, _BLEND * spacing
    apart = abs(own - other) / blend
    if apart < 1.0:
        gap -= 0.5 * blend * apart * (1.0 - apart) ** 2
        larger = 1.0 - 0.5 * (1.0 - apart) * (1.0 - 3.0 * apart)
    part = larger if own >= other else 1.0 - larger
    if part != 0.0:
        _add_part(xi, face, bulge, i, j, own_face, own_partner, 1.0, part, slope, arm, turn, 0, 1, d)
    if part != 1.0:
        _add_part(xi, face, bulge, j, i, other_face, other_partner, -1.0, 1.0 - part, slope, arm, turn, 1, 0, d)
    _meet(xi, arm, d)
    return gap if not gap < -_BEHIND * spacing else np.inf


@inlined
def push(gap, spacing):
    """Energy of an overlap over k, m^2, and its slope: gap^2/2, which fades where a point comes to the far side."""
    energy, slope = 0.5 * gap * gap, gap
    part = (-gap / spacing - _DEEP) / (_BEHIND - _DEEP)
    if part <= 0.0:
        return energy, slope
    if part >= 1.0:
        return 0.0, 0.0
    left = 1.0 - part * part * (3.0 - 2.0 * part)
    return energy * left, slope * left + energy * 6.0 * part * (1.0 - part) / ((_BEHIND - _DEEP) * spacing)


@inlined
def facing(face, i, slope, sign, d):
    """How far the body of point i reaches from it along sign times `slope`, and the column of that face's normal."""
    furthest, found = 0.0, -1
    for s in range((face.shape[1] - 1) // (1 + d)):
        along = 0.0
        for a in range(d):
            along += sign * slope[a] * face[i, 2 + s * (1 + d) + a]
        along *= face[i, 1 + s * (1 + d)]
        if along > furthest:
            furthest, found = along, 2 + s * (1 + d)
    return furthest, found


@inlined
def normal_stress(stress, face, i, n, d):
    """Stress (Pa) of point i across its face whose normal begins in column n."""
    total = 0.0
    for a in range(d):
        total += stress[i, a] * face[i, n + a] ** 2
    total += 2.0 * stress[i, 3] * face[i, n] * face[i, n + 1]
    if d == 3:
        total += 2.0 * face[i, n + 2] * (stress[i, 4] * face[i, n + 1] + stress[i, 5] * face[i, n])
    return total


@inlined
def gap_rate(velocity, gradient, i, j, slope, turn, d):
    """d gap/dt."""
    rate = 0.0
    for a in range(d):
        rate += slope[a] * (velocity[j, a] - velocity[i, a])
    for c in range(d * d):
        rate -= turn[c] * gradient[i, c] + turn[d * d + c] * gradient[j, c]
    return rate


@inlined
def find_slip(velocity, gradient, i, j, slope, arm, slip, d):
    """Fill `slip` (d,) with how much faster i's face is than j's where they meet, across the slope."""
    along, square = 0.0, 0.0
    for a in range(d):
        slip[a] = velocity[i, a] - velocity[j, a]
        for c in range(d):
            slip[a] += gradient[i, a * d + c] * arm[c] - gradient[j, a * d + c] * arm[d + c]
        along += slip[a] * slope[a]
        square += slope[a] ** 2
    for a in range(d):
        slip[a] -= along / square * slope[a]
