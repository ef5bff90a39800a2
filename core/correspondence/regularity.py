"""What keeps points regular and their stress smooth where soil flows; nothing of it acts where soil is elastic.

A flow shears a lattice into rows that stand close within and far from each other. Gradients over a horizon do not see
how such points are filled up with others, so that the cloud becomes denser than the integral of tr L says, and the
mean stress, bulk modulus times small differences of strain, becomes noise. Three things are done, all in proportion
to the *activity* a of the points, a running mean of the part of the trial stress that their law took away:

- **Rearrangement.** A point moves away from those closer than their size, (V J)^(1/d), along their line while it
  shears, without velocity, strain or stress (the shifting of Xu, Stansby & Laurence 2009 and Lind et al. 2012 for SPH,
  here in proportion to the point's own shear strain, so that soil at rest stays: by equal and opposite ways, soil that
  flows makes room for itself in the soil beneath, which becomes a tenth denser). Obstacles are mirrors. The work of
  gravity and contact on these ways is booked.
- **Exchange** of stress and of opened volume between neighbours of one material, which takes their differences away
  (diffusion of pressure, Molteni & Colagrossi 2009; of stress, Feng et al. 2021). Sums over the points are kept, an
  average of admissible stresses is admissible, and elastic energy only falls. Only laws that say `exchanges_stress`
  take part: stress is all that they remember. A law that hardens would be strained by what it is given. The weight of
  what lies above is carried upwards with the rest, and expands the surface in place of the soil that dilates; so soil
  with a `dilatancy` exchanges no faster than its own flow makes stress uneven.
- **Bulk viscosity**, q = VISCOSITY rho c l (tr L less its mean over the neighbours) with the size l (von Neumann &
  Richtmyer 1950; Monaghan 1992), which takes sound from the grid's scale and does not feel an even change of volume.

How much of each belongs to a step follows from the Courant number dt c / l, so that it does not depend on the step.
"""

import numpy as np

from periporo.core.correspondence.influence import influence
from periporo.core.numerics import algebra as la
from periporo.core.numerics import vectors
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.points.forces import FLOW_WORK
from periporo.core.points.particles import Field, tensor, vector

EXCHANGE = 1.8  # part of a difference that the exchange takes away, per Courant number
MOST_EXCHANGED = 0.9  # of a difference, in one step
SHEAR_SHARE = 0.3  # of the exchange for the deviator
CLEARED = 4.0  # K times the uneven volumetric strain of a step, over dilatancy and stress: largest part exchanged
SHEAR_MAKES = 0.05  # uneven volumetric strain that counts as made by a shear strain of 1, beside what gradients see
VISCOSITY = 0.2  # of rho c l
MEMORY = 0.075  # of the activity, per Courant number
QUIET = 1e-6  # activity that counts as none
SENSITIVITY = 0.1  # part of the trial stress that a law takes away in a step, over what it keeps, for a half
NEAREST = 1.02  # size of points, over the side of a cube of their volume, below which they move apart
_BELOW = 1.0 - 1e-9  # so that rounding takes no pair away
REARRANGED = 6.0  # part of the overlap that a shear strain of 1 takes away
MOST_REARRANGED = 0.01  # of an overlap, in one step

SIGNED, ACTIVITY, SIZE, MOVED, PART, MADE, BORNE = range(7)  # columns of the field `flow`
_MEAN, _STRESS = 1, 2  # first columns of the points' scratch `sums` that an exchange uses; their W stays
_VISCOUS, _EXCHANGED, _REARRANGED = range(3)  # columns of the field `flow_work`


def fields(dimension: int, components: int) -> tuple[Field, ...]:
    """What points need for it."""
    return (
        Field("flow", 7, "Pa, 1, m, 1, 1, Pa, Pa"),
        Field("flow_stress", components, "Pa", migrates=False, axes=tensor(dimension)),
        Field("rearrangement", dimension, "m", axes=vector(dimension)),
        Field("exchanged_strain", None, "1", sent=False),
        Field("flow_work", len(FLOW_WORK), "J", sent=False),
    )


def describe(block, bulk, p, dt: float, viscous: bool) -> None:
    """Tell `flow` and `flow_stress` of the points with a row in `block` from the step that their law has answered.

    `bulk` (rows,) Pa is their present modulus, and `viscous` whether there is bulk viscosity: not in a quasi-static
    relaxation.
    """
    part = EXCHANGE if block.exchanges else 0.0
    _describe(
        block.first, block.active, dt, part, block.dilatancy, VISCOSITY if viscous else 0.0, block.opening.column,
        block.stress, block.state, bulk, p.uneven_rate, p.link, p.mass, p.volume, p.share, p.gradient, p.activity,
        p.flowed, p.viscous_stress, p.position, p.widths(), p.flow, p.flow_stress, p.flow_work, p.dim,
    )  # fmt: skip


def exchange(p, pairs, blocks, moduli, horizon: float, table: np.ndarray) -> None:
    """Exchange stress between neighbours, and find the ways by which points move apart before the next step.

    `blocks`, with their `moduli`, are those of laws that exchange stress, for it is all that they remember; without
    any, only pairs matter that are close, which their influence tells, from its `horizon` (m) and `table`.
    """
    p.exchanged_strain.fill(0.0)
    p.clear(p.rearrangement)
    if blocks:
        p.clear(p.sums[:, _MEAN:])
    _exchange(
        pairs.first, pairs.second, pairs.weight, len(blocks) > 0, horizon, table, p.widths(), p.position, p.material,
        p.link, p.flow, p.flow_stress, p.sums, p.rearrangement, p.dim,
    )  # fmt: skip
    for block, (bulk, shear) in zip(blocks, moduli, strict=True):
        limit = block.material.tension_limit(block.stress, block.state)
        _apply(
            block.first, block.active, bulk, shear, limit, block.opening.column, p.volume, p.share, p.flow, p.sums,
            block.stress, block.state, p.exchanged_strain, p.flow_work,
        )  # fmt: skip


def stop(p, rows: np.ndarray) -> None:
    """Let the points in `rows` take no part in what their neighbours exchange, and stay; they keep their size."""
    p.rearrangement[rows] = 0.0
    p.flow[rows, ACTIVITY] = p.flow[rows, MOVED] = p.flow[rows, PART] = 0.0


def rearrange(p, motions, contacts) -> None:
    """Move points by their rearrangement; components that `motions` prescribe stay. Volumes follow what was exchanged.

    Obstacles among the `contacts` are mirrors: they guide the points that they hold.
    """
    n = p.awake
    way, lift, part, room = p.rearrangement[:n], np.zeros((n, p.dimension)), np.empty(n), np.empty(n)
    flows = _find_room(p.flow, part, room)
    if motions:
        free = np.ones((n, p.dimension))
        for motion in motions:
            motion.hold_zero(p, way)
            motion.hold_zero(p, free)
        part *= free.all(axis=1)
    for contact in contacts:
        if flows and hasattr(contact, "guide"):
            contact.guide(p, room, part, way, lift)
    names, nothing = ("external_force", "contact_force"), np.empty((0, p.dimension))
    external, contact = (getattr(p, name) if name in p.fields else nothing for name in names)
    _rearrange(n, way, lift, p.position, p.exchanged_strain, p.dilation, external, contact, p.flow_work, p.dim)


def viscosity(block, p, bulk, shear) -> np.ndarray:
    """Bulk viscosity (rows,) Pa s of the rows of `block` with these moduli (rows,) Pa, at the present activity."""
    found = np.zeros(len(bulk))
    _find_viscosity(
        block.first, block.active, bulk, shear, p.mass, p.volume, p.share, p.activity, p.position, p.widths(), found,
        p.dim,
    )  # fmt: skip
    return found


@kernel
def _find_viscosity(point, active, bulk, shear, mass, volume, share, activity, position, width, found, dim):
    for r in range(point.shape[0]):
        i = point[r]
        if active[r] and activity[i] > 0.0:
            modulus = bulk[r] + 4.0 / 3.0 * shear[r]
            size, speed, density = _measures(i, modulus, mass, volume, share, position, width, dim)
            found[r] = VISCOSITY * activity[i] * density * speed * size


@inlined
def _measures(i, modulus, mass, volume, share, position, width, dim):
    """Size (of a ring: across), speed of P waves, and density of a point that is not degenerate."""
    ring = 1.0 if width.shape[0] > 0 else 0.0  # a branch at the division makes all of this take four times as long
    extent = volume[i] * share[i, 2] / (share[i, 1] * (2.0 * np.pi * position[i, 0] * ring + 1.0 - ring))
    size = np.sqrt(extent) if len(dim) == 2 else np.cbrt(extent)
    return size, np.sqrt(modulus * volume[i] / mass[i]), mass[i] * share[i, 1] / (volume[i] * share[i, 2])


@kernel
def _describe(
    point, active, dt, exchanged, dilatancy, viscosity, column, stress, state, bulk, uneven_rate, link, mass, volume,
    share, gradient, activity, flowed, viscous, position, width, flow, flow_stress, work, dim,
):  # fmt: skip
    last = dilatancy.shape[0] - 1  # of one for all rows, or one for each
    for r in range(point.shape[0]):
        i = point[r]
        if not active[r]:
            for c in range(flow.shape[1]):
                flow[i, c] = 0.0
            activity[i] = viscous[i] = 0.0
            continue
        size, speed, density = _measures(i, link[i, 0], mass, volume, share, position, width, dim)
        courant = dt * speed / size
        lost = 1.0 - link[i, 1]
        activity[i] += min(MEMORY * courant, 1.0) * (lost / (lost + SENSITIVITY * link[i, 1]) - activity[i])
        if activity[i] < QUIET:
            activity[i] = 0.0
        square = 0.0
        for c in range(stress.shape[1]):
            flow_stress[i, c] = stress[r, c]
            square += stress[r, c] ** 2 if c < 3 else 2.0 * stress[r, c] ** 2
        flow[i, SIGNED] = (stress[r, 0] + stress[r, 1] + stress[r, 2]) / 3.0 + bulk[r] * state[r, column]
        flow[i, ACTIVITY] = activity[i]
        flow[i, SIZE] = size
        rate = _shear_rate(la.matrix_at(gradient, i, 0, dim))
        flowed[i] += activity[i] * rate * dt
        flow[i, MOVED] = min(REARRANGED * dt * activity[i] * rate, MOST_REARRANGED)
        flow[i, PART] = min(exchanged * courant, MOST_EXCHANGED)
        flow[i, MADE] = CLEARED * bulk[r] * dt * (abs(uneven_rate[i]) + SHEAR_MAKES * rate)
        flow[i, BORNE] = dilatancy[min(r, last)] * np.sqrt(square / 3.0)
        q = viscosity * activity[i] * density * speed * size * uneven_rate[i]
        viscous[i] = q
        work[i, _VISCOUS] += q * uneven_rate[i] * dt * volume[i] * share[i, 2]


@inlined
def _shear_rate(g):
    """Difference of the principal rates of a gradient in the plane; in space sqrt(3) times the equivalent rate."""
    if len(g) == 4:
        return np.sqrt((g[0] - g[3]) ** 2 + (g[1] + g[2]) ** 2)
    mean = (g[0] + g[4] + g[8]) / 3.0
    normal = (g[0] - mean) ** 2 + (g[4] - mean) ** 2 + (g[8] - mean) ** 2
    return np.sqrt(2.0 * normal + (g[1] + g[3]) ** 2 + (g[5] + g[7]) ** 2 + (g[2] + g[6]) ** 2)


@kernel
def _exchange(
    first, second, weight, exchanges, horizon, table, width, position, material, link, flow, flow_stress, sums,
    rearrangement, dim,
):  # fmt: skip
    """Add ways to `rearrangement`, and what points are given of stress and of its mean to columns of `sums`."""
    components = len(la.zero_symmetric(dim))
    least = 0.0
    if not exchanges and width.shape[0] == 0:  # rings weigh by their widths, too
        largest = 0.0
        for i in range(flow.shape[0]):
            largest = max(largest, flow[i, SIZE])
        least = _BELOW * influence(1.0 - NEAREST * largest / horizon, table)
    for b in range(first.shape[0]):
        w = weight[b]
        if w < least or w == 0.0:
            continue
        i, j = first[b], second[b]
        a = max(flow[i, ACTIVITY], flow[j, ACTIVITY])
        if a == 0.0:
            continue
        part = min(flow[i, PART], flow[j, PART])
        gives = part != 0.0 and material[i] == material[j]  # most laws exchange nothing
        xi = vectors.difference(position, i, j, dim)
        square = vectors.dot(xi, xi)
        size = NEAREST * 0.5 * (flow[i, SIZE] + flow[j, SIZE])
        close = 0.0 < square < size * size
        if not (gives or close):
            continue
        c = w * (link[i, 2] * link[j, 3] + link[j, 2] * link[i, 3])
        if c == 0.0:
            continue
        if gives:
            made, borne = flow[i, MADE] + flow[j, MADE], flow[i, BORNE] + flow[j, BORNE]
            k = 0.5 * a * c * part if a * part * borne <= made else 0.5 * c * made / borne
            p_i, p_j = flow[i, SIGNED], flow[j, SIGNED]
            change = k * (min(p_j, max(-p_i, 0.0)) - min(p_i, max(-p_j, 0.0)))
            sums[i, _MEAN] += change
            sums[j, _MEAN] -= change
            for e in range(components):
                change = k * (flow_stress[j, e] - flow_stress[i, e])
                sums[i, _STRESS + e] += change
                sums[j, _STRESS + e] -= change
        if close:
            r = np.sqrt(square)
            overlap = 0.5 * (size - r) / r
            for e in range(len(dim)):
                way = overlap * (position[j, e] - position[i, e])
                rearrangement[i, e] -= flow[i, MOVED] * way
                rearrangement[j, e] += flow[j, MOVED] * way


@kernel
def _apply(
    point, active, bulk, shear, limit, column, volume, share, flow, sums, stress, state, strain, work,
):  # fmt: skip
    for r in range(point.shape[0]):
        i = point[r]
        if not active[r] or (sums[i, _MEAN] == 0.0 and flow[i, ACTIVITY] == 0.0):
            continue
        own = volume[i] * share[i, 2]
        mean = (stress[r, 0] + stress[r, 1] + stress[r, 2]) / 3.0
        before = mean * mean / (2.0 * bulk[r]) + _shear_energy(stress, r, mean, shear[r])
        signed = flow[i, SIGNED] + sums[i, _MEAN] / own
        strain[i] = sums[i, _MEAN] / (own * bulk[r])
        new_mean = min(signed, limit[r])
        state[r, column] = (signed - new_mean) / bulk[r]
        mean_of_changes = (sums[i, _STRESS] + sums[i, _STRESS + 1] + sums[i, _STRESS + 2]) / 3.0
        for c in range(stress.shape[1]):
            change = sums[i, _STRESS + c] - (mean_of_changes if c < 3 else 0.0)
            stress[r, c] += SHEAR_SHARE * change / own + (new_mean - mean if c < 3 else 0.0)
        after = new_mean * new_mean / (2.0 * bulk[r]) + _shear_energy(stress, r, new_mean, shear[r])
        work[i, _EXCHANGED] += own * (before - after)


@inlined
def _shear_energy(stress, r, mean, shear):
    square = 0.0
    for c in range(stress.shape[1]):
        square += (stress[r, c] - mean) ** 2 if c < 3 else 2.0 * stress[r, c] ** 2
    return square / (4.0 * shear) if shear > 0.0 else 0.0


@kernel
def _find_room(flow, part, room):
    """Part of an overlap that points lose in the step, and least distance from a mirror; whether any flows."""
    flows = False
    for i in range(part.shape[0]):
        part[i] = flow[i, MOVED]
        room[i] = 0.5 * NEAREST * flow[i, SIZE]
        flows |= part[i] != 0.0
    return flows


@kernel
def _rearrange(owned, way, lift, position, strain, dilation, external, contact, work, dim):
    """Move points by `way`, less what leads against the contact force, into what they touch, and by `lift`.

    Contact forces do no work on a lift: their faces stay.
    """
    for i in range(owned):
        dilation[i] *= 1.0 + strain[i]
        square = along = 0.0
        if contact.shape[0] > 0:
            for a in range(len(dim)):
                square += contact[i, a] ** 2
                along += contact[i, a] * way[i, a]
        for a in range(len(dim)):
            if along < 0.0:
                way[i, a] -= along / square * contact[i, a]
            step = way[i, a] + lift[i, a]
            if step != 0.0:
                position[i, a] += step
                if external.shape[0] > 0:
                    work[i, _REARRANGED] += external[i, a] * step
                if along > 0.0:
                    work[i, _REARRANGED] += contact[i, a] * way[i, a]
