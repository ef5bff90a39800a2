"""Contact of points with rigid analytic surfaces: penalty along the normal, Coulomb stick-slip along the surface.

A point stands for a cell, so it touches when its distance to the surface falls below half a spacing. The
tangential force is a spring from where the point began to stick; where it would exceed friction times the
normal force, the spring is cut to that and the point slides (Cundall & Strack 1979). The channel `contact`
holds the elastic normal force, `friction` the tangential force and the normal damping.
"""

import numpy as np

from periporo.contact.surfaces import Surface
from periporo.core.numerics.jit import kernel
from periporo.core.points.forces import ForceChannels
from periporo.core.points.particles import Field, Particles

_SOON = 1.5  # reaches within which a point counts as one that may touch soon


class RigidContact:
    """Contact of all points with one rigid surface.

    `stiffness` N/m per point, `friction` coefficient, `damping` share of critical damping along the normal,
    `velocity` (d,) m/s of the obstacle, which is where its surface says when it appears. Only points that were within
    the contact's reach plus `skin` m when the neighbours were found are looked at. Needs the force channels
    `contact` and `friction`.
    """

    def __init__(self, name, surface: Surface, *, spacing, skin, stiffness, friction, damping=0.0, velocity=None):
        self.name = name
        self.surface = surface
        self.reach = 0.5 * spacing
        self.skin = skin
        self.stiffness = stiffness
        self.friction = friction
        self.damping = damping
        self.velocity = velocity
        self.spring = f"contact_spring_{name}"
        self._time: float | None = None
        self._since = 0.0  # s, when it appeared
        self._chosen = None, None, None  # point ids, obstacle's shift, rows near it

    def attach(self, p: Particles, forces: ForceChannels) -> None:
        """Declare the stick springs (elongation, m) and the force channels."""
        p.add_field(Field(self.spring, p.dimension, "m", sent=False))
        forces.need("contact")
        forces.need("friction")

    def appear(self, p: Particles, time: float, before: list) -> None:
        """Begin to act, where its entry says."""
        self._since = time

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
            rows, gap, np.ascontiguousarray(normal), p.velocity, obstacle, p.mass, dt, self.reach, self.stiffness,
            self.friction, self.damping, getattr(p, self.spring), p.contact_force, p.friction_force, p.dim,
        )  # fmt: skip

    def add_stiffness(self, p: Particles, time: float, stiffness: np.ndarray) -> None:
        """Add the contact's stiffness (N/m) to `stiffness` (owned,) of the points that it holds or may soon."""
        shift = self._shift(p, time)
        rows = self._near(p, shift)
        gap, _ = self.surface.gap(p.position[rows] - shift)
        stiffness[rows[gap < _SOON * self.reach]] += self.stiffness

    def outline(self, p: Particles, time: float, middle: np.ndarray, size: float):
        """How the obstacle is drawn at this time, see `Surface.outline`."""
        shift = self._shift(p, time)
        points, cells = self.surface.outline(middle - shift, size)
        return points + shift, cells

    def resist(self, p: Particles, time: float, dt: float, force: np.ndarray) -> None:
        """Add to `force` (total, d) what holds the points against a motion with `velocity` for `dt`, at most."""
        stiffness = np.zeros(p.owned)
        self.add_stiffness(p, time, stiffness)
        force[: p.owned] -= dt * stiffness[:, None] * p.velocity[: p.owned]

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        return {"time": self._time, "since": self._since}

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        self._time, self._since = memory["time"], memory["since"]

    def _shift(self, p, time):
        return np.zeros(p.dimension) if self.velocity is None else (time - self._since) * self.velocity

    def _near(self, p, shift):
        """Rows that may touch before points or obstacle have moved half of the skin, or that did."""
        ids, there, rows = self._chosen
        if ids is p.id and (self.velocity is None or not ((shift - there) ** 2).sum() > (0.5 * self.skin) ** 2):
            return rows
        gap, _ = self.surface.gap(p.reference_position[: p.owned] - shift)
        near = ~(gap >= _SOON * self.reach + self.skin)  # NaN is near
        rows = np.flatnonzero(near | getattr(p, self.spring).any(axis=1))
        self._chosen = p.id, shift, rows
        return rows


@kernel
def _contact_force(
    rows, gap, normal, velocity, obstacle, mass, dt, reach, stiffness, friction, damping, spring, contact, shear, dim
):
    for k in range(rows.shape[0]):
        i = rows[k]
        overlap = reach - gap[k]
        if overlap <= 0.0:
            for a in range(len(dim)):
                spring[i, a] = 0.0
            continue
        approach = 0.0
        for a in range(len(dim)):
            approach += (velocity[i, a] - obstacle[a]) * normal[k, a]
        viscous = 2.0 * damping * np.sqrt(stiffness * mass[i])
        elastic = stiffness * overlap
        pressure = elastic - viscous * approach
        if pressure < 0.0:
            pressure = 0.0
        size = 0.0
        along = 0.0
        for a in range(len(dim)):
            spring[i, a] += dt * (velocity[i, a] - obstacle[a] - approach * normal[k, a])
            along += spring[i, a] * normal[k, a]
        for a in range(len(dim)):
            spring[i, a] -= along * normal[k, a]  # the surface may have turned under the point
            size += spring[i, a] ** 2
        size = np.sqrt(size)
        limit = friction * pressure / stiffness
        scale = limit / size if size > limit else 1.0
        for a in range(len(dim)):
            spring[i, a] *= scale
            contact[i, a] += elastic * normal[k, a]
            shear[i, a] += (pressure - elastic) * normal[k, a] - stiffness * spring[i, a]
