"""Contact of points with rigid analytic surfaces: penalty along the normal, Coulomb stick-slip along the surface.

A point stands for a cell, so it touches when its distance to the surface falls below half a spacing. The
tangential force is a spring from where the point began to stick; where it would exceed friction times the
normal force, the spring is cut to that and the point slides (Cundall & Strack 1979). The channel `contact`
holds the elastic normal force, `friction` the tangential force and the normal damping.
"""

from typing import Protocol

import numpy as np

from periporo.core.energy import ForceChannels
from periporo.core.jit import kernel
from periporo.core.particles import Field, Particles


class Surface(Protocol):
    """Geometry of a rigid obstacle."""

    def gap(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance (n,) m of each position (n, d) to the surface, negative inside, and outward normal (n, d)."""


class Plane:
    """Half-space behind the plane through `point` with outward `normal` (of any length)."""

    def __init__(self, point, normal):
        self.point = np.asarray(point, float)
        normal = np.asarray(normal, float)
        self.normal = normal / np.sqrt((normal**2).sum())

    def gap(self, position):
        """See `Surface.gap`."""
        gap = ((position - self.point) * self.normal).sum(axis=1)  # not by BLAS: its last bit depends on n
        return gap, np.broadcast_to(self.normal, position.shape)


class Box:
    """Solid box from `lower` to `upper`; points stay outside."""

    def __init__(self, lower, upper):
        self.lower, self.upper = np.asarray(lower, float), np.asarray(upper, float)

    def gap(self, position):
        """See `Surface.gap`; edges and corners are round."""
        nearest = np.clip(position, self.lower, self.upper)
        away = position - nearest
        distance = np.sqrt((away**2).sum(axis=1))
        # inside, the way out is through the nearest face
        depth = np.concatenate([position - self.lower, self.upper - position], axis=1)
        face = np.argmin(depth, axis=1)
        d = position.shape[1]
        inside_normal = np.zeros_like(position)
        inside_normal[np.arange(len(position)), face % d] = np.where(face < d, -1.0, 1.0)
        inside = distance == 0.0
        safe = np.where(inside, 1.0, distance)[:, None]
        normal = np.where(inside[:, None], inside_normal, away / safe)
        return np.where(inside, -depth[np.arange(len(position)), face], distance), normal


class RigidContact:
    """Contact of all points with one rigid surface.

    `stiffness` N/m per point, `friction` coefficient, `damping` share of critical damping along the normal,
    `velocity` (d,) m/s of the obstacle. Needs the force channels `contact` and `friction`.
    """

    def __init__(self, name, surface, *, spacing, stiffness, friction, damping=0.0, velocity=None):
        self.name = name
        self.surface = surface
        self.reach = 0.5 * spacing
        self.stiffness = stiffness
        self.friction = friction
        self.damping = damping
        self.velocity = velocity
        self.spring = f"contact_spring_{name}"

    def attach(self, p: Particles, forces: ForceChannels) -> None:
        """Declare the stick springs (elongation, m) and the force channels."""
        p.add_field(Field(self.spring, p.dimension, "m", sent=False))
        forces.need("contact")
        forces.need("friction")

    def add_force(self, p: Particles, time: float, dt: float) -> None:
        """Add normal and friction force; velocities are those of the middle of the step."""
        n = p.owned
        velocity = np.zeros(p.dimension) if self.velocity is None else self.velocity
        gap, normal = self.surface.gap(p.position[:n] - time * velocity)
        spring = getattr(p, self.spring)
        touching = np.flatnonzero((gap < self.reach) | spring.any(axis=1))
        _contact_force(
            touching, gap, np.ascontiguousarray(normal), p.velocity, velocity, p.mass, dt, self.reach,
            self.stiffness, self.friction, self.damping, spring, p.contact_force, p.friction_force, p.dim,
        )  # fmt: skip

    def add_stiffness(self, p: Particles, time: float, stiffness: np.ndarray) -> None:
        """Add the contact's stiffness (N/m) to `stiffness` (owned,) of the points that it holds or may soon."""
        velocity = np.zeros(p.dimension) if self.velocity is None else self.velocity
        gap, _ = self.surface.gap(p.position[: p.owned] - time * velocity)
        stiffness[gap < 1.5 * self.reach] += self.stiffness


@kernel
def _contact_force(
    touching, gap, normal, velocity, obstacle, mass, dt, reach, stiffness, friction, damping, spring, contact,
    shear, dim,
):  # fmt: skip
    for k in range(touching.shape[0]):
        i = touching[k]
        overlap = reach - gap[i]
        if not overlap > 0.0:
            for a in range(len(dim)):
                spring[i, a] = 0.0
            continue
        approach = 0.0
        for a in range(len(dim)):
            approach += (velocity[i, a] - obstacle[a]) * normal[i, a]
        viscous = 2.0 * damping * np.sqrt(stiffness * mass[i])
        elastic = stiffness * overlap
        pressure = max(elastic - viscous * approach, 0.0)
        size = 0.0
        along = 0.0
        for a in range(len(dim)):
            spring[i, a] += dt * (velocity[i, a] - obstacle[a] - approach * normal[i, a])
            along += spring[i, a] * normal[i, a]
        for a in range(len(dim)):
            spring[i, a] -= along * normal[i, a]  # the surface may have turned under the point
            size += spring[i, a] ** 2
        size = np.sqrt(size)
        limit = friction * pressure / stiffness
        scale = limit / size if size > limit else 1.0
        for a in range(len(dim)):
            spring[i, a] *= scale
            contact[i, a] += elastic * normal[i, a]
            shear[i, a] += (pressure - elastic) * normal[i, a] - stiffness * spring[i, a]
