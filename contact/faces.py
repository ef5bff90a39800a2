"""The surface of deformable bodies: the faces that their points carry along, and forces that act on them.

A point knows up to `FACES` faces of its body: how far it is below each, d, and the outward normal n. A point that knows
of none is a ball of one spacing. Both come from the body's shape where it was made; a point that comes to light later
takes its normal from where neighbours are missing,

    a_i = sum_j w V_j xi_ij / (delta sum_j w V_j),  w = 1 - |xi|^2/delta^2,

which points into the body, and vanishes inside. Faces go with the material, whose velocity gradient at the point is L:

    dn/dt = -(I - n n^T) L^T n,  dd/dt = d n.L n,

and move with v + L n d. A force on a face acts with its conjugate: on the point, and with its moment, force (x) n d, on
the neighbours through which L sees it. Whatever is a function of faces has thus a force that does exactly its work, and
exact momenta.
"""

import numpy as np

from periporo.contact.gaps import WIDTH, spline
from periporo.core.numerics import algebra as la
from periporo.core.numerics.jit import kernel
from periporo.core.points.particles import Field, Particles
from periporo.core.ranks.reductions import maximum

FACES = {2: 3, 3: 4}
"""Faces that a point can know: those of a corner, and the opposite one of a thin plate."""
REACH = 1.5
"""Spacings below a face up to which a point knows of it."""
_SURFACE = 0.1  # |a| from which on a point is at its body's surface; it is about 0.2 at a flat one
_AGREE = 0.8  # cosine between a face's normal and -a below which the face is no longer where it was
_SAME = 0.8  # cosine between the normals of two points' faces that are one face


class Faces:
    """Faces of the points of the simulation `sim`.

    Point fields: `face` holds the point's share of its body's surface (1), then for each face the depth (m, or the
    radius of a ball) and the normal (d); `face_gradient` (d*d) 1/s and `face_moment` (2 d*d), of the channels `contact`
    and `friction`, are scratch, as is `face_near`: whether a point may touch another.
    """

    def __init__(self, sim):
        self.sim = sim
        self.near = np.empty(0, np.int64)  # pairs of neighbours that make the faces move
        self.rows = np.empty(0, np.int64)

    def attach(self, p: Particles) -> None:
        """Declare the point fields."""
        d = p.dimension
        p.add_field(Field("face", 1 + FACES[d] * (1 + d), "1, m, 1"))
        p.add_field(Field("face_gradient", d * d, "1/s", migrates=False))
        p.add_field(Field("face_moment", 2 * d * d, "", migrates=False))
        p.add_field(Field("face_near", None, "1", migrates=False))

    def share_out(self, sim) -> None:
        """Make up for the rows of a face that end at an edge, or that a lattice cuts in steps; once, at the start."""
        p, pairs = sim.particles, sim.bonds.pairs
        _share_out(pairs.first, pairs.second, p.owned, p.position, p.face, sim.spacing, p.dim)
        sim.halo.update(p, "face")

    def find_reach(self, owned: dict[str, np.ndarray]) -> float:
        """Distance (m) within which two of all points (fields of those `owned`) may touch; collective."""
        spacing, face = self.sim.spacing, owned["face"]
        depth = maximum(self.sim.comm, float(face[face[:, 0] > 0.0, 1].max(initial=0.5 * spacing)))
        return float(np.hypot(WIDTH * spacing, 2.0 * depth) + self.sim.skin)

    def follow(self, p: Particles, rows: np.ndarray) -> None:
        """Look after the faces of the points `rows`, on other ranks too, until the next rebuild; collective."""
        pairs = self.sim.bonds.pairs
        p.face_near[:] = 0.0
        p.face_near[rows] = 1.0
        self.sim.halo.update(p, "face_near")  # a ghost may touch what is no ghost here
        wanted = p.face_near > 0.0
        self.rows = np.flatnonzero(wanted)
        self.near = np.flatnonzero(wanted[pairs.first] | wanted[pairs.second])

    def renew(self, p: Particles, touched: np.ndarray) -> np.ndarray:
        """Give points at a new surface a face: which (total,) got one.

        Those that are `touched` (total,) keep what they have.
        """
        pairs = self.sim.bonds.pairs
        inward, renewed = np.zeros((p.total, p.dimension)), np.zeros(p.total, np.bool_)
        _point_inward(
            self.near, pairs.first, pairs.second, pairs.weight, p.position, p.volume, self.sim.scheme.horizon, inward,
            p.dim,
        )  # fmt: skip
        _renew(self.rows, p.owned, touched, p.share, inward, 0.5 * self.sim.spacing, p.face, renewed, p.dim)
        return renewed

    def move(self, p: Particles, dt: float) -> None:
        """Velocity gradients of the points, and what they do to the faces in `dt`; collective."""
        self.find_gradients(p)
        _move_faces(self.rows, p.face, p.face_gradient, dt, p.dim)

    def find_gradients(self, p: Particles) -> None:
        """Fill `face_gradient`; collective."""
        pairs = self.sim.bonds.pairs
        _find_gradients(
            self.near, self.rows, p.owned, pairs.first, pairs.second, pairs.weight, p.position, p.velocity, p.volume,
            p.shape_inverse, p.share, p.face_gradient, p.dim,
        )  # fmt: skip
        self.sim.halo.update(p, "face_gradient")

    def spread(self, p: Particles, *forces: np.ndarray) -> None:
        """Add the forces of the moments of each channel to the array of that channel; collective."""
        pairs = self.sim.bonds.pairs
        _close_moments(self.rows, p.owned, p.shape_inverse, p.share, p.face_moment, p.dim)
        self.sim.halo.update(p, "face_moment")
        for channel, force in enumerate(forces):
            _spread_moments(
                self.near, pairs.first, pairs.second, pairs.weight, p.position, p.volume, p.face_moment, channel,
                force, p.dim,
            )  # fmt: skip


def hat(depth: np.ndarray, spacing: float) -> np.ndarray:
    """Share of its body's surface that a point has at a depth (n,) m below it: one row has it all, two share it."""
    return np.clip(1.0 - np.abs(depth / spacing - 0.5), 0.0, 1.0)


@kernel
def _share_out(first, second, owned, position, face, spacing, dim):
    """Divide each point's share by the root of what it and its neighbours have of its nearest face; that is 1 inside.

    Two points in contact share twice, so that both together divide by the whole.
    """
    d = len(dim)
    whole = np.zeros(face.shape[0])
    for i in range(face.shape[0]):
        whole[i] = face[i, 0] * spline(0.0, d)
    for b in range(first.shape[0]):
        for side in range(2):
            i, j = (first[b], second[b]) if side == 0 else (second[b], first[b])
            xi = la.difference(position, i, j, dim)
            along, unit, same = 0.0, 0.0, 0.0
            for a in range(d):
                along += xi[a] * face[i, 2 + a]
                unit += face[i, 2 + a] ** 2
            for s in range((face.shape[1] - 1) // (1 + d)):
                cosine = 0.0
                for a in range(d):
                    cosine += face[i, 2 + a] * face[j, 2 + s * (1 + d) + a]
                same = max(same, cosine)
            if unit > 0.0 and same > _SAME:
                whole[i] += face[j, 0] * spline(np.sqrt(max(la.dot(xi, xi) - along**2, 0.0)) / spacing, d)
    for i in range(owned):
        if face[i, 0] > 0.0 and whole[i] > 0.0:
            face[i, 0] /= np.sqrt(whole[i])


@kernel
def _point_inward(near, first, second, weight, position, volume, horizon, inward, dim):
    """a of the points whose pairs are all in `near`."""
    total = np.zeros(inward.shape[0])
    for k in range(near.shape[0]):
        b = near[k]
        i, j = first[b], second[b]
        if weight[b] == 0.0:
            continue
        xi = la.difference(position, i, j, dim)
        w = 1.0 - la.dot(xi, xi) / horizon**2
        total[i] += w * volume[j]
        total[j] += w * volume[i]
        for a in range(len(dim)):
            inward[i, a] += w * volume[j] * xi[a]
            inward[j, a] -= w * volume[i] * xi[a]
    for i in range(inward.shape[0]):
        for a in range(len(dim)):
            inward[i, a] = inward[i, a] / (horizon * total[i]) if total[i] > 0.0 else 0.0


@kernel
def _renew(rows, owned, touched, share, inward, half, face, renewed, dim):
    d = len(dim)
    total = np.zeros(d)
    for k in range(rows.shape[0]):
        i = rows[k]
        if i >= owned or touched[i]:
            continue
        square = 0.0
        for a in range(d):
            square += inward[i, a] ** 2
        size = np.sqrt(square)
        total[:] = 0.0
        agrees = False
        for s in range((face.shape[1] - 1) // (1 + d)):
            along = 0.0
            for a in range(d):
                total[a] += face[i, 2 + s * (1 + d) + a]
                along -= face[i, 2 + s * (1 + d) + a] * inward[i, a]
            agrees = agrees or along > _AGREE * size
        along, square = 0.0, 0.0
        for a in range(d):
            along -= total[a] * inward[i, a]
            square += total[a] ** 2
        agrees = agrees or along > _AGREE * size * np.sqrt(square)  # a corner sees the mean of its faces
        alone = size == 0.0 or share[i, 1] == 0.0
        if not alone and (agrees or size < _SURFACE):
            continue
        face[i, :] = 0.0
        face[i, 0], face[i, 1] = 1.0, half
        if alone:  # a ball
            continue
        for a in range(d):
            face[i, 2 + a] = -inward[i, a] / size
        renewed[i] = True


@kernel
def _find_gradients(
    near, rows, owned, first, second, weight, position, velocity, volume, shape_inverse, share, gradient, dim
):
    """Integrity times velocity gradient of the owned points among `rows`: a point in a lump has less of one."""
    for k in range(rows.shape[0]):
        gradient[rows[k], :] = 0.0
    for k in range(near.shape[0]):
        b = near[k]
        if weight[b] == 0.0:
            continue
        i, j = first[b], second[b]
        moment = la.dyad(la.difference(velocity, i, j, dim), la.difference(position, i, j, dim))
        for c in range(gradient.shape[1]):
            gradient[i, c] += weight[b] * volume[j] * moment[c]
            gradient[j, c] += weight[b] * volume[i] * moment[c]
    for k in range(rows.shape[0]):
        i = rows[k]
        if i < owned:
            moment = la.scaled(la.matrix_at(gradient, i, 0, dim), share[i, 1])
            la.store(gradient, i, 0, la.times_shape(moment, la.shape_at(shape_inverse, i, 0, dim)))


@kernel
def _move_faces(rows, face, gradient, dt, dim):
    """n <- (I - dt L)^T n, to unit length: exact in a rigid rotation if L is that of the step's end."""
    d = len(dim)
    turned = np.zeros(d)
    for k in range(rows.shape[0]):
        i = rows[k]
        for s in range((face.shape[1] - 1) // (1 + d)):
            n = 2 + s * (1 + d)
            square, stretch, known = 0.0, 0.0, False
            for a in range(d):
                turned[a] = face[i, n + a]
                known = known or face[i, n + a] != 0.0
                for c in range(d):
                    turned[a] -= dt * gradient[i, c * d + a] * face[i, n + c]
                    stretch += face[i, n + a] * gradient[i, a * d + c] * face[i, n + c]
                square += turned[a] ** 2
            if known:
                face[i, n - 1] *= 1.0 + dt * stretch
                for a in range(d):
                    face[i, n + a] = turned[a] / np.sqrt(square)


@kernel
def _close_moments(rows, owned, shape_inverse, share, moment, dim):
    """M K^-1, with the integrity that the gradient has, of both channels of the owned points."""
    n = len(dim) * len(dim)
    for k in range(rows.shape[0]):
        i = rows[k]
        if i >= owned:
            continue
        for channel in range(2):
            m = la.scaled(la.matrix_at(moment, i, channel * n, dim), share[i, 1])
            la.store(moment, i, channel * n, la.times_shape(m, la.shape_at(shape_inverse, i, 0, dim)))


@kernel
def _spread_moments(near, first, second, weight, position, volume, moment, channel, force, dim):
    start = channel * len(dim) * len(dim)
    for k in range(near.shape[0]):
        b = near[k]
        if weight[b] == 0.0:
            continue
        i, j = first[b], second[b]
        xi = la.difference(position, i, j, dim)
        own = la.apply(la.matrix_at(moment, i, start, dim), xi)
        other = la.apply(la.matrix_at(moment, j, start, dim), xi)
        for a in range(len(dim)):
            pull = weight[b] * (volume[j] * own[a] + volume[i] * other[a])
            force[i, a] -= pull
            force[j, a] += pull
