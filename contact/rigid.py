"""Contact of points with rigid analytic surfaces: penalty along the normal, Coulomb stick-slip along the surface.

A point stands for a cell, whose face (`periporo.core.points.faces`) is what touches. It lies on the way to the surface,
where the cell ends: half a spacing from the point at first, and as the cell is squeezed between point and surface, or
stretched, its reach l follows the point's velocity gradient L along the normal n,

    dl/dt = d n . L n,

with d the lever of the face, the distance g of the point from the surface; beyond .7 spacings it falls to 0 at a
spacing. The overlap h = l - g has the rate of the face's approach, so that the normal force k h has the potential
k h^2 / 2 and a closed path gains no energy. A cell that is off the surface by more than a tenth of a spacing reaches
half a spacing again, or as far as there is room. Soil that flows changes its neighbours and not its spacing: where a
scheme rearranges its points, `guide` moves point and cell together, without a change of force. A step that begins or
ends off the surface does the work of the potential all the same (`periporo.contact.entry`).

The tangential force is a spring on the face from where it began to stick; where it would exceed friction times the
normal force, the spring is cut to that and the face slides (Cundall & Strack 1979). The channel `contact` holds the
elastic normal force, `friction` the tangential force and the normal damping, which acts on the point: a face has less
mass than its point, and its damping would need shorter steps.
"""

import numpy as np

from periporo.contact.motion import Motion, velocity_between
from periporo.contact.obstacle import Obstacle
from periporo.contact.penalty import SOON, add_contact_force, are_at, guide_points, resist_faces
from periporo.contact.reaction import Feelers, Reaction
from periporo.contact.search import Search, largest_length
from periporo.contact.surfaces import Surface
from periporo.contact.terrain import FrictionMap
from periporo.core.points.forces import CONTACT, FRICTION, ForceChannels
from periporo.core.points.particles import Field, Particles

_HASTE = 1.5  # times the present speed, which points may reach before they are looked at again
_HELD = 4.0  # reaches, beyond which no point holds a spring, or a memory of being squeezed
FAR = 8.0
"""Reaches within which a surface must know how far a point is: what fast points cover before they are looked at again.
"""
_GROWN = 1.1  # modulus over that which the stiffness was chosen for
_LOST = 1.0  # reaches behind a surface from which on a point has passed through it


class RigidContact(Obstacle):
    """Contact of all points with one rigid surface.

    `stiffness` N/m per point, `friction` coefficient, or a map of it, `damping` share of critical damping along the
    normal; `motion` of the obstacle, which is where its surface says when it appears, and stands without. `reaction`
    adds up what the obstacle bears, if that is told; `feelers` of a free obstacle are where it feels others; `modulus`
    Pa is what the stiffness was chosen for, and follows, or None if it was given. Only points that were within the
    contact's reach plus `skin` m when the neighbours were found are looked at. Needs the force channels `contact` and
    `friction`.
    """

    def __init__(
        self, name, surface: Surface, *, spacing, skin, stiffness, friction: float | FrictionMap, damping=0.0,
        motion: Motion | None = None, reaction: Reaction | None = None, feelers: Feelers | None = None,
        search: Search | None = None, modulus: float | None = None,
    ):  # fmt: skip
        super().__init__(surface, 0.5 * spacing, motion)
        self.name = name
        self.skin = skin
        self.stiffness = stiffness
        self._friction = friction if isinstance(friction, FrictionMap) else np.array([friction], float)
        self.damping = damping
        self.reaction, self.feelers = reaction, feelers
        self.modulus = modulus
        self._search = Search() if search is None else search
        self.spring, self.cell = f"contact_spring_{name}", f"contact_cell_{name}"
        self._chosen: tuple = None, None, 0.0, None  # point ids, pose, m around it with all points, rows near it
        self._idle: np.ndarray | None = None  # point ids for which nothing is near it
        self._soon: tuple = np.empty(0, np.int64), np.empty(0), np.empty((0, 0))  # rows held, or soon; gaps, normals
        self.closing = 0.0  # m/s, with which a point that it holds, or may soon, came near when the step was chosen
        self._seen: tuple = (None,) * 5  # rows, pose, places, gaps and normals of the last forces
        self.breach: tuple[float, np.ndarray, str] | None = None  # how far behind it a point is, m, where, and its name

    def attach(self, p: Particles, forces: ForceChannels) -> None:
        """Declare the stick springs (elongation, m), the cells, and the force channels.

        Of a cell, its first reach and the present one are kept, both beyond half a spacing (m), and how fast its point
        would leave the surface by the push of the last step alone (m/s).
        """
        p.add_field(Field(self.spring, p.dimension, "m", sent=False, sparse=True))
        p.add_field(Field(self.cell, 3, "", sent=False, sparse=True))
        forces.need("contact", on_faces=True)
        forces.need("friction", on_faces=True)

    def fit(self, p: Particles, slack: np.ndarray) -> None:
        """Have cells that miss the surface by at most `slack` (owned,) m, or overlap so far, reach just to it."""
        gap, _ = self.surface.gap(p.position[: p.owned])
        missed = gap - self.reach
        self._reach_to(p, np.arange(p.owned), np.where(np.abs(missed) <= slack, missed, 0.0))

    def appear(self, p: Particles, time: float, before: list | None) -> None:
        """Begin to act, where its entry says, after the contacts `before`, which end; None at the start of a run.

        A cell that overlaps it then presses from there on, beyond what it had pressed on an obstacle that ends: one
        that takes the place of another bears what that bore, and none brings energy.
        """
        self.stand(time)
        if before is None:
            return
        borne = np.zeros(p.owned)
        for contact in before:
            if isinstance(contact, RigidContact):
                pressed = np.maximum(contact.overlaps(p), 0.0)
                borne = np.maximum(borne, min(contact.stiffness / self.stiffness, 1.0) * pressed)
        self._press_from_here(p, np.arange(p.owned), borne)

    def receive(self, p: Particles, ids: np.ndarray) -> None:
        """Meet points (sorted ids) that are placed: those that overlap press from there on."""
        rows = np.flatnonzero(np.isin(p.id[: p.owned], ids, assume_unique=True))
        self._press_from_here(p, rows, np.zeros(len(rows)))

    def _press_from_here(self, p, rows, borne):
        """Have cells that overlap by more than `borne` m reach just so far; a point behind the surface is a breach."""
        gap, _ = self.gap_at(p.position[rows], self.pose)
        self._reach_to(p, rows, np.minimum(gap - self.reach + borne, 0.0))
        self._note_breach(p.position[rows], gap + borne, 0.0)

    def _reach_to(self, p, rows, beyond):
        """Set the reaches of cells to `beyond` (rows,) m beyond half a spacing."""
        if beyond.any() or getattr(p, self.cell).any():
            p.own(self.cell)[rows, :2] = beyond[:, None]

    def follow(self, p: Particles, modulus: float) -> None:
        """Be as stiff as soil with that P-wave `modulus` (Pa), if it has grown much: by the same forces, with less way.

        The energy of the way that is left out counts as lost.
        """
        if self.modulus is None or not modulus > _GROWN * self.modulus:
            return
        softer = self.modulus / modulus
        pressed = np.maximum(self.overlaps(p), 0.0)
        cell, spring = p.own(self.cell), p.own(self.spring)
        stored = 0.5 * self.stiffness * _ring(p, np.arange(p.owned)) * pressed**2
        p.work[:, CONTACT] += (1.0 - softer) * stored
        p.work[:, FRICTION] -= (1.0 - softer) * stored
        cell[:, :2] -= ((1.0 - softer) * pressed)[:, None]
        spring *= softer
        self.stiffness, self.modulus = self.stiffness / softer, modulus

    def overlaps(self, p: Particles) -> np.ndarray:
        """How far the cells of the points reach into the obstacle, (owned,) m; negative off it."""
        gap, _ = self.gap_at(p.position[: p.owned], self.pose)
        return self.reach + getattr(p, self.cell)[:, 1] - gap

    def look_behind(self, p: Particles) -> None:
        """Note the point that is deepest behind the surface, if it has passed it."""
        gap, _ = self.gap_at(p.position[: p.owned], self.pose)
        self._note_breach(p.position[: p.owned], gap, _LOST * self.reach)

    def add_force(self, p: Particles, time: float, dt: float) -> None:
        """Add normal and friction force; velocities are those of the middle of the step."""
        if self._idle is p.id:
            if self.reaction is not None:
                self.reaction.leave()
            return
        self.advance(time, dt)
        before = self.pose_before
        rows = self._near(p, self.pose)
        if self.reaction is not None:
            self.reaction.watch(p, rows)
        if len(rows):
            x = p.position.take(rows, axis=0)
            gap, normal = self.gap_at(x, self.pose)
            self._seen = rows, self.pose, x, gap, normal
            obstacle = np.zeros(x.shape)
            if before is not None and self.pose is not None:
                obstacle = velocity_between(before, self.pose, dt, x)
            add_contact_force(
                rows, gap, np.ascontiguousarray(normal), p.velocity, p.gradient, p.share, obstacle, p.mass, dt,
                self.reach, self.stiffness, p.widths(), self.friction_at(x), self.damping, p.own(self.spring),
                p.own(self.cell), p.contact_force, p.contact_moment, p.friction_force, p.friction_moment, p.dim,
            )  # fmt: skip
        if self.reaction is not None:
            self.reaction.take(p, rows, before, self.pose, dt)

    def frequency(self, comm, p: Particles, time: float, ahead: float) -> float:
        """Frequency (rad/s), at most, with which a free obstacle swings on what it touches now or may in `ahead` s."""
        if self.feelers is None:
            return 0.0
        held = comm.allreduce(len(self._held(p, time, ahead)[0]))
        stiffness = held * self.stiffness + len(self.feelers.places) * self.feelers.stiffness
        return float(np.sqrt(stiffness * self.feelers.softness))

    def add_stiffness(self, p: Particles, time: float, ahead: float, stiffness: np.ndarray) -> None:
        """Add the contact's stiffness (N/m) to `stiffness` (owned,) of the points that it holds, or may `ahead` (s)."""
        self._soon = self._held(p, time, ahead, stiffness)
        rows = self._soon[0]
        stiffness[rows] += self.stiffness * _ring(p, rows)

    def resist(self, p: Particles, dt: float, force: np.ndarray, moment: np.ndarray) -> None:
        """Add what holds these points, at most, against a motion with `velocity` for `dt`: forces on their faces."""
        rows, gap, normal = self._soon
        resist_faces(
            rows, gap, normal, p.velocity, p.gradient, p.share, self.reach, dt * self.stiffness, p.widths(),
            isinstance(self._friction, FrictionMap) or self._friction[0] > 0.0, force, moment, p.dim,
        )  # fmt: skip

    def _held(self, p, time, ahead, filled=None):
        """Rows of the points that it holds, or may within the time `ahead` (s), with gaps and normals.

        All obstacles that add to the same array `filled` see the same velocities.
        """
        pose, x, velocity = self.pose_at(time), p.position[: p.owned], p.velocity[: p.owned]
        if pose is not None and self.motion is not None:
            velocity = velocity - velocity_between(pose, self.motion.pose(time + ahead), ahead, x)
            speed = largest_length(velocity)
        else:
            speed = self._search.fastest(p, filled)
        margin, way = (SOON - 1.0) * self.reach, _HASTE * ahead * speed
        rows = self._candidates(p, pose, way) if way > margin else self._near(p, pose)
        if not len(rows):
            self.closing = 0.0
            return rows, np.empty(0), np.empty((0, p.dimension))
        gap, normal = self.gap_at(x[rows], pose)
        approach = -(velocity[rows] * normal).sum(axis=1)
        soon = gap - self.reach < np.maximum(margin, _HASTE * ahead * approach)
        held = soon | (getattr(p, self.cell)[rows, 1] > 0.0)
        self.closing = float(approach[held].max(initial=0.0))
        return rows[held], gap[held], np.ascontiguousarray(normal[held])

    def guide(self, p: Particles, room, part, way: np.ndarray, lift: np.ndarray) -> None:
        """Rearrange the points that it holds, or that their way would lead to it; their faces stay where they are.

        Of the `way` (awake, d) m of these points what leads along the normal goes to `lift` (awake, d) m, not nearer to
        the surface than `room` (awake,) m; and a point that is nearer is lifted by `part` (awake,) of what is missing,
        as it would be by its mirror image. The cell grows as much as the point is lifted.
        """
        if self._idle is p.id:
            return
        rows = self._near(p, self.pose)
        if not len(rows):
            return
        there, pose, x, gap, normal = self._seen
        if not (there is rows and pose is self.pose and are_at(rows, x, p.position)):  # something has moved
            gap, normal = self.gap_at(p.position[rows], self.pose)
        guide_points(
            rows, gap, np.ascontiguousarray(normal), self.reach, p.own(self.cell), room, part, way, lift, p.dim
        )

    def friction_at(self, place: np.ndarray) -> np.ndarray:
        """Coefficients of friction where the obstacle is now at each `place` (n, d) m: (n,), or (1,) for all."""
        if isinstance(self._friction, FrictionMap):
            return self._friction.at(place if self.pose is None else self.pose.entered(place))
        return self._friction

    def is_idle(self, p: Particles) -> bool:
        """Whether it touches no point of this rank until neighbours are found anew."""
        return self._idle is p.id

    def within_reach(self, p: Particles) -> np.ndarray:
        """Owned rows of the points that it may touch soon."""
        return self._near(p, self.pose)

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        kept = super().memory()
        if self.reaction is not None:
            kept["reaction"] = self.reaction.memory()
        return kept if self.modulus is None else kept | {"stiffness": self.stiffness, "modulus": self.modulus}

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        super().recall(memory)
        self.breach = None
        if self.modulus is not None:
            self.stiffness, self.modulus = memory["stiffness"], memory["modulus"]
        if self.reaction is not None:
            self.reaction.recall(memory["reaction"])

    def _near(self, p, pose):
        """Rows that may touch before points or obstacle have moved half of the skin, or that did."""
        ids, there, radius, rows = self._chosen
        if ids is p.id and (pose is None or not pose.way(there, radius) > 0.5 * self.skin):
            return rows
        rows = self._candidates(p, pose, 0.0)
        if len(rows):
            x = p.reference_position[rows]
            gap, _ = self.gap_at(x, pose)
            near = ~(gap >= SOON * self.reach + self.skin)  # NaN is near
            near |= getattr(p, self.spring)[rows].any(axis=1) | getattr(p, self.cell)[rows, :2].any(axis=1)
            rows = rows[near]
            self._note_breach(x[near], gap[near], _LOST * self.reach)
        radius = 0.0 if pose is None else largest_length(p.reference_position[: p.owned] - pose.reference)
        self._chosen = p.id, pose, radius, rows
        self._idle = p.id if pose is None and not len(rows) else None
        return rows

    def _note_breach(self, position, gap, most):
        """Remember the deepest of the points that are more than `most` m behind the surface, or over a hole."""
        known = np.isfinite(position).all(axis=1)  # the watchdog tells of the others
        lost = known & ~(gap >= -most)
        if lost.any():
            deepest = int(np.argmin(np.where(lost, np.nan_to_num(gap, nan=-np.inf), np.inf)))
            self.breach = -float(gap[deepest]), position[deepest].copy(), f"contacts[{self.name}]"

    def _candidates(self, p, pose, way):
        """Rows of all points that are so near that they touch, hold a spring, or may soon, after a `way` m."""
        lower, upper = self.surface.bounds()
        if pose is not None:
            lower, upper = pose.around(lower, upper)
        margin = _HELD * self.reach + self.skin + way
        return self._search.near(p, lower - margin, upper + margin)


def _ring(p, rows):
    """What the stiffness of points is multiplied by."""
    width = p.widths()
    return width[rows] if len(width) else 1.0
