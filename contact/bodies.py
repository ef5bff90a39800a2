"""Contact between two deformable bodies: penalty along the interface's normal, Coulomb stick-slip along it.

Forces between single points along the line that joins them would make any interface as rough as a row of
points: at a distance of one spacing it interlocks even without friction. Here the two bodies' own normals make
the interface smooth. A point's normal is the direction in which its body's neighbours are missing,

    a_i = sum_j w V_j xi_ij / (delta sum_j w V_j),  w = 1 - |xi|^2/delta^2,

(it points into the body, and vanishes in its interior; the wide w makes it ten times less sensitive to ripples of the
surface than the scheme's influence),

and a pair's normal n, from the first to the second, is along -a_i or a_j: the one that sees the points farther
apart, xi.n, since two bodies are apart when the surface of one of them separates them, and a corner's normal says
nothing about the face that it stands on. Where a falls below 0.1 the line between the points, xi, makes up for the
rest. With overlap h = spacing - xi.n and the distance t across the normal, the pair's normal force is
k c (1 - |t|/spacing) h n: the hats of a flat lattice add up to one in the plane, and to pi/3 on average in space,
which c makes good. It comes with the small force across the normal that makes the pair's energy
k c (1 - |t|/spacing) h^2 / 2 a potential.
The tangential force is a spring of the same stiffness from where the pair began to stick, cut to friction times
the normal force. Forces on the two points are opposite.
"""

import numpy as np

from periporo.core.numerics.jit import inlined, kernel
from periporo.core.points.forces import ForceChannels
from periporo.core.points.neighbours import find_pairs
from periporo.core.points.particles import Field, Particles
from periporo.core.ranks.reductions import any_rank, maximum, minimum

_PARTNERS = {2: 12, 3: 32}  # points of the other body that a point can touch at once
_SURFACE = 0.1  # |a| from which on a point is at its body's surface; it is about 0.2 at a flat one


class BodiesContact:
    """Contact of all points of body number `first` with those of body number `second`.

    `stiffness` N/m of a pair of facing points, `friction` coefficient, `damping` share of critical damping along the
    normal; `sim` is the simulation that it belongs to. Each point keeps the springs to the points that it touches,
    by their ids, so that they follow it through rebuilds and to other ranks. Needs the channels `contact` and
    `friction`.
    """

    def __init__(self, name, first, second, *, sim, stiffness, friction, damping=0.0):
        self.first, self.second = first, second
        self.stiffness = stiffness
        self.friction = friction
        self.damping = damping
        self._sim = sim
        self._spacing = sim.spacing
        self._ids = None  # of the rebuild that the pairs belong to
        self._present = False  # whether there are pairs on any rank
        self._ends = np.empty((2, 0), np.uint32)
        self.partner, self.spring, self.normal = (f"{k}_{name}" for k in ("partner", "pair_spring", "body_normal"))

    def attach(self, p: Particles, forces: ForceChannels) -> None:
        """Declare what the points keep of their partners, their normals, and the force channels."""
        slots = _PARTNERS[p.dimension]
        p.add_field(Field(self.partner, slots, "", sent=False, dtype=np.int64))  # id + 1 of a partner, 0 is free
        p.add_field(Field(self.spring, slots * p.dimension, "m", sent=False))
        # normal, and the mass, which ghosts lack otherwise
        p.add_field(Field(self.normal, p.dimension + 1, "1, kg", migrates=False))
        forces.need("contact")
        forces.need("friction")

    def add_force(self, p: Particles, time: float, dt: float) -> None:
        """Add normal and friction force; velocities are those of the middle of the step.

        Raises RuntimeError if a point touches more points than it can keep in mind.
        """
        self._find_pairs(p)
        if not self._present:
            return
        pairs, normal = self._sim.bonds.pairs, getattr(p, self.normal)
        near = np.zeros(p.total, np.bool_)
        near[self._ends.ravel()] = True
        _body_normals(
            near, p.owned, pairs.first, pairs.second, pairs.weight, p.position, p.volume, p.mass,
            self._sim.scheme.horizon, normal, p.dim,
        )  # fmt: skip
        self._sim.halo.update(p, self.normal)
        full = _pair_force(
            self._ends[0], self._ends[1], p.owned, p.id, p.position, p.velocity, normal, dt, self._spacing,
            self.stiffness, self.friction, self.damping, getattr(p, self.partner), getattr(p, self.spring),
            p.contact_force, p.friction_force, p.dim,
        )  # fmt: skip
        if full >= 0:
            raise RuntimeError(
                f"contact of bodies: point {p.id[full]} at {p.position[full]} touches more than "
                f"{_PARTNERS[p.dimension]} points of the other body; raise the contact's stiffness"
            )

    def add_stiffness(self, p: Particles, time: float, stiffness: np.ndarray) -> None:
        """Add the contact's stiffness (N/m) to `stiffness` (owned,) of the points that may touch."""
        self._find_pairs(p)
        square = ((p.position[self._ends[1]] - p.position[self._ends[0]]) ** 2).sum(axis=1)
        ends = np.unique(self._ends[:, square < 2.0 * self._spacing**2])
        # a pair of equal points has twice the square frequency of a point at a wall
        stiffness[ends[ends < p.owned]] += 2.0 * self.stiffness

    def _find_pairs(self, p):
        """Pairs that may touch before the next rebuild, in the order of their ids; none if the bodies are far apart."""
        if self._ids is p.id:
            return
        self._ids = p.id
        reach = np.sqrt(2.0) * self._spacing + self._sim.skin
        rows = [np.flatnonzero(p.body == b) for b in (self.first, self.second)]
        boxes = [self._bounds(p.position[r[r < p.owned]]) for r in rows]
        lower = np.maximum(boxes[0][0], boxes[1][0]) - reach
        upper = np.minimum(boxes[0][1], boxes[1][1]) + reach
        self._ends = np.empty((2, 0), np.uint32)
        if not (lower > upper).any():  # the same on all ranks
            both = np.concatenate(rows)
            x = p.position[both]
            both = both[((x >= lower) & (x <= upper)).all(axis=1)]
            ends = find_pairs(p, both, np.zeros(p.total, np.int64), reach)
            self._ends = np.ascontiguousarray(ends[:, p.body[ends[0]] != p.body[ends[1]]])
        self._present = any_rank(self._sim.comm, self._ends.size > 0)
        self._forget_the_absent(p)

    def _bounds(self, position):
        """Lower and upper corner (d,) m of all ranks' points."""
        comm, axes = self._sim.comm, range(position.shape[1])
        lower = [minimum(comm, float(position[:, a].min(initial=np.inf))) for a in axes]
        upper = [maximum(comm, float(position[:, a].max(initial=-np.inf))) for a in axes]
        return np.array(lower), np.array(upper)

    def _forget_the_absent(self, p):
        """Free the places of partners that are not even near any more."""
        partner = getattr(p, self.partner)
        kept = np.zeros(partner.shape, bool)
        for i, j in (self._ends, self._ends[::-1]):
            mine = i < p.owned
            for slot in range(partner.shape[1]):
                found = partner[i[mine], slot] == p.id[j[mine]] + 1
                np.logical_or.at(kept[:, slot], i[mine], found)  # a point has several pairs
        partner[~kept] = 0
        getattr(p, self.spring).reshape(*partner.shape, p.dimension)[~kept] = 0.0


@kernel
def _body_normals(near, owned, first, second, weight, position, volume, mass, horizon, normal, dim):
    """a_i and mass of the owned rows that are `near`."""
    total = np.zeros(normal.shape[0])
    normal[:] = 0.0
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        if weight[b] == 0.0 or not (near[i] or near[j]):  # beyond the horizon, or of no concern
            continue
        square = 0.0
        for a in range(len(dim)):
            square += (position[j, a] - position[i, a]) ** 2
        w = 1.0 - square / horizon**2
        total[i] += w * volume[j]
        total[j] += w * volume[i]
        for a in range(len(dim)):
            xi = position[j, a] - position[i, a]
            normal[i, a] += w * volume[j] * xi
            normal[j, a] -= w * volume[i] * xi
    for i in range(owned):
        normal[i, len(dim)] = mass[i]
        for a in range(len(dim)):
            normal[i, a] = normal[i, a] / (horizon * total[i]) if near[i] and total[i] > 0.0 else 0.0


@inlined
def _slot_of(partner, i, key):
    """The place of partner `key` in row i, else the first free place, else -1."""
    free = -1
    for s in range(partner.shape[1]):
        if partner[i, s] == key:
            return s
        if free < 0 and partner[i, s] == 0:
            free = s
    return free


@inlined
def _central_part(normal, i, d):
    """How much of a pair's own direction goes into the normal of point i, for it knows no better: 0 at a surface."""
    square = 0.0
    for a in range(d):
        square += normal[i, a] ** 2
    size = np.sqrt(square)
    return 0.0 if size >= _SURFACE else _SURFACE - size


@inlined
def _separating_normal(xi, normal, i, j, d, n):
    """Fill `n` with the one of the two points' normals that sees them farther apart; how far."""
    distance, own_size, other_size, own_along, other_along = 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(d):
        distance += xi[a] ** 2
    distance = np.sqrt(distance)
    own_central, other_central = _central_part(normal, i, d) / distance, _central_part(normal, j, d) / distance
    for a in range(d):
        own, other = own_central * xi[a] - normal[i, a], other_central * xi[a] + normal[j, a]
        own_size += own**2
        other_size += other**2
        own_along += own * xi[a]
        other_along += other * xi[a]
    own_size, other_size = np.sqrt(own_size), np.sqrt(other_size)
    if own_along / own_size >= other_along / other_size:
        for a in range(d):
            n[a] = (own_central * xi[a] - normal[i, a]) / own_size
        return own_along / own_size
    for a in range(d):
        n[a] = (other_central * xi[a] + normal[j, a]) / other_size
    return other_along / other_size


@inlined
def _release(partner, spring, i, slot, d):
    """Free a place in the memory of point i."""
    partner[i, slot] = 0
    for a in range(d):
        spring[i, slot * d + a] = 0.0


@kernel
def _pair_force(
    first, second, owned, ids, position, velocity, normal, dt, spacing, stiffness, friction, damping, partner,
    spring, contact, shear, dim,
):  # fmt: skip
    """Add the forces of all pairs; the row of a point without a free place, or -1."""
    d = len(dim)
    level = 1.0 if d == 2 else 3.0 / np.pi
    xi, n, slip = np.zeros(d), np.zeros(d), np.zeros(d)
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        for a in range(d):
            xi[a] = position[j, a] - position[i, a]
        along, across, approach = _separating_normal(xi, normal, i, j, d, n), 0.0, 0.0
        for a in range(d):
            approach += (velocity[i, a] - velocity[j, a]) * n[a]
            across += (xi[a] - along * n[a]) ** 2
        across = np.sqrt(across)
        hat = level * (1.0 - across / spacing)
        overlap = spacing - along
        here = _slot_of(partner, i, ids[j] + 1) if i < owned else -1
        there = _slot_of(partner, j, ids[i] + 1) if j < owned else -1
        # what lies more than a spacing behind the other's surface has other points to push it out
        if hat <= 0.0 or overlap <= 0.0 or overlap >= 2.0 * spacing:
            if here >= 0 and partner[i, here] != 0:
                _release(partner, spring, i, here, d)
            if there >= 0 and partner[j, there] != 0:
                _release(partner, spring, j, there, d)
            continue
        if i < owned and here < 0:
            return i
        if j < owned and there < 0:
            return j
        k = stiffness * hat
        elastic = k * overlap
        reduced_mass = normal[i, d] * normal[j, d] / (normal[i, d] + normal[j, d])
        pressure = elastic + 2.0 * damping * np.sqrt(k * reduced_mass) * approach
        if pressure < 0.0:
            pressure = 0.0
        size, along = 0.0, 0.0
        for a in range(d):  # both ends keep the same spring, that of the lower id against the higher
            slip[a] = spring[i, here * d + a] if i < owned else spring[j, there * d + a]
            slip[a] += dt * (velocity[i, a] - velocity[j, a] - approach * n[a])
            along += slip[a] * n[a]
        for a in range(d):
            slip[a] -= along * n[a]  # the interface may have turned
            size += slip[a] ** 2
        size = np.sqrt(size)
        limit = friction * pressure / k
        scale = limit / size if size > limit else 1.0
        # slope of the energy k h^2 / 2 across the normal
        sideways = 0.5 * stiffness * level * overlap**2 / (spacing * across) if across > 0.0 else 0.0
        for a in range(d):
            slip[a] *= scale
            if i < owned:
                spring[i, here * d + a] = slip[a]
            if j < owned:
                spring[j, there * d + a] = slip[a]
            f = elastic * n[a] + sideways * (xi[a] - (spacing - overlap) * n[a])
            contact[i, a] -= f
            contact[j, a] += f
            f = (pressure - elastic) * n[a] + k * slip[a]
            shear[i, a] -= f
            shear[j, a] += f
        if i < owned:
            partner[i, here] = ids[j] + 1
        if j < owned:
            partner[j, there] = ids[i] + 1
    return -1
