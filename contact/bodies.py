"""Contact between deformable bodies: an elastic energy of their faces, and Coulomb stick-slip along them.

Two points of different bodies touch if no face of either separates them (`periporo.contact.faces`). How far a face of
point i separates them is xi.n_i - d_i - d_j, with the depth d_j of the other's own face times the cosine between them;
the largest of these, g, is their gap, that of two balls |xi| less a spacing. Each pair has the energy

    k s_i s_j W(t) g^2 / 2  for g < 0,  t^2 = |xi|^2 - (g + d_i + d_j)^2,

s being a point's share of its surface and W the cubic B-spline of four spacings' width, which adds up to one over the
points that face another. Beyond 1.1 spacings of overlap it fades, to nothing at 1.6: a point that lies so deep behind a
face is on the far side of its body. k is that of the outer halves of two cells, one behind the other, and stands in
their place: while a pair presses, the energy

    a s_i s_j W(t) (d_i/M_i + d_j/M_j) tau^2 / 2,  tau = (d_i tau_i/M_i + d_j tau_j/M_j) / (d_i/M_i + d_j/M_j),

with the area a of a cell, tau_i = n.sigma_i n and M = K + 4 mu/3, is the contact's and no longer the cells'. d_i counts
here times integrity and volume ratio of its point: what is torn or crushed cannot give more than it holds. So contact
has no softness of its own: waves pass, and a uniform stress presses as it would inside a body. The stress of a point
counts less for it by

    a s_i s_j W(t) d_i tau (n (x) n + q (I - n (x) n)),

with q of `periporo.contact.faces`, which is the lever of the contact's force. Both energies fade as the faces of a pair
turn to a right angle, where they do not meet. All forces are the slopes of these energies, those through the turning
and the bulging of faces included; only where a pair begins or ceases to press under a tau that is not zero is there a
step. So contact gives back what it took, whatever the surfaces look like.

Friction: every point has one spring to what it touches, from where it began to stick, in the mean of its pairs' slips,
weighted by their pressures. It has half of the stiffness along a face (a quarter of k), the other half being that of
the partners' springs, and is cut to friction times half of the pressure; so is what it holds shared out. Slip is that
of the faces: what turns together does not slip.
"""

from collections.abc import Sequence

import numpy as np

from periporo.contact.faces import Faces
from periporo.contact.gaps import WIDTH, spline
from periporo.contact.pairs import (
    SOON,
    add_friction_force,
    add_normal_force,
    add_pair_stiffness,
    find_overlaps,
    resist_pairs,
    stretch_springs,
)
from periporo.core.numerics.tensors import square_lengths
from periporo.core.points.forces import ForceChannels
from periporo.core.points.neighbours import find_pairs
from periporo.core.points.particles import Field, Particles
from periporo.core.ranks.reductions import any_rank, maximum, minimum
from periporo.errors import ContactError

_OPPOSITE = 0.6  # t up to which the overlap of a pair is one of the bodies, not of a point with a corner
_TOUCH = 1e-9  # spacings of an overlap that presses
_MOST = 0.5  # spacings by which bodies may overlap when their contact appears in the course of a run
_AROUND, _AMONG = 1.75, 0.75  # spacings within which points of a body lie around one that is inside it, and the nearest
_ONE_SIDED = 0.25  # length of the mean direction to them, from which on they do not surround it


class BodiesContact:
    """Contact between bodies: `stiffness` N/m of two points that face each other, `friction` coefficient and `damping`,
    share of critical damping along the normal, are arrays by the two bodies' numbers; 0 N/m where two do not touch.

    `names` of the bodies; `faces` of their points, which contacts share. Needs the channels `internal`, `contact` and
    `friction`. Its `pairs` (2, n) are the points that may touch, `pressures` (n,) N what they press on each other.
    """

    def __init__(self, faces: Faces, names: Sequence[str], stiffness, friction, damping):
        self.stiffness, self.friction, self.damping = stiffness, friction, damping
        self.faces = faces
        self._names = names
        self._sim = faces.sim
        self._ids = None  # of the rebuild that the pairs belong to
        self._renewed_in = -1  # rebuild
        self._present = False  # whether there are pairs on any rank
        self.pairs = np.empty((2, 0), np.uint32)
        self._rows = np.empty(0, np.int64)  # owned ends
        self.pressures, self._arm = np.empty(0), np.empty((0, 0))
        self._soon = np.empty(0, np.bool_)  # pairs that touch, or may soon
        self.closing = 0.0  # m/s, as of a `RigidContact`
        self.breach: tuple[float, np.ndarray, str] | None = None  # a point inside another body: inf, where, which body

    def attach(self, p: Particles, forces: ForceChannels) -> None:
        """Declare what the points keep, and the force channels."""
        d = p.dimension
        if "face" not in p.fields:
            self.faces.attach(p)
            p.add_field(Field("face_spring", d, "m", sent=False))
            p.add_field(Field("face_entered", None, "1", sent=False))  # rebuild in which it was inside another body
            p.add_field(Field("face_mass", None, "kg", migrates=False))  # which ghosts lack otherwise
            p.add_field(Field("face_drag", d, "1", migrates=False))  # spring force over normal force
            p.add_field(Field("face_stress", p.components, "Pa", migrates=False))  # of the points
        forces.need("internal", on_faces=True)
        forces.need("contact", on_faces=True)
        forces.need("friction", on_faces=True)

    def appear(self, p: Particles, time: float, before: list | None) -> None:
        """Begin to act, after the contacts `before`, which end; None at the start of a run.

        What overlaps between bodies that did not touch so far presses from here on. Raises ContactError if it is more
        than half a spacing. Collective.
        """
        known = np.zeros_like(self.stiffness)
        for contact in before or ():
            if isinstance(contact, BodiesContact):
                known = np.maximum(known, contact.stiffness)
        new = (self.stiffness > 0.0) & (known == 0.0)
        self._look(p)
        self._refuse(p, self._overlaps(p, new, _OPPOSITE))
        self._draw_back(p, new, np.ones(p.total, bool), 0.5)

    def _refuse(self, p, overlap):
        deepest = maximum(self._sim.comm, float(overlap[: p.owned].max(initial=0.0)))
        if deepest > _MOST * self._sim.spacing:
            raise ContactError(
                f"bodies overlap by {deepest:.3g} m when their contact appears, more than half a spacing: let it "
                "appear before they meet, or move them apart"
            )

    def deepest_overlaps(self, p: Particles) -> list[tuple[int, int, float, list[float]]]:
        """Pairs of bodies (numbers) that overlap at present, how far (m), and where; collective."""
        self._look(p)
        found = []
        for first, second in zip(*np.nonzero(np.triu(self.stiffness)), strict=True):
            pair = np.zeros_like(self.stiffness, bool)
            pair[first, second] = pair[second, first] = True
            overlap = self._overlaps(p, pair, _OPPOSITE)[: p.owned]
            worst = int(overlap.argmax()) if p.owned else -1
            mine = (overlap[worst], p.position[worst].tolist()) if p.owned else (0.0, [])
            deepest, place = max(self._sim.comm.allgather(mine))
            if deepest > 0.0:
                found.append((int(first), int(second), float(deepest), place))
        return found

    def add_force(self, p: Particles, time: float, dt: float) -> None:
        """Add normal and friction force; velocities are those of the middle of the step. Collective."""
        self._look(p)
        if not self._present:
            return
        self._renew(p)
        self._find_stress(p)
        self._sim.halo.update(p, "face", "face_gradient", "face_stress", "share")
        sums = np.zeros((p.owned, 3 + 2 * p.dimension))
        add_normal_force(
            self.pairs[0], self.pairs[1], p.owned, p.body, p.position, p.velocity, p.face, self.faces.bulge,
            p.face_gradient, p.face_stress, self.faces.modulus[p.material], p.share, p.face_mass, dt,
            SOON * self._sim.spacing, self._sim.spacing, self.stiffness, self.friction, self.damping, self.pressures,
            self._arm, sums, p.contact_force, p.contact_moment, p.friction_force, p.friction_moment, p.internal_moment,
            p.dim,
        )  # fmt: skip
        if self.friction.any():
            stretch_springs(sums, dt, p.face_spring, p.face_drag, p.dim)
            self._sim.halo.update(p, "face_drag")
            add_friction_force(
                self.pairs[0], self.pairs[1], p.owned, self.pressures, self._arm, p.share, p.face_drag,
                p.friction_force, p.friction_moment, p.dim,
            )  # fmt: skip

    def add_stiffness(self, p: Particles, time: float, ahead: float, stiffness: np.ndarray) -> None:
        """Add the contact's stiffness (N/m) to `stiffness` (owned,) of the points that touch, or may `ahead` (s)."""
        self._look(p)
        self.closing = add_pair_stiffness(
            self.pairs[0], self.pairs[1], p.owned, p.body, p.position, p.velocity, ahead, p.face, self.faces.bulge,
            self._sim.spacing, self.stiffness, self._soon, stiffness, p.dim,
        )  # fmt: skip

    def will_push(self, p: Particles, time: float, until: float) -> bool:
        """Nothing that moves by itself."""
        return False

    def resist(self, p: Particles, dt: float, force: np.ndarray, moment: np.ndarray) -> None:
        """Add what those pairs hold against a motion with `velocity` for `dt`: forces on their faces."""
        self._look(p)
        if not self._present:
            return
        self.faces.find_gradients(p)
        self._find_stress(p)
        self._sim.halo.update(p, "face_gradient", "face_stress", "share")
        resist_pairs(
            self.pairs[0], self.pairs[1], self._soon, p.owned, p.body, p.position, p.velocity, p.face,
            self.faces.bulge, p.face_gradient, p.face_stress, self.faces.modulus[p.material], p.share, dt,
            self._sim.spacing, self.stiffness, self.friction, force, moment, p.dim,
        )  # fmt: skip

    def _find_stress(self, p):
        """Stress of the owned points that may touch."""
        self._sim.bonds.total_stress(p, self._rows, p.face_stress)

    def _look(self, p):
        """Pairs that may touch before the next rebuild, in the order of their ids; none if the bodies are far apart."""
        if self._ids is p.id:
            return
        self._ids = p.id
        self.faces.know(p)
        reach = self._sim.farthest
        ends = find_pairs(p, self._meeting(p, reach), np.zeros(p.total, np.int64), reach)
        touching = self.stiffness[p.body[ends[0]], p.body[ends[1]]] > 0.0
        self.pairs = np.ascontiguousarray(ends[:, touching])
        rows = np.unique(self.pairs).astype(np.int64)
        self._rows = rows[rows < p.owned]
        self._present = any_rank(self._sim.comm, self.pairs.size > 0)
        n, d = self.pairs.shape[1], p.dimension
        self.pressures, self._arm, self._soon = np.zeros(n), np.zeros((n, 2 * d)), np.zeros(n, np.bool_)
        p.face_mass[: p.owned] = p.mass
        self._sim.halo.update(p, "face_mass")
        self._note_entries(p)

    def _note_entries(self, p):
        """Remember which points are inside other bodies; those that were so at the rebuild before have passed."""
        rows, others = self._inside(p)
        stays = p.face_entered[rows] == self._sim.rebuild_count - 1.0
        self._note_breach(p, rows[stays], others[stays])
        p.face_entered[:] = 0.0
        p.face_entered[rows] = self._sim.rebuild_count

    def look_behind(self, p: Particles) -> None:
        """Note a point that has passed the faces of another body."""
        self._look(p)
        self._note_breach(p, *self._inside(p))

    def _note_breach(self, p, rows, others):
        self.breach = None
        if len(rows):
            self.breach = np.inf, p.position[rows[0]].copy(), f"body '{self._names[others[0]]}'"

    def _inside(self, p):
        """Owned rows of points that points of another body are close to and surround, and numbers of these bodies.

        What a corner, a slot or two bodies hold between them has none so close.
        """
        i, j = self.pairs.astype(np.int64)
        way = (p.position[j] - p.position[i]) / self._sim.spacing
        distance = np.sqrt(square_lengths(way))
        near = (distance < _AROUND) & (distance > 0.0)
        i, j, way, distance = i[near], j[near], way[near], distance[near]
        rows, others = np.concatenate([i, j]), p.body[np.concatenate([j, i])]
        distance, direction = np.tile(distance, 2), np.concatenate([way, -way]) / np.tile(distance, 2)[:, None]
        places, at = np.unique(np.stack([rows, others]), axis=1, return_inverse=True)
        count, nearest = np.bincount(at, minlength=places.shape[1]), np.full(places.shape[1], np.inf)
        np.minimum.at(nearest, at, distance)
        mean = np.stack([np.bincount(at, c, places.shape[1]) for c in direction.T], axis=1) / count[:, None]
        surrounded = (count >= 3 * p.dimension) & (square_lengths(mean) < _ONE_SIDED**2)
        return places[:, surrounded & (nearest < _AMONG) & (places[0] < p.owned)]

    def _meeting(self, p, reach):
        """Rows within `reach` of the box around a body that their own body touches."""
        boxes = [self._bounds(p.position[: p.owned][p.body[: p.owned] == b]) for b in range(len(self.stiffness))]
        chosen = np.zeros(p.total, bool)
        for own in range(len(boxes)):
            rows = np.flatnonzero(p.body == own)
            x = p.position[rows]
            for lower, upper in (boxes[b] for b in np.flatnonzero(self.stiffness[own])):
                chosen[rows] |= ((x >= lower - reach) & (x <= upper + reach)).all(axis=1)
        return np.flatnonzero(chosen)

    def _bounds(self, position):
        """Lower and upper corner (d,) m of all ranks' points."""
        comm, axes = self._sim.comm, range(position.shape[1])
        lower = [minimum(comm, float(position[:, a].min(initial=np.inf))) for a in axes]
        upper = [maximum(comm, float(position[:, a].max(initial=-np.inf))) for a in axes]
        return np.array(lower), np.array(upper)

    def _renew(self, p):
        """After a rebuild, faces for points that came to a surface, such that nothing presses that did not before.

        A point that lies so that no face of its own depth can do without keeps what it has.
        """
        sim = self._sim
        if sim.rebuilt_at != sim.step_number or sim.rebuild_count == self._renewed_in:
            return
        self._renewed_in = sim.rebuild_count
        pairs = self.stiffness > 0.0
        touched = self._overlaps(p, pairs, WIDTH) > _TOUCH * sim.spacing
        before = p.face[: p.owned].copy()
        renewed = self.faces.renew(p, self._rows, touched)
        sim.halo.update(p, "face")
        while any_rank(sim.comm, renewed.any()):
            self._draw_back(p, pairs, renewed, 1.0)
            presses = self._overlaps(p, pairs, WIDTH) > _TOUCH * sim.spacing
            given_up = renewed[: p.owned] & (presses[: p.owned] | ~(p.face[: p.owned, 1] > 0.0))
            if not any_rank(sim.comm, given_up.any()):
                break
            p.face[: p.owned][given_up] = before[given_up]
            renewed[: p.owned][given_up] = False
            sim.halo.update(p, "face")
        self.faces.know(p)

    def _draw_back(self, p, pairs, rows, part):
        """Make the depths of the points `rows` (total,) less by this part of their overlaps, so that they vanish."""
        for _ in range(4):  # faces at an angle need more than one
            overlap = np.where(rows, part * self._overlaps(p, pairs, WIDTH), 0.0)[: p.owned]
            p.face[: p.owned, 1 :: 1 + p.dimension] -= overlap[:, None]
            self._sim.halo.update(p, "face")

    def _overlaps(self, p, pairs, within):
        """Deepest overlap (total,) m of each point in the `pairs` of bodies; complete for those owned."""
        deepest = np.zeros(p.total)
        find_overlaps(
            self.pairs[0], self.pairs[1], p.body, p.position, p.face, self.faces.bulge, self._sim.spacing, pairs,
            spline(within, p.dimension), deepest, p.dim,
        )  # fmt: skip
        return deepest
