"""Laws of contact on free points, without bonds, against closed forms: Coulomb's and the published one."""

import numpy as np
import pytest

from periporo.contact.motion import Prescribed
from periporo.contact.rigid import RigidContact
from periporo.contact.short_range_published import ShortRangePublished
from periporo.contact.surfaces import Box, Disc, Plane
from periporo.core.motion.integrator import drift, first_kick, second_kick
from periporo.core.numerics.histories import Course
from periporo.core.points.forces import WORK, ForceChannels
from periporo.core.points.particles import Particles

G, H, K, M = 9.81, 0.1, 1e5, 1.0  # gravity, spacing, stiffness, mass
SINK = M * G / K
DT = 2e-4
FLOOR = Plane([0.0, 0.0], [0.0, 1.0])


class Rig:
    """Free points under gravity and one contact, advanced as `Simulation.step` does."""

    def __init__(self, contact, position, velocity=(0.0, 0.0), gravity=(0.0, -G)):
        position = np.atleast_2d(np.asarray(position, float))
        n, d = position.shape
        self.contact, self.gravity, self.time = contact, np.asarray(gravity), 0.0
        p = self.p = Particles(d)
        self.forces = ForceChannels(p)
        self.forces.need("external")
        contact.attach(p, self.forces)
        owned = {f.name: np.zeros((n,) if f.columns is None else (n, f.columns), f.dtype) for f in p.migrating()}
        owned |= {"id": np.arange(n), "position": position, "mass": np.full(n, M), "volume": np.ones(n)}
        owned |= {"velocity": np.broadcast_to(np.asarray(velocity, float), (n, d)), "reference_position": position}
        owned["dilation"] = np.ones(n)
        p.replace(owned, 0)
        p.jacobian[:] = 1.0
        self.initial_kinetic = self.kinetic()
        self.evaluate(0.0)

    def evaluate(self, dt):
        self.forces.clear()
        self.contact.add_force(self.p, self.time, dt)
        self.p.external_force[:] += self.p.mass[:, None] * self.gravity

    def run(self, duration, dt=DT, watch=lambda p: None):
        for _ in range(round(duration / dt)):
            first_kick(self.p, self.forces, dt)
            drift(self.p, self.forces, dt)
            self.time += dt
            self.evaluate(dt)
            second_kick(self.p, self.forces, dt)
            watch(self.p)
        return self.p

    def kinetic(self):
        return 0.5 * (self.p.mass[:, None] * self.p.velocity**2).sum()

    def works(self):
        return dict(zip(WORK, self.p.work.sum(axis=0), strict=True))

    def residual(self):
        """What the ledger does not explain, over its largest entry."""
        work = self.p.work.sum(axis=0)
        return abs(self.kinetic() - self.initial_kinetic - work.sum()) / np.abs(work).max()


def coulomb(surface=FLOOR, friction=0.5, stiffness=K, **keys):
    return RigidContact("0", surface, spacing=H, skin=10.0, stiffness=stiffness, friction=friction, **keys)


def drawn(*velocity):
    """Motion at a constant velocity, m/s."""
    return Prescribed({a: Course("velocity", [0.0], [v]) for a, v in enumerate(velocity)}, np.zeros(len(velocity)))


def along_a_path(gaps, strains, contact):
    """Rig of one point that goes through `gaps` (k,) m while its cell has the strains (k,) along y; and the work on it.

    The work is that of the contact on the point, and of its moment on the strain, by the trapezoidal rule.
    """
    rig = Rig(contact, [0.0, gaps[0]])
    p, work = rig.p, 0.0
    p.share[:, 1] = 1.0
    for before, gap, last, strain in zip(gaps, gaps[1:], strains, strains[1:], strict=False):
        old = p.contact_force[0, 1], p.contact_moment[0, 3]
        p.velocity[0, 1], p.gradient[0, 3], p.position[0, 1] = gap - before, strain - last, gap
        rig.evaluate(1.0)
        force, moment = 0.5 * (old[0] + p.contact_force[0, 1]), 0.5 * (old[1] + p.contact_moment[0, 3])
        work += force * (gap - before) + moment * (strain - last)
    return rig, work


def test_a_cells_face_has_a_potential():
    """Work on point and strain along any path to a squeezed, overlapping state, and back by another one."""
    turn = np.linspace(0.0, 2.0 * np.pi, 4001)
    gaps = H * (0.5 - 0.02 * (1.0 - np.cos(turn)) + 0.005 * np.sin(turn))
    strains = -0.01 * (1.0 - np.cos(turn + 0.7) - 1.0 + np.cos(0.7))
    half = len(turn) // 2
    for end in (half, len(turn) - 1):
        rig, work = along_a_path(gaps[: end + 1], strains[: end + 1], coulomb())
        overlap = 0.5 * H + rig.p.contact_cell_0[0, 1] - gaps[end]
        stored = 0.5 * K * max(overlap, 0.0) ** 2
        assert work == pytest.approx(-stored, abs=2e-3 * 0.5 * K * (0.04 * H) ** 2)


def test_a_point_that_leaves_has_a_new_cell():
    rig, _ = along_a_path(np.full(2001, 0.4 * H), -np.linspace(0.0, 0.2, 2001), coulomb())
    assert rig.p.contact_cell_0[0, 1] < -0.05 * H
    rig.p.position[0, 1], rig.p.velocity[:] = 0.7 * H, 0.0
    rig.evaluate(1.0)
    assert not rig.p.contact_cell_0.any()


def test_a_cell_that_began_squeezed_gets_its_reach_back_without_a_push():
    """It was a fifth of its reach off the surface when the obstacle appeared, and is soon farther: there is no room."""
    contact = coulomb()
    rig = Rig(contact, [0.0, 0.1 * H])
    contact.appear(rig.p, 0.0, [])
    for gap in np.linspace(0.1, 0.9, 200) * H:
        rig.p.position[0, 1] = gap
        rig.evaluate(0.0)
        assert not rig.p.contact_force.any()
        assert rig.p.contact_cell_0[0, 0] == pytest.approx(min(max(gap - 0.6 * H, -0.4 * H), 0.0))


def test_points_that_are_guided_keep_their_force():
    """So do those off the surface, if their way leads to it: the last would overlap by .02 H of its own accord."""
    contact = coulomb()
    rig = Rig(contact, [[0.0, 0.4 * H], [1.0, 0.45 * H], [2.0, 0.49 * H], [3.0, 0.7 * H], [4.0, 0.51 * H]])
    rig.evaluate(0.0)
    before = rig.p.contact_force.copy()
    way, lift = np.tile([0.02 * H, -0.03 * H], (5, 1)), np.zeros((5, 2))
    contact.guide(rig.p, np.full(5, 0.48 * H), np.array([0.5, 0.0, 0.5, 0.5, 0.5]), way, lift)
    assert way == pytest.approx(np.array([[0.02, 0], [0.02, -0.03], [0.02, 0], [0.02, -0.03], [0.02, 0]]) * H)
    assert lift == pytest.approx(np.array([[0, 0.04], [0, 0], [0, -0.01], [0, 0], [0, -0.03]]) * H)
    rig.p.position += lift
    rig.evaluate(0.0)
    assert before[0, 1] > 0.0 and before[4, 1] == 0.0
    assert rig.p.contact_force == pytest.approx(before, abs=1e-9 * K * H)


def test_what_overlaps_when_an_obstacle_appears_presses_from_there_on():
    """But for what it had pressed on one that ends; a point behind the surface is a breach."""
    rig = Rig(coulomb(), [[0.0, 0.2 * H], [1.0, 0.5 * H - SINK], [2.0, 0.7 * H]])
    ends, contact = rig.contact, coulomb(stiffness=4.0 * K)
    contact.spring, contact.cell = "second_spring", "second_cell"
    contact.attach(rig.p, rig.forces)
    contact.appear(rig.p, 1.0, [])
    assert contact.overlaps(rig.p) == pytest.approx([0.0, 0.0, -0.2 * H], abs=1e-12)
    contact.appear(rig.p, 1.0, [ends])
    assert contact.overlaps(rig.p) == pytest.approx([0.075 * H, 0.25 * SINK, -0.2 * H], abs=1e-12)
    assert contact.breach is None
    rig.p.position[0, 1] = -0.1 * H
    contact.appear(rig.p, 1.0, [])
    depth, place, _ = contact.breach
    assert depth == pytest.approx(0.1 * H) and place == pytest.approx([0.0, -0.1 * H])


def test_a_contact_follows_the_stiffness_of_the_soil_without_a_gain():
    """The same forces from less overlap, if the modulus has grown; a stiffness that was given stays."""
    rig = Rig(coulomb(friction=5.0, modulus=1e6), [0.0, 0.5 * H - 2.0 * SINK], (0.1, 0.0))
    rig.run(0.01)
    p, contact = rig.p, rig.contact
    before, residual = np.concatenate([p.contact_force[0], p.friction_force[0]]), rig.residual()
    stored = 0.5 * K * contact.overlaps(p)[0] ** 2
    contact.follow(p, 1.05e6)
    assert contact.stiffness == K
    work = p.work.sum(axis=0)
    contact.follow(p, 4e6)
    assert contact.stiffness == 4.0 * K and contact.modulus == 4e6
    rig.evaluate(0.0)
    assert np.concatenate([p.contact_force[0], p.friction_force[0]]) == pytest.approx(before, rel=1e-9)
    assert 0.5 * contact.stiffness * contact.overlaps(p)[0] ** 2 == pytest.approx(0.25 * stored, rel=1e-9)
    assert p.work.sum() == pytest.approx(work.sum()) and rig.residual() == pytest.approx(residual, abs=1e-12)
    given = coulomb()
    given.follow(p, 1e9)
    assert given.stiffness == K


def test_cells_of_displaced_points_reach_just_to_the_surface():
    contact = coulomb()
    rig = Rig(contact, [[0.0, 0.45 * H], [0.5, 0.56 * H], [1.0, 0.7 * H], [2.0, 0.3 * H]])
    contact.fit(rig.p, np.full(4, 0.1 * H))
    rig.evaluate(0.0)
    assert rig.p.contact_cell_0[:, 0] == pytest.approx([-0.05 * H, 0.06 * H, 0.0, 0.0], abs=1e-12)
    assert rig.p.contact_force[:, 1] == pytest.approx([0.0, 0.0, 0.0, 0.2 * H * K], abs=1e-9)


def test_a_sliding_point_stops_where_friction_has_used_up_its_energy():
    rig = Rig(coulomb(friction=0.3), [0.0, 0.5 * H - SINK], (2.0, 0.0))
    p = rig.run(2.0)
    assert p.position[0, 0] == pytest.approx(2.0**2 / (2 * 0.3 * G), rel=1e-3)  # V15
    work = rig.works()
    # what is left is the spring that friction holds
    assert -work["friction"] == pytest.approx(0.5 * M * 2.0**2, rel=1e-3)
    assert abs(work["contact"]) < 1e-9 and rig.residual() < 1e-12


@pytest.mark.parametrize("friction", [0.1, 1.2])
def test_incline(friction):
    """V15: 30 degrees. It slides (g sin - mu g cos) t^2 / 2 = 1.9874 m in 0.99 s at mu = 0.1, and sticks at 1.2."""
    angle = np.radians(30.0)
    across = np.array([-np.sin(angle), np.cos(angle)])
    down = np.array([-np.cos(angle), -np.sin(angle)])
    start = (0.5 * H - SINK * np.cos(angle)) * across
    p = Rig(coulomb(Plane([0.0, 0.0], across), friction), start).run(0.99)
    moved = (p.position[0] - start) @ down
    if friction == 0.1:
        assert moved == pytest.approx(1.9874, rel=1e-3)
    else:
        assert 0.0 < moved <= 2.001 * SINK * np.sin(angle)  # swings on the spring that holds it, undamped


def test_stick_is_a_spring_and_slip_starts_at_the_friction_angle():
    frequency = np.sqrt(K / M)
    rig = Rig(coulomb(friction=10.0), [0.0, 0.5 * H - SINK], (0.5 * SINK * frequency, 0.0))
    seen = []
    rig.run(4 * np.pi / frequency, dt=1e-5, watch=lambda p: seen.append(p.position[0, 0]))
    assert max(seen) == pytest.approx(0.5 * SINK, rel=1e-3)
    crossings = np.flatnonzero(np.diff(np.sign(seen)))
    assert (crossings[2] - crossings[0]) * 1e-5 == pytest.approx(2 * np.pi / frequency, rel=1e-2)
    for tangent, slides in ((0.499, False), (0.501, True)):
        # tilted gravity, held back by a velocity that starts the spring at its balance
        rig = Rig(coulomb(friction=0.5, damping=0.0), [0.0, 0.5 * H - SINK], gravity=(tangent * G, -G))
        rig.p.contact_spring_0[:] = [tangent * SINK, 0.0]
        rig.evaluate(0.0)
        p = rig.run(0.5)
        assert (p.position[0, 0] > SINK) == slides


def test_a_moving_floor_carries_the_point_along():
    contact = coulomb(friction=0.4, motion=drawn(1.5, 0.0))
    p = Rig(contact, [0.0, 0.5 * H - SINK]).run(1.0)
    lag = 1.5 * 1.0 - p.position[0, 0]
    assert lag == pytest.approx(1.5**2 / (2 * 0.4 * G), rel=1e-3)
    assert p.velocity[0, 0] == pytest.approx(1.5, abs=1e-1)
    assert p.velocity[0, 0] != 1.5


def test_a_rising_piston_reflects_with_twice_its_speed():
    contact = coulomb(friction=0.0, motion=drawn(0.0, 3.0))
    rig = Rig(contact, [0.0, 0.5 * H + 0.3], gravity=(0.0, 0.0))
    p = rig.run(0.2, dt=5e-5)
    assert p.velocity[0, 1] == pytest.approx(6.0, rel=1e-3)
    assert rig.residual() < 1e-12


def test_the_obstacle_stands_still_while_the_time_does():
    contact = coulomb(friction=10.0, motion=drawn(1.0, 0.0))
    rig = Rig(contact, [0.0, 0.5 * H - SINK])
    rig.contact.add_force(rig.p, 0.0, DT)
    assert not rig.p.contact_spring_0.any()
    rig.contact.add_force(rig.p, DT, DT)
    assert rig.p.contact_spring_0[0, 0] == pytest.approx(-DT)


@pytest.mark.parametrize("damping", [0.0, 0.1, 0.4])
def test_restitution(damping):
    """Elastic without damping; with it, Schwager & Poschel (2007) for a dashpot that cannot pull."""
    rig = Rig(coulomb(friction=0.0, damping=damping), [0.0, 0.5 * H + 0.05], (0.0, -1.0), gravity=(0.0, 0.0))
    p = rig.run(0.08, dt=1e-5)
    root = np.sqrt(1.0 - damping**2)
    angle = np.pi - np.arctan2(2.0 * damping * root, 1.0 - 2.0 * damping**2)
    assert p.velocity[0, 1] == pytest.approx(np.exp(-damping / root * angle), rel=1e-3)
    work = rig.works()
    assert abs(work["contact"]) < 1e-5 * 0.5 * M  # a potential
    assert work["friction"] == pytest.approx(0.5 * M * (p.velocity[0, 1] ** 2 - 1.0), abs=1e-5)


def test_a_point_rolls_off_a_disc_and_around_a_corner_without_loss():
    for surface, start, velocity in (
        (Disc([0.0, 0.0], 1.0), [0.0, 1.0 + 0.5 * H - SINK], (0.5, 0.0)),
        (Box([-1.0, -1.0], [1.0, 1.0]), [0.9, 1.0 + 0.5 * H - SINK], (0.2, 0.0)),
    ):
        rig = Rig(coulomb(surface, friction=0.0), start, velocity)
        p = rig.run(0.8)
        fallen = start[1] - p.position[0, 1]
        assert fallen > 0.1
        total = rig.kinetic() - M * G * fallen - rig.works()["contact"]
        assert total == pytest.approx(0.5 * M * velocity[0] ** 2, rel=1e-2)


def test_only_points_near_the_surface_are_looked_at():
    contact = RigidContact("0", FLOOR, spacing=H, skin=0.03, stiffness=K, friction=0.5)
    rig = Rig(contact, [[0.0, 0.049], [0.0, 0.104], [0.0, 0.106]])
    assert contact._near(rig.p, None).tolist() == [0, 1]
    stiffness = np.zeros(3)
    contact.add_stiffness(rig.p, 0.0, 0.0, stiffness)
    assert stiffness.tolist() == [K, 0.0, 0.0]


def test_a_point_that_leaves_forgets_its_spring():
    rig = Rig(coulomb(), [0.0, 0.5 * H - SINK], (1.0, 0.0))
    rig.run(0.1)
    assert rig.p.contact_spring_0.any()
    rig.p.position[0, 1] = H
    rig.evaluate(0.0)
    assert not rig.p.contact_spring_0.any() and not rig.p.contact_force.any()


# the published short-range force: spacing H, cutoff 0.8 H, stiffness 4e6 N/m^2


def published(friction, substrate_spacing, dimension=2):
    lower, upper = [-0.5] * (dimension - 1) + [-H], [40.0 if dimension == 2 else 0.5] + [0.5] * (dimension - 2) + [0.0]
    return ShortRangePublished(
        lower, upper, substrate_spacing, spacing=H, stiffness=K, friction=friction, cutoff=0.8 * H
    )


@pytest.mark.parametrize("dimension", [2, 3])
def test_published_force_against_the_sum_over_all_substrate_points(dimension):
    contact = published(0.25, 0.5 * H, dimension)
    place = np.array([0.013, 0.02, 0.04])[-dimension:]
    velocity = np.array([0.3, -0.2, -0.1])[-dimension:]
    rig = Rig(contact, place, velocity, gravity=np.zeros(dimension))
    axes = [contact.origin[a] + contact.substrate_spacing * np.arange(contact.counts[a]) for a in range(dimension)]
    away = place - np.stack([a.ravel() for a in np.meshgrid(*axes)], axis=1)
    r = np.sqrt((away**2).sum(axis=1))
    force = np.maximum(0.8 * H - r, 0.0)[:, None] * away / r[:, None] * K * (1.0 if dimension == 2 else H)
    approaching = -np.sign(away @ velocity)[:, None]
    assert rig.p.contact_force[0] == pytest.approx(force.sum(axis=0), rel=1e-12)
    assert rig.p.friction_force[0] == pytest.approx((0.25 * approaching * force).sum(axis=0), rel=1e-12)
    stiffness = np.zeros(1)
    contact.add_stiffness(rig.p, 0.0, 0.0, stiffness)
    assert stiffness[0] == pytest.approx(1.25 * (r < H).sum() * K * (1.0 if dimension == 2 else H))


def test_published_friction_does_not_stop_a_point():
    """V15 with the published friction fails: Coulomb's point stops after 0.41 m, this one slides on."""
    start = Rig(published(0.5, 0.25 * H), [0.05, 0.6 * H], gravity=(0.0, -G))
    start.run(0.5, watch=lambda p: p.velocity.__imul__(0.99))  # to rest on the substrate
    place = start.p.position[0]
    rig = Rig(published(0.5, 0.25 * H), place, (2.0, 0.0))
    p = rig.run(0.8)
    assert rig.residual() < 1e-12
    slid = p.position[0, 0] - place[0]
    assert slid > 3.0 * 2.0**2 / (2 * 0.5 * G)
    resistance = (2.0**2 - p.velocity[0, 0] ** 2) / (2.0 * slid * G)  # over the normal force; Coulomb's is 0.5
    assert 0.0 < resistance < 0.06


def test_a_row_of_substrate_points_interlocks_without_friction():
    """Largest slope of the path of a point on the substrate: the resistance over the normal force."""
    slopes = {}
    for spacing in (H, 0.25 * H, 0.1 * H):
        contact = published(0.0, spacing)
        x = np.linspace(0.0, spacing, 201) + contact.origin[0] + 5 * spacing
        rig = Rig(contact, np.stack([x, np.full(201, 0.5 * H)], axis=1), gravity=(0.0, 0.0))
        low, high = np.full(201, -0.5 * H), np.full(201, H)
        for _ in range(60):  # height at which the substrate carries the weight
            rig.p.position[:, 1] = 0.5 * (low + high)
            rig.evaluate(0.0)
            carries = rig.p.contact_force[:, 1] > M * G
            low, high = np.where(carries, rig.p.position[:, 1], low), np.where(carries, high, rig.p.position[:, 1])
        slopes[spacing] = np.abs(rig.p.contact_force[:, 0]).max() / (M * G)
    assert slopes[H] > 0.5 and slopes[0.25 * H] < 0.5 * slopes[H] and slopes[0.1 * H] < 0.1


@pytest.mark.parametrize("part", [0.4, 0.8])
def test_a_point_that_bounces_rises_no_higher_and_no_lower(part):
    """Two to five steps in the spring; what they miss at its ends is made good, under gravity, too."""
    rig, dt, heights = Rig(coulomb(friction=0.0), [0.0, 0.5 * H], (0.0, 1.0)), 2.0 * part * (M / K) ** 0.5, []
    while len(heights) < 8:
        before = rig.p.velocity[0, 1]
        rig.run(dt, dt)
        if before > 0.0 >= rig.p.velocity[0, 1]:
            heights.append(rig.p.position[0, 1] - 0.5 * H)
    assert heights[0] == pytest.approx(0.5 / G, rel=4e-3)  # within the steps
    assert heights == pytest.approx([heights[0]] * 8, rel=5e-4)
