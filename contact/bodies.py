"""Contact between deformable bodies: an elastic energy of their faces, and Coulomb stick-slip along them.

Two points of different bodies touch if no face of either separates them (`periporo.contact.faces`). How far a face of
point i separates them is xi.n_i - d_i - d_j, with the depth d_j of the other's own face times the cosine between them;
the largest of these, g, is their gap, that of two balls |xi| less a spacing. Each pair has the energy

    k s_i s_j W(t) g^2 / 2  for g < 0,  t^2 = |xi|^2 - (g + d_i + d_j)^2,

s being a point's share of its surface and W the cubic B-spline of four spacings' width, which adds up to one over the
points that face another. Beyond 1.1 spacings of overlap it fades, to nothing at 1.6: a point that lies so deep behind a
face is on the far side of its body. All forces are the slopes of this energy, those through the turning and the
stretching of faces included. So contact gives back what it took, whatever the surfaces look like.

Friction: every point has one spring to what it touches, from where it began to stick, in the mean of its pairs' slips,
weighted by their pressures. It has half of the stiffness along a face, the other half being that of the partners'
springs, and is cut to friction times half of the pressure; so is what it holds shared out. Slip is that of the faces:
what turns together does not slip.
"""

import numpy as np

from periporo.contact.entry import elastic_force
from periporo.contact.faces import Faces
from periporo.contact.gaps import WIDTH, find_gap, find_slip, gap_rate, push, spline, weigh
from periporo.core.numerics.jit import kernel
from periporo.core.points.forces import ForceChannels
from periporo.core.points.neighbours import find_pairs
from periporo.core.points.particles import Field, Particles
from periporo.core.ranks.reductions import any_rank, maximum, minimum
from periporo.errors import ContactError

_ALONG = 0.5  # stiffness along a face over that along its normal
_SOON = 0.5  # spacings of a gap within which a pair counts as one that may touch soon
_OPPOSITE = 0.6  # t up to which the overlap of a pair is one of the bodies, not of a point with a corner
_HASTE = 1.5  # times the present speed, which points may reach before they are looked at again
_TOUCH = 1e-9  # spacings of an overlap that presses
_MOST = 0.5  # spacings by which bodies may overlap when their contact appears in the course of a run


class BodiesContact:
    """Contact between bodies: `stiffness` N/m of two points that face each other, `friction` coefficient and `damping`,
    share of critical damping along the normal, are arrays by the two bodies' numbers; 0 N/m where two do not touch.

    `faces` of the bodies' points, which contacts share. Needs the channels `contact` and `friction`.
    """

    def __init__(self, faces: Faces, stiffness, friction, damping):
        self.stiffness, self.friction, self.damping = stiffness, friction, damping
        self.faces = faces
        self._sim = faces.sim
        self._ids = None  # of the rebuild that the pairs belong to
        self._renewed_in = -1  # rebuild
        self._present = False  # whether there are pairs on any rank
        self._ends = np.empty((2, 0), np.uint32)
        self._pressure, self._arm = np.empty(0), np.empty((0, 0))

    def attach(self, p: Particles, forces: ForceChannels) -> None:
        """Declare what the points keep, and the force channels."""
        d = p.dimension
        if "face" not in p.fields:
            self.faces.attach(p)
            p.add_field(Field("face_spring", d, "m", sent=False))
            p.add_field(Field("face_mass", None, "kg", migrates=False))  # which ghosts lack otherwise
            p.add_field(Field("face_drag", d, "1", migrates=False))  # spring force over normal force
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
        self._sim.halo.update(p, "face", "face_gradient")
        sums = np.zeros((p.owned, 3 + 2 * p.dimension))
        _normal_force(
            self._ends[0], self._ends[1], p.owned, p.body, p.position, p.velocity, p.face, p.face_gradient, p.share,
            p.face_mass, dt, _SOON * self._sim.spacing, self._sim.spacing, self.stiffness, self.friction,
            self.damping, self._pressure, self._arm,
            sums, p.contact_force, p.contact_moment, p.friction_force, p.friction_moment, p.dim,
        )  # fmt: skip
        if self.friction.any():
            _stretch_springs(sums, dt, p.face_spring, p.face_drag, p.dim)
            self._sim.halo.update(p, "face_drag")
            _friction_force(
                self._ends[0], self._ends[1], p.owned, self._pressure, self._arm, p.share, p.face_drag,
                p.friction_force, p.friction_moment, p.dim,
            )  # fmt: skip

    def add_stiffness(self, p: Particles, time: float, ahead: float, stiffness: np.ndarray) -> None:
        """Add the contact's stiffness (N/m) to `stiffness` (owned,) of the points that may touch."""
        self._look(p)
        _add_stiffness(
            self._ends[0], self._ends[1], p.owned, p.body, p.position, p.velocity, ahead, p.face, self._sim.spacing,
            self.stiffness, stiffness, p.dim,
        )  # fmt: skip

    def will_push(self, p: Particles, time: float, until: float) -> bool:
        """Nothing that moves by itself."""
        return False

    def resist(
        self, p: Particles, time: float, ahead: float, dt: float, force: np.ndarray, moment: np.ndarray
    ) -> None:
        """Add what pairs that may touch soon hold against a motion with `velocity` for `dt`: forces on their faces."""
        self._look(p)
        if not self._present:
            return
        self.faces.find_gradients(p)
        self._sim.halo.update(p, "face_gradient")
        _resist(
            self._ends[0], self._ends[1], p.owned, p.body, p.position, p.velocity, p.face, p.face_gradient, p.share,
            dt, self._sim.spacing, self.stiffness, self.friction, force, moment, p.dim,
        )  # fmt: skip

    def _look(self, p):
        """Pairs that may touch before the next rebuild, in the order of their ids; none if the bodies are far apart."""
        if self._ids is p.id:
            return
        self._ids = p.id
        reach = self._sim.farthest
        ends = find_pairs(p, self._meeting(p, reach), np.zeros(p.total, np.int64), reach)
        touching = self.stiffness[p.body[ends[0]], p.body[ends[1]]] > 0.0
        self._ends = np.ascontiguousarray(ends[:, touching])
        self._present = any_rank(self._sim.comm, self._ends.size > 0)
        n, d = self._ends.shape[1], p.dimension
        self._pressure, self._arm = np.zeros(n), np.zeros((n, 2 * d))
        p.face_mass[: p.owned] = p.mass
        self._sim.halo.update(p, "face_mass")

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
        """After a rebuild, faces for points that came to a surface, such that nothing presses that did not before."""
        sim = self._sim
        if sim.rebuilt_at != sim.step_number or sim.rebuild_count == self._renewed_in:
            return
        self._renewed_in = sim.rebuild_count
        pairs = self.stiffness > 0.0
        rows = np.unique(self._ends)
        touched = self._overlaps(p, pairs, WIDTH) > _TOUCH * sim.spacing
        renewed = self.faces.renew(p, rows[rows < p.owned], touched)
        sim.halo.update(p, "face")
        self._draw_back(p, pairs, renewed, 1.0)

    def _draw_back(self, p, pairs, rows, part):
        """Make the depths of the points `rows` (total,) less by this part of their overlaps, so that they vanish."""
        for _ in range(4):  # faces at an angle need more than one
            overlap = np.where(rows, part * self._overlaps(p, pairs, WIDTH), 0.0)[: p.owned]
            p.face[: p.owned, 1 :: 1 + p.dimension] -= overlap[:, None]
            self._sim.halo.update(p, "face")

    def _overlaps(self, p, pairs, within):
        """Deepest overlap (total,) m of each point in the `pairs` of bodies; complete for those owned."""
        deepest = np.zeros(p.total)
        _find_overlaps(
            self._ends[0], self._ends[1], p.body, p.position, p.face, self._sim.spacing, pairs,
            spline(within, p.dimension), deepest, p.dim,
        )  # fmt: skip
        return deepest


@kernel
def _find_overlaps(first, second, body, position, face, spacing, pairs, least, deepest, dim):
    d = len(dim)
    xi, slope, arm, turn = np.zeros(d), np.zeros(d), np.zeros(2 * d), np.zeros(2 * d * d)
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        if not pairs[body[i], body[j]]:
            continue
        gap = find_gap(position, face, i, j, spacing, xi, slope, arm, turn, d)
        weight, _ = weigh(xi, gap, face[i, 1] + face[j, 1], spacing, d)
        if gap < 0.0 and weight > least:
            deepest[i] = max(deepest[i], -gap)
            deepest[j] = max(deepest[j], -gap)


@kernel
def _add_stiffness(
    first, second, owned, body, position, velocity, ahead, face, spacing, stiffness, total, dim
):
    d = len(dim)
    xi, slope, arm, turn = np.zeros(d), np.zeros(d), np.zeros(2 * d), np.zeros(2 * d * d)
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        gap, approach = find_gap(position, face, i, j, spacing, xi, slope, arm, turn, d), 0.0
        for a in range(d):
            approach += slope[a] * (velocity[i, a] - velocity[j, a])
        if not gap < max(_SOON * spacing, _HASTE * ahead * approach):
            continue
        weight, _ = weigh(xi, gap, face[i, 1] + face[j, 1], spacing, d)
        k = 2.0 * stiffness[body[i], body[j]] * face[i, 0] * face[j, 0] * weight
        if i < owned:
            total[i] += k
        if j < owned:
            total[j] += k


@kernel
def _resist(
    first, second, owned, body, position, velocity, face, gradient, share, dt, spacing, stiffness, friction, force,
    moment, dim,
):  # fmt: skip
    """Force and moments of linear springs in place of all pairs that may touch soon."""
    d = len(dim)
    n = d * d
    xi, slope, arm, turn, slip = np.zeros(d), np.zeros(d), np.zeros(2 * d), np.zeros(2 * n), np.zeros(d)
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        gap = find_gap(position, face, i, j, spacing, xi, slope, arm, turn, d)
        if not gap < _SOON * spacing:
            continue
        weight, _ = weigh(xi, gap, face[i, 1] + face[j, 1], spacing, d)
        k = dt * stiffness[body[i], body[j]] * face[i, 0] * face[j, 0] * weight
        pull = k * gap_rate(velocity, gradient, i, j, slope, turn, d)
        find_slip(velocity, gradient, i, j, slope, arm, slip, d)
        along = _ALONG * k if friction[body[i], body[j]] > 0.0 else 0.0
        for a in range(d):
            force[i, a] += pull * slope[a] - along * slip[a]
            force[j, a] -= pull * slope[a] - along * slip[a]
            for c in range(d):
                if i < owned:
                    moment[i, a * d + c] += share[i, 1] * (pull * turn[a * d + c] - along * slip[a] * arm[c])
                if j < owned:
                    moment[j, a * d + c] += share[j, 1] * (pull * turn[n + a * d + c] + along * slip[a] * arm[d + c])


@kernel
def _normal_force(
    first, second, owned, body, position, velocity, face, gradient, share, mass, dt, soon, spacing, stiffness, friction,
    damping, pressures, arms, sums, contact, contact_moment, shear, shear_moment, dim,
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
        gap = find_gap(position, face, i, j, spacing, xi, slope, arm, turn, d)
        if gap >= soon:
            continue
        way = dt * gap_rate(velocity, gradient, i, j, slope, turn, d)
        if gap >= max(way, 0.0):
            continue
        reach = face[i, 1] + face[j, 1]
        weight, steepness = weigh(xi, gap, reach, spacing, d)
        if weight == 0.0:
            continue
        law = stiffness[body[i], body[j]]
        k = law * face[i, 0] * face[j, 0]
        reduced = mass[i] * mass[j] / (mass[i] + mass[j])
        energy, slope_of_it = push(min(gap, 0.0), spacing)
        elastic = elastic_force(k * weight, -gap, -way, dt * dt / reduced)
        elastic += k * weight * (min(gap, 0.0) - slope_of_it)  # where it fades
        sideways = k * energy * steepness  # d energy/d xi, over xi
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
                    through = share[p, 1] * nearest * face[p, 2 + a] * face[p, 2 + c]
                    contact_moment[p, a * d + c] += deeper * part + through
                    shear_moment[p, a * d + c] -= viscous * part
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


@kernel
def _stretch_springs(sums, dt, spring, drag, dim):
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
        k = 0.5 * _ALONG * sums[i, 2]
        limit = 0.5 * sums[i, 1] / k
        scale = limit / size if size > limit else 1.0
        for a in range(d):
            spring[i, a] *= scale
            drag[i, a] = k * spring[i, a] / pressure


@kernel
def _friction_force(first, second, owned, pressures, arms, share, drag, shear, moment, dim):
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
