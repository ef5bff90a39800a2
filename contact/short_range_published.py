"""The published short-range contact force against a substrate of fixed points (Menon & Song 2022, eqs 95-96)."""

import numpy as np

from periporo.contact.surfaces import Box
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.points.forces import ForceChannels
from periporo.core.points.particles import Particles

_NEAREST = 0.45  # spacings from a substrate at which points may be when it appears


class ShortRangePublished:
    """Repulsion of points from the fixed points of a box, and what its authors call friction.

    A point at distance r < `cutoff` m from a substrate point is pushed away by C_s (cutoff - r), C_s = `stiffness`
    N/m^2. That is a force per thickness of a plane scene; in space it acts on a spacing, k = C_s spacing. It is
    applied once to the point, not as the difference of two equal and opposite states times volumes, which eq. 97
    asks for and the units of C_s contradict.

    The published `friction` acts along the same line: it changes the repulsion by the factor 1 + friction while the
    points approach and 1 - friction while they part. So it is not friction but a rate-dependent restitution: what a
    sliding point loses when it climbs towards a substrate point it mostly gets back behind it. The mean resistance
    over the normal force is .004 to .06 for coefficients of .25 and .5 and a substrate spacing of a tenth to a
    quarter of the body's. What resists sliding is the roughness of a row of points: without any friction it takes
    .80 of the normal force to leave a row at the body's own spacing, .16 at a quarter and .06 at a tenth
    (`python -m benchmarks short_range_friction`). It is here to redraw the published results;
    `periporo.contact.rigid` has Coulomb's law.

    `lower`, `upper` (d,) m corners of the box, filled with points `substrate_spacing` m apart, half of that inside
    its faces. The repulsion goes to the channel `contact`, the rest to `friction`.
    """

    damping = 0.0  # share of critical damping

    def __init__(self, lower, upper, substrate_spacing, *, spacing, stiffness, friction, cutoff, name="0"):
        self.name = name
        self.surface = Box(lower, upper)
        lower, side = np.asarray(lower, float), np.asarray(upper, float) - np.asarray(lower, float)
        self.counts = np.maximum(np.rint(side / substrate_spacing), 1).astype(np.int64)
        self.origin = lower + 0.5 * substrate_spacing
        self.substrate_spacing = substrate_spacing
        self.stiffness = stiffness * spacing ** (len(lower) - 2)
        self.nearest = _NEAREST * spacing
        self.breach: tuple[float, np.ndarray, str] | None = None  # how far a cell overlaps it, m, where, and what
        self.friction = friction
        self.cutoff = cutoff

    def attach(self, p: Particles, forces: ForceChannels) -> None:
        """Declare the force channels."""
        forces.need("contact")
        forces.need("friction")

    def appear(self, p: Particles, time: float, before: list | None) -> None:
        """Begin to act after the contacts `before`, which end; None at the start of a run.

        There is no way to be near a substrate without being pushed: cells that overlap it are a breach, unless it takes
        the place of another.
        """
        gap, _ = self.surface.gap(p.position[: p.owned])
        same = [c for c in before or () if isinstance(c, ShortRangePublished) and c.covers(self)]
        if before is not None and not same and gap.min(initial=np.inf) < self.nearest:
            deepest = int(np.argmin(gap))
            self.breach = self.nearest - float(gap[deepest]), p.position[deepest].copy(), f"contacts[{self.name}]"

    def covers(self, other: "ShortRangePublished") -> bool:
        """Whether its substrate is that of another."""
        return np.array_equal(self.surface.lower, other.surface.lower) and np.array_equal(
            self.surface.upper, other.surface.upper
        )

    def add_force(self, p: Particles, time: float, dt: float) -> None:
        """Add repulsion and friction; velocities are those of the middle of the step."""
        _short_range_force(
            p.owned, p.position, p.velocity, self.origin, self.counts, self.substrate_spacing, self.cutoff,
            self.stiffness, self.friction, p.contact_force, p.friction_force, p.dim,
        )  # fmt: skip

    def add_stiffness(self, p: Particles, time: float, ahead: float, stiffness: np.ndarray) -> None:
        """Add the stiffness (N/m) of the bonds to substrate points that hold a point or may soon."""
        _short_range_stiffness(
            p.owned, p.position, self.origin, self.counts, self.substrate_spacing, 1.25 * self.cutoff,
            self.stiffness * (1.0 + self.friction), stiffness, p.dim,
        )  # fmt: skip

    def outline(self, p: Particles, time: float, middle, size):
        """How the substrate is drawn, see `Surface.outline`."""
        return self.surface.outline(middle, size)

    def will_push(self, p: Particles, time: float, until: float) -> bool:
        """Nothing that moves by itself."""
        return False

    def resist(self, p: Particles, dt: float, force: np.ndarray, moment: np.ndarray) -> None:
        """Add what holds the points that may touch, at most, against a motion with `velocity` for `dt`."""
        stiffness = np.zeros(p.owned)
        self.add_stiffness(p, 0.0, 0.0, stiffness)
        force[: p.owned] -= dt * stiffness[:, None] * p.velocity[: p.owned]


@inlined
def _nearby(position, i, origin, counts, spacing, reach, first, last):
    """Fill the lattice range [first, last] within `reach` of a point along each axis; whether it is empty."""
    for a in range(3):
        first[a], last[a] = 0, 0
    for a in range(origin.shape[0]):
        x = (position[i, a] - origin[a]) / spacing
        first[a] = max(int(np.ceil(x - reach / spacing)), 0)
        last[a] = min(int(np.floor(x + reach / spacing)), counts[a] - 1)
        if not first[a] <= last[a]:
            return True
    return False


@kernel
def _short_range_force(
    owned, position, velocity, origin, counts, spacing, cutoff, stiffness, friction, contact, shear, dim
):
    d = len(dim)
    first, last, away, site = np.zeros(3, np.int64), np.zeros(3, np.int64), np.zeros(3), np.zeros(3, np.int64)
    for i in range(owned):
        if _nearby(position, i, origin, counts, spacing, cutoff, first, last):
            continue
        for sx in range(first[0], last[0] + 1):
            for sy in range(first[1], last[1] + 1):
                for sz in range(first[2], last[2] + 1):
                    site[0], site[1], site[2] = sx, sy, sz
                    square, rate = 0.0, 0.0
                    for a in range(d):
                        away[a] = position[i, a] - (origin[a] + site[a] * spacing)
                        square += away[a] ** 2
                        rate += away[a] * velocity[i, a]
                    r = np.sqrt(square)
                    if r >= cutoff:
                        continue
                    f = stiffness * (cutoff - r) / r
                    sign = 1.0 if rate > 0.0 else (-1.0 if rate < 0.0 else 0.0)
                    for a in range(d):
                        contact[i, a] += f * away[a]
                        shear[i, a] -= friction * sign * f * away[a]


@kernel
def _short_range_stiffness(owned, position, origin, counts, spacing, reach, stiffness, total, dim):
    first, last = np.zeros(3, np.int64), np.zeros(3, np.int64)
    for i in range(owned):
        if _nearby(position, i, origin, counts, spacing, reach, first, last):
            continue
        for sx in range(first[0], last[0] + 1):
            for sy in range(first[1], last[1] + 1):
                for sz in range(first[2], last[2] + 1):
                    square = (position[i, 0] - origin[0] - sx * spacing) ** 2
                    square += (position[i, 1] - origin[1] - sy * spacing) ** 2
                    if len(dim) == 3:
                        square += (position[i, 2] - origin[2] - sz * spacing) ** 2
                    if square < reach * reach:
                        total[i] += stiffness
