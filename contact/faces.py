"""The surface of deformable bodies: the faces that their points carry along, and forces that act on them.

A point knows up to `FACES` faces of its body: how far it is below each, d, and the outward normal n. A point that knows
of none is a ball of one spacing. Both come from the body's shape where it was made; a point that comes to light later
takes its normal from where neighbours are missing,

    a_i = sum_j w V_j xi_ij / (delta sum_j w V_j),  w = 1 - |xi|^2/delta^2,

which points into the body, and vanishes inside. Faces go with the material, whose velocity gradient at the point is L:

    dn/dt = -(I - n n^T) L^T n,  dd/dt = -q d (tr L - n.L n),  q = (K - 2 mu/3) / (K + 4 mu/3).

A depth is thus that of a cell on which nothing presses: it swells where it is squeezed along the face, and what a
pressure does to it is left to the contact. Whatever is a function of faces acts with its conjugate, on the point and
against the point's stress, and has thus a force that does exactly its work, and exact momenta.
"""

import numpy as np

from periporo.contact.gaps import WIDTH, depth_rate, spline
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
    radius of a ball) and the normal (d); `face_gradient` (d*d) 1/s, scratch, what moves the faces: integrity times
    velocity gradient, for a point in a lump has less of one. `moduli` (materials, 2) Pa are K and mu without stress.
    """

    output: tuple[str, ...] = ()

    def __init__(self, sim, moduli: np.ndarray):
        self.sim = sim
        bulk, shear = moduli.T
        self.modulus = bulk + 4.0 / 3.0 * shear  # (materials,) Pa
        self._bulge = (bulk - 2.0 / 3.0 * shear) / self.modulus  # q (materials,)
        self.bulge = np.empty(0)  # q of the points
        self._ids: np.ndarray | None = None  # of the points that this and the rows are of
        self._faced = np.empty(0, np.int64)

    def attach(self, p: Particles) -> None:
        """Declare the point fields."""
        d = p.dimension
        p.add_field(Field("face", 1 + FACES[d] * (1 + d), "1, m, 1"))
        p.add_field(Field("face_gradient", d * d, "1/s", migrates=False))

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

    def update(self, p: Particles, bonds, dt: float) -> None:
        """What a step of `dt` s does to the faces of the owned points, a process of the points."""
        self.know(p)
        self.find_gradients(p)
        _move_faces(self._faced, p.face, self.bulge, p.face_gradient, dt, p.dim)

    def know(self, p: Particles) -> None:
        """Find out anew, after a rebuild, which points have faces and how they bulge."""
        if self._ids is not p.id:
            self._ids, self._faced = p.id, np.flatnonzero(p.face[: p.owned, 2:].any(axis=1))
            self.bulge = self._bulge[p.material]

    def find_gradients(self, p: Particles) -> None:
        """Fill `face_gradient` of the owned points."""
        np.multiply(p.share[: p.owned, 1:2], p.gradient[: p.owned], out=p.face_gradient[: p.owned])

    def renew(self, p: Particles, rows: np.ndarray, touched: np.ndarray) -> np.ndarray:
        """Give those of the owned `rows` that are at a new surface a face: which (total,) got one.

        Those that are `touched` (total,) keep what they have.
        """
        pairs = self.sim.bonds.pairs
        inward, renewed = np.zeros((p.total, p.dimension)), np.zeros(p.total, np.bool_)
        chosen = np.isin(np.arange(p.total), rows)
        near = np.flatnonzero(chosen[pairs.first] | chosen[pairs.second])
        _point_inward(
            near, pairs.first, pairs.second, pairs.weight, p.position, p.volume, self.sim.scheme.horizon, inward, p.dim
        )
        _renew(rows, touched, p.share, inward, 0.5 * self.sim.spacing, p.face, renewed, p.dim)
        self._ids = None
        return renewed


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
def _renew(rows, touched, share, inward, half, face, renewed, dim):
    d = len(dim)
    total = np.zeros(d)
    for k in range(rows.shape[0]):
        i = rows[k]
        if touched[i]:
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
        renewed[i] = True
        for a in range(0 if alone else d):  # else it is a ball
            face[i, 2 + a] = -inward[i, a] / size


@kernel
def _move_faces(rows, face, bulge, gradient, dt, dim):
    """n <- (I - dt L)^T n, to unit length: exact in a rigid rotation if L is that of the step's end."""
    d = len(dim)
    turned = np.zeros(d)
    for k in range(rows.shape[0]):
        i = rows[k]
        for s in range((face.shape[1] - 1) // (1 + d)):
            n = 2 + s * (1 + d)
            square, growth, known = 0.0, 0.0, False
            for a in range(d):
                turned[a] = face[i, n + a]
                known = known or face[i, n + a] != 0.0
                for c in range(d):
                    turned[a] -= dt * gradient[i, c * d + a] * face[i, n + c]
                    growth += depth_rate(face, n, bulge, i, a, c) * gradient[i, a * d + c]
                square += turned[a] ** 2
            if known:
                face[i, n - 1] *= 1.0 + dt * growth
                for a in range(d):
                    face[i, n + a] = turned[a] / np.sqrt(square)
