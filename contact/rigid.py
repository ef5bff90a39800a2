"""Contact of points with rigid analytic surfaces: penalty along the normal, Coulomb stick-slip along the surface.

A point stands for a cell, whose face (`periporo.core.points.faces`) is what touches. It lies on the way to the surface,
where the cell ends: half a spacing from the point at first, and as the cell is squeezed between point and surface, or
stretched, its reach l follows the point's velocity gradient L along the normal n,

    dl/dt = d n . L n - 10 |D| (l - l_0),

with d the lever of the face, the distance g of the point from the surface; beyond .7 spacings it falls to 0 at a
spacing. The overlap h = l - g has the rate of the face's approach, so that the normal force k h has the potential
k h^2 / 2 and a closed path of small strain gains no energy. Soil that flows changes its neighbours and not its spacing:
therefore a tenth of strain (D is the rate) lets a cell forget how it was squeezed, and one that is off the surface by
more than a tenth of a spacing has its first reach l_0 again. What lifts a cell that forgets is the work `recovery`. It
comes from a purse, which holds what the cell gave when it was squeezed: in soil that flows that was lost, and comes
back, and never more. Where a law returns all work, that was not lost, and its cells forget nothing.

The tangential force is a spring on the face from where it began to stick; where it would exceed friction times the
normal force, the spring is cut to that and the face slides (Cundall & Strack 1979). The channel `contact` holds the
elastic normal force, `friction` the tangential force and the normal damping, which acts on the point: a face has less
mass than its point, and its damping would need shorter steps.
"""

import numpy as np

from periporo.contact.surfaces import Surface
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.points.faces import add_face_force, face_velocity
from periporo.core.points.forces import CONTACT, FRICTION, RECOVERY, ForceChannels
from periporo.core.points.particles import Field, Particles

_LOOKS = 100  # along the way of an obstacle
_HASTE = 1.5  # times the present speed, which points may reach before they are looked at again
_SOON = 1.5  # reaches within which a point counts as one that may touch soon
_OFF = 0.2  # reaches
_MEMORY = 0.1  # strain in which a cell forgets its stretch
_WHOLE = 1.4  # reaches up to which the lever is the distance from the surface; it is 0 at 2
FAR = 8.0
"""Reaches within which a surface must know how far a point is: what fast points cover before they are looked at again.
"""
_GROWN = 1.1  # modulus over that which the stiffness was chosen for
_LOST = 1.0  # reaches behind a surface from which on a point has passed through it


class RigidContact:
    """Contact of all points with one rigid surface.

    `stiffness` N/m per point, `friction` coefficient, `damping` share of critical damping along the normal,
    `velocity` (d,) m/s of the obstacle, which is where its surface says when it appears; `flows` (materials,) whether
    soil of a material flows, and its cells forget; `modulus` Pa that the stiffness was chosen for, and follows, or None
    if it was given. Only points that were within
    the contact's reach plus `skin` m when the neighbours were found are looked at. Needs the force channels
    `contact` and `friction`.
    """

    def __init__(
        self, name, surface: Surface, *, spacing, skin, stiffness, friction, damping=0.0, velocity=None, flows=(True,),
        modulus=None,
    ):  # fmt: skip
        self.name = name
        self.surface = surface
        self.reach = 0.5 * spacing
        self.skin = skin
        self.stiffness = stiffness
        self.friction = friction
        self.damping = damping
        self.velocity = velocity
        self.flows = np.array(flows)
        self.modulus = modulus
        self.spring, self.cell = f"contact_spring_{name}", f"contact_cell_{name}"
        self._time: float | None = None
        self._since = 0.0  # s, when it appeared
        self._chosen = None, None, None  # point ids, obstacle's shift, rows near it
        self.breach: tuple[float, np.ndarray] | None = None  # how far behind the surface a point is, m, and where

    def attach(self, p: Particles, forces: ForceChannels) -> None:
        """Declare the stick springs (elongation, m), the cells, and the force channels.

        Of a cell, its first reach and the present one are kept, both beyond half a spacing (m), and its purse (J).
        """
        p.add_field(Field(self.spring, p.dimension, "m", sent=False))
        p.add_field(Field(self.cell, 3, "", sent=False))
        forces.need("contact", on_faces=True)
        forces.need("friction", on_faces=True)

    def fit(self, p: Particles, slack: np.ndarray) -> None:
        """Have cells that miss the surface by at most `slack` (owned,) m, or overlap so far, reach just to it."""
        gap, _ = self.surface.gap(p.position[: p.owned])
        missed = gap - self.reach
        getattr(p, self.cell)[:, :2] = np.where(np.abs(missed) <= slack, missed, 0.0)[:, None]

    def appear(self, p: Particles, time: float, before: list | None) -> None:
        """Begin to act, where its entry says, after the contacts `before`, which end; None at the start of a run.

        A cell that overlaps it then presses from there on, beyond what it had pressed on an obstacle that ends: one
        that takes the place of another bears what that bore, and none brings energy.
        """
        self._since = time
        if before is None:
            return
        borne = np.zeros(p.owned)
        for contact in before:
            if isinstance(contact, RigidContact):
                pressed = np.maximum(contact.overlaps(p, time), 0.0)
                borne = np.maximum(borne, min(contact.stiffness / self.stiffness, 1.0) * pressed)
        self._press_from_here(p, time, np.arange(p.owned), borne)

    def receive(self, p: Particles, time: float, ids: np.ndarray) -> None:
        """Meet points (sorted ids) that are placed: those that overlap press from there on."""
        rows = np.flatnonzero(np.isin(p.id[: p.owned], ids, assume_unique=True))
        self._press_from_here(p, time, rows, np.zeros(len(rows)))

    def _press_from_here(self, p, time, rows, borne):
        """Have cells that overlap by more than `borne` m reach just so far; a point behind the surface is a breach."""
        gap, _ = self.surface.gap(p.position[rows] - self._shift(p, time))
        getattr(p, self.cell)[rows, :2] = np.minimum(gap - self.reach + borne, 0.0)[:, None]
        self._note_breach(p.position[rows], gap + borne, 0.0)

    def follow(self, p: Particles, time: float, modulus: float) -> None:
        """Be as stiff as soil with that P-wave `modulus` (Pa), if it has grown much: by the same forces, with less way.

        The energy of the way that is left out counts as lost.
        """
        if self.modulus is None or not modulus > _GROWN * self.modulus:
            return
        softer = self.modulus / modulus
        pressed = np.maximum(self.overlaps(p, time), 0.0)
        cell, spring = getattr(p, self.cell), getattr(p, self.spring)
        stored = 0.5 * self.stiffness * pressed**2
        p.work[:, CONTACT] += (1.0 - softer) * stored
        p.work[:, FRICTION] -= (1.0 - softer) * stored
        cell[:, :2] -= ((1.0 - softer) * pressed)[:, None]
        spring *= softer
        self.stiffness, self.modulus = self.stiffness / softer, modulus

    def overlaps(self, p: Particles, time: float) -> np.ndarray:
        """How far the cells of the points reach into the obstacle, (owned,) m; negative off it."""
        gap, _ = self.surface.gap(p.position[: p.owned] - self._shift(p, time))
        return self.reach + getattr(p, self.cell)[:, 1] - gap

    def look_behind(self, p: Particles, time: float) -> None:
        """Note the point that is deepest behind the surface, if it has passed it."""
        gap, _ = self.surface.gap(p.position[: p.owned] - self._shift(p, time))
        self._note_breach(p.position[: p.owned], gap, _LOST * self.reach)

    def add_force(self, p: Particles, time: float, dt: float) -> None:
        """Add normal and friction force; velocities are those of the middle of the step."""
        shift = self._shift(p, time)
        rows = self._near(p, shift)
        # while relaxation holds the time, the obstacle stands still
        still = self.velocity is None or time == self._time
        obstacle = np.zeros(p.dimension) if still else self.velocity
        self._time = time
        if len(rows) == 0:
            return
        gap, normal = self.surface.gap(p.position[rows] - shift)
        _contact_force(
            rows, gap, np.ascontiguousarray(normal), p.velocity, p.gradient, p.share, obstacle, p.mass, dt, self.reach,
            self.stiffness, self.friction, self.damping, p.material, self.flows, getattr(p, self.spring),
            getattr(p, self.cell),
            p.contact_force, p.contact_moment, p.friction_force, p.friction_moment, p.work, p.dim,
        )  # fmt: skip

    def add_stiffness(self, p: Particles, time: float, ahead: float, stiffness: np.ndarray) -> None:
        """Add the contact's stiffness (N/m) to `stiffness` (owned,) of the points that it holds, or may `ahead` (s)."""
        rows, _, _ = self._held(p, time, ahead)
        stiffness[rows] += self.stiffness

    def resist(
        self, p: Particles, time: float, ahead: float, dt: float, force: np.ndarray, moment: np.ndarray
    ) -> None:
        """Add what holds those points, at most, against a motion with `velocity` for `dt`: forces on their faces."""
        rows, gap, normal = self._held(p, time, ahead)
        _resist(
            rows, gap, normal, p.velocity, p.gradient, p.share, self.reach, dt * self.stiffness, self.friction > 0.0,
            force, moment, p.dim,
        )  # fmt: skip

    def _held(self, p, time, ahead):
        """Rows of the points that it holds, or may within the time `ahead` (s), with gaps and normals."""
        shift = self._shift(p, time)
        velocity = p.velocity[: p.owned] if self.velocity is None else p.velocity[: p.owned] - self.velocity
        margin = (_SOON - 1.0) * self.reach
        fast = _HASTE * ahead * np.sqrt((velocity**2).sum(axis=1).max(initial=0.0)) > margin
        rows = np.arange(p.owned) if fast else self._near(p, shift)
        gap, normal = self.surface.gap(p.position[rows] - shift)
        approach = -(velocity[rows] * normal).sum(axis=1)
        soon = gap - self.reach < np.maximum(margin, _HASTE * ahead * approach)
        held = soon | (getattr(p, self.cell)[rows, 1] > 0.0)
        return rows[held], gap[held], np.ascontiguousarray(normal[held])

    def outline(self, p: Particles, time: float, middle: np.ndarray, size: float):
        """How the obstacle is drawn at this time, see `Surface.outline`."""
        shift = self._shift(p, time)
        points, cells = self.surface.outline(middle - shift, size)
        return points + shift, cells

    def will_push(self, p: Particles, time: float, until: float) -> bool:
        """Whether the obstacle moves, and meets a point of this rank where it is now before the time `until`."""
        if self.velocity is None:
            return False
        x = p.position[: p.owned]
        gaps = (self.surface.gap(x - self._shift(p, t))[0] for t in np.linspace(time, until, _LOOKS))
        return any(gap.min(initial=np.inf) < self.reach for gap in gaps)

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        kept = {"time": self._time, "since": self._since}
        return kept if self.modulus is None else kept | {"stiffness": self.stiffness, "modulus": self.modulus}

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        self._time, self._since, self.breach = memory["time"], memory["since"], None
        if self.modulus is not None:
            self.stiffness, self.modulus = memory["stiffness"], memory["modulus"]

    def _shift(self, p, time):
        return np.zeros(p.dimension) if self.velocity is None else (time - self._since) * self.velocity

    def _near(self, p, shift):
        """Rows that may touch before points or obstacle have moved half of the skin, or that did."""
        ids, there, rows = self._chosen
        if ids is p.id and (self.velocity is None or not ((shift - there) ** 2).sum() > (0.5 * self.skin) ** 2):
            return rows
        gap, _ = self.surface.gap(p.reference_position[: p.owned] - shift)
        near = ~(gap >= _SOON * self.reach + self.skin)  # NaN is near
        rows = np.flatnonzero(near | getattr(p, self.spring).any(axis=1) | getattr(p, self.cell).any(axis=1))
        self._chosen = p.id, shift, rows
        self._note_breach(p.reference_position[rows], gap[rows], _LOST * self.reach)
        return rows

    def _note_breach(self, position, gap, most):
        """Remember the deepest of the points that are more than `most` m behind the surface, or over a hole."""
        known = np.isfinite(position).all(axis=1)  # the watchdog tells of the others
        lost = known & ~(gap >= -most)
        if lost.any():
            deepest = int(np.argmin(np.where(lost, np.nan_to_num(gap, nan=-np.inf), np.inf)))
            self.breach = -float(gap[deepest]), position[deepest].copy()


@inlined
def _set_lever(gap, normal, k, reach, integrity, lever):
    """Fill `lever` (d,) m with the way from a point to its face."""
    whole = (2.0 - gap[k] / reach) / (2.0 - _WHOLE)
    length = integrity * max(gap[k], 0.0) * min(max(whole, 0.0), 1.0)
    for a in range(lever.shape[0]):
        lever[a] = -length * normal[k, a]


@inlined
def _strain_rate(gradient, i, d):
    """|D| of point i, 1/s."""
    square = 0.0
    for a in range(d):
        for b in range(d):
            square += (0.5 * (gradient[i, d * a + b] + gradient[i, d * b + a])) ** 2
    return np.sqrt(square)


@inlined
def _forget(cell, i, strain, overlap, stiffness, work):
    """Let a cell forget by a `strain` over the memory how it was squeezed: to the surface, or as its purse allows."""
    way = (cell[i, 0] - cell[i, 1]) * strain / (1.0 + strain)
    if overlap <= 0.0:
        cell[i, 1] += min(way, -overlap)
        return
    lifted = stiffness * (overlap + 0.5 * way) * way
    if lifted > max(cell[i, 2], 0.0):
        way *= max(cell[i, 2], 0.0) / lifted
        lifted = stiffness * (overlap + 0.5 * way) * way
    cell[i, 1] += way
    cell[i, 2] -= lifted
    work[i, CONTACT] -= lifted
    work[i, RECOVERY] += lifted


@kernel
def _resist(rows, gap, normal, velocity, gradient, share, reach, stiffness, sticks, force, moment, dim):
    d = len(dim)
    lever, face, load = np.zeros(d), np.zeros(d), np.zeros(d)
    for k in range(rows.shape[0]):
        i = rows[k]
        _set_lever(gap, normal, k, reach, share[i, 1], lever)
        face_velocity(velocity, gradient, i, lever, face)
        approach = 0.0
        for a in range(d):
            approach += face[a] * normal[k, a]
        for a in range(d):
            load[a] = -stiffness * (face[a] if sticks else approach * normal[k, a])
        add_face_force(force, moment, i, load, lever)


@kernel
def _contact_force(
    rows, gap, normal, velocity, gradient, share, obstacle, mass, dt, reach, stiffness, friction, damping, material,
    flows, spring, cell, contact, contact_moment, shear, shear_moment, work, dim,
):  # fmt: skip
    d = len(dim)
    lever, face, load = np.zeros(d), np.zeros(d), np.zeros(d)
    for k in range(rows.shape[0]):
        i = rows[k]
        off = gap[k] - reach - max(cell[i, 0], cell[i, 1])
        if off >= 0.0:
            if off > _OFF * reach:
                cell[i, 0] = cell[i, 1] = cell[i, 2] = 0.0
            for a in range(d):
                spring[i, a] = 0.0
            continue
        _set_lever(gap, normal, k, reach, share[i, 1], lever)
        face_velocity(velocity, gradient, i, lever, face)
        approach, own = 0.0, 0.0
        for a in range(d):
            face[a] -= obstacle[a]
            approach += face[a] * normal[k, a]
            own += (velocity[i, a] - obstacle[a]) * normal[k, a]
        squeezed = cell[i, 1] + dt * (own - approach)
        overlap = reach + squeezed - gap[k]
        cell[i, 1] = squeezed
        cell[i, 2] -= stiffness * max(overlap, 0.0) * dt * (own - approach)
        if flows[material[i] if flows.shape[0] > 1 else 0]:
            _forget(cell, i, dt * _strain_rate(gradient, i, d) / _MEMORY, overlap, stiffness, work)
        overlap = reach + cell[i, 1] - gap[k]
        if overlap <= 0.0:
            for a in range(d):
                spring[i, a] = 0.0
            continue
        viscous = 2.0 * damping * np.sqrt(stiffness * mass[i])
        elastic = stiffness * overlap
        pressure = elastic - viscous * own
        if pressure < 0.0:
            pressure = 0.0
        size = 0.0
        along = 0.0
        for a in range(d):
            spring[i, a] += dt * (face[a] - approach * normal[k, a])
            along += spring[i, a] * normal[k, a]
        for a in range(d):
            spring[i, a] -= along * normal[k, a]  # the surface may have turned under the face
            size += spring[i, a] ** 2
        size = np.sqrt(size)
        limit = friction * pressure / stiffness
        scale = limit / size if size > limit else 1.0
        for a in range(d):
            spring[i, a] *= scale
            load[a] = elastic * normal[k, a]
        add_face_force(contact, contact_moment, i, load, lever)
        for a in range(d):
            shear[i, a] += (pressure - elastic) * normal[k, a]
            load[a] = -stiffness * spring[i, a]
        add_face_force(shear, shear_moment, i, load, lever)
