"""Boundary conditions as a step sees them."""

import numpy as np
import pytest

from periporo.core.loads.boundary import (
    DisplacementHistory,
    Gravity,
    PrescribedMotion,
    Traction,
    VelocityHistory,
    ViscousDamping,
    without_overlaps,
)

SPACING = 0.01


@pytest.fixture
def block(cloud, grid):
    return cloud(grid(4, 4, spacing=SPACING), fixed=1e-5)


def test_velocity_history_is_linear_between_and_constant_outside():
    velocity = VelocityHistory([1.0, 3.0], [10.0, 20.0])
    assert [velocity(t, 0.1) for t in (0.0, 1.0, 2.0, 3.0, 9.0)] == [10.0, 10.0, 15.0, 20.0, 20.0]


def test_DisplacementHistory_is_reached_whatever_the_steps():
    velocity = DisplacementHistory([0.0, 0.4, 1.0], [0.0, 1.0, -2.0])
    time, place = 0.0, 0.0
    for dt in np.random.default_rng(0).uniform(0.001, 0.09, 30):
        place += dt * velocity(time + 0.5 * dt, dt)
        time += dt
        assert place == pytest.approx(np.interp(time, [0.0, 0.4, 1.0], [0.0, 1.0, -2.0]), abs=1e-13)


def test_prescribed_points_move_as_told_and_the_others_do_not(block):
    block.prescribed_motions = [PrescribedMotion(np.array([0, 5]), {1: DisplacementHistory([0.0, 1e-3], [0.0, 1e-4])})]
    start = block.particles.position.copy()
    for _ in range(20):
        block.step()
    p = block.particles
    assert p.position[[0, 5], 1] - start[[0, 5], 1] == pytest.approx([2e-5, 2e-5], rel=1e-9)
    assert p.velocity[[0, 5], 1] == pytest.approx([0.1, 0.1], rel=1e-9)
    assert np.abs(p.position[10] - start[10]).max() > 0.0  # it is dragged along, through its bonds
    assert p.velocity[0, 0] != 0.0  # the other component is free


def test_prescribed_points_are_found_again_after_a_rebuild(block):
    motion = PrescribedMotion(np.array([3]), {0: VelocityHistory([0.0], [0.0])})
    block.prescribed_motions = [motion]
    block.particles.velocity[:] = [5.0, 0.0]
    for _ in range(100):
        block.step()
    assert block.rebuild_count > 1
    assert block.particles.velocity[3, 0] == 0.0 and block.particles.velocity[12, 0] > 0.0


def test_hold_zero_touches_prescribed_components_only(block):
    free = np.ones((16, 2))
    PrescribedMotion(np.array([2, 7]), {1: VelocityHistory([0.0], [0.0])}).hold_zero(block.particles, free)
    expected = np.ones((16, 2))
    expected[[2, 7], 1] = 0.0
    assert (free == expected).all()


def test_weight_traction_and_damping(block):
    block.forces.need("damping")
    p = block.particles
    p.damping_force = np.zeros((16, 2))
    p.velocity[:] = [2.0, -1.0]
    traction = Traction("t", np.array([1, 4]), np.array([[3.0, 0.5], [3.0, 0.5]]), np.array([[0.0, 0.2], [0.1, 0.0]]))
    traction.attach(p, block.forces, block.point_processes)
    p.external_force[:] = 0.0
    for load in (Gravity(np.array([0.0, -10.0])), traction, ViscousDamping(7.0)):
        load.add_force(p, 0.0, 1e-5)
    expected = np.tile([0.0, -10.0 * 1760.0 * SPACING**2], (16, 1))
    expected[[1, 4]] += [3.0, 0.5]
    assert p.external_force == pytest.approx(expected, rel=1e-14)
    x, m = 7e-5, 1760.0 * SPACING**2  # rate times step
    others = expected + p.internal_force[:16]
    damping = m * np.tile([-2.0, 1.0], (16, 1)) * (1.0 - np.exp(-x)) / 1e-5 - (1.0 - (1.0 - np.exp(-x)) / x) * others
    assert p.damping_force == pytest.approx(damping, rel=1e-9)
    moment = np.zeros((16, 4))
    moment[1], moment[4] = [0.0, 0.6, 0.0, 0.1], [0.3, 0.0, 0.05, 0.0]
    moment *= p.share[:, 1:2]  # a corner has less than all of its integrity, if any
    assert p.external_moment == pytest.approx(moment, rel=1e-14) and p.share[4, 1] == 1.0


def test_loads_on_faces_keep_the_moment_of_momentum_and_do_their_own_work(cloud, grid):
    """All forces of loads on faces together: their sum, their torque at the faces, and the power of the faces."""
    for dimension in (2, 3):
        position = grid(*(6, 5, 4)[:dimension], spacing=SPACING, jitter=0.1)
        sim = cloud(position, fixed=1e-15)
        p, random = sim.particles, np.random.default_rng(dimension)
        ids = np.flatnonzero(position[:, 1] > 3.4 * SPACING)
        force, lever = random.normal(size=dimension), random.normal(size=(len(ids), dimension)) * SPACING
        load = Traction("t", ids, np.tile(force, (len(ids), 1)), lever)
        load.attach(p, sim.forces, sim.point_processes)
        p.velocity[:] = random.normal(size=p.velocity.shape)
        p.external_moment[:] = 0.0
        sim.scheme.deform(p, sim.bonds, sim.halo, 1e-15, 1e-15)
        sim.bonds.blocks[0].stress[:] = 0.0
        p.external_force[:] = 0.0
        load.add_force(p, 0.0, 0.0)
        sim.scheme.internal_force(p, sim.bonds, sim.halo, p.internal_force, sim.forces.moment())
        total = p.external_force + p.internal_force
        lever = lever * p.share[ids, 1:2]
        assert total.sum(axis=0) == pytest.approx(len(ids) * force, rel=1e-12)
        torque = np.einsum("na,nb->ab", p.position, total)
        at_faces = np.einsum("na,b->ab", p.position[ids] + lever, force)
        assert torque - torque.T == pytest.approx(at_faces - at_faces.T, abs=1e-11 * np.abs(at_faces).max())
        face = p.velocity[ids] + np.einsum("nab,nb->na", p.gradient[ids].reshape(-1, dimension, dimension), lever)
        assert (total * p.velocity).sum() == pytest.approx((face @ force).sum(), rel=1e-11)


def test_faces_turn_with_their_points(block):
    p = block.particles
    load = Traction("t", np.array([5]), np.array([[0.0, 0.0]]), np.array([[0.3, 0.0]]))
    load.attach(p, block.forces, block.point_processes)
    steps = 100
    p.gradient[:] = np.sin(0.5 * np.pi / steps) * np.array([0.0, -1.0, 1.0, 0.0])
    for _ in range(steps):
        load.update(p, block.bonds, 1.0)
    assert p.face_t[5] == pytest.approx([0.0, 0.3], abs=1e-7) and not p.face_t[:5].any()


@pytest.mark.parametrize("rate", [3.0, 1e3, 1e4, 1e6])
def test_damping_is_integrated_exactly_at_any_rate(cloud, rate):
    """Free motion decays as exp(-rate t), a load is followed at g/rate; explicit, steps over 2/rate blow up."""
    dt = 1e-3
    sim = cloud(np.array([[0.0, 0.0]]), velocity=[[1.0, 0.0]], fixed=dt, start=False)
    sim.forces.need("damping")
    sim.loads = [Gravity(np.array([0.0, -10.0])), ViscousDamping(rate, lambda: sim.dt)]
    sim.start()
    sim.apply_loads(0.0)  # as at the start of a stage
    for _ in range(500):
        sim.step()
    p, x = sim.particles, rate * dt
    assert p.velocity[0, 0] == pytest.approx(np.exp(-rate * sim.time) * np.cosh(0.5 * x), rel=1e-9, abs=1e-300)
    approached = -10.0 / rate * (1.0 - np.exp(-rate * sim.time))
    assert p.velocity[0, 1] == pytest.approx(approached, rel=1e-3)
    entries = sim.ledger.entries()
    turned = entries["external_work"] + 0.5 * p.mass[0]
    assert abs(entries["energy_residual"] - entries["integration_term"]) < 1e-13 * turned
    assert 0.0 < entries["damping_dissipation"] < 1.5 * turned


def test_the_last_motion_has_a_component_that_several_prescribe():
    still, fast = VelocityHistory([0.0, 1.0], [0.0, 0.0]), VelocityHistory([0.0, 1.0], [2.0, 2.0])
    first = PrescribedMotion(np.array([1, 2, 5]), {0: still, 1: still})
    last = PrescribedMotion(np.array([2, 7]), {1: fast})
    found = without_overlaps([first, last])
    assert [(m.ids.tolist(), m.velocities) for m in found] == [
        ([1, 5], {1: still}), ([1, 2, 5], {0: still}), ([2, 7], {1: fast}),
    ]  # fmt: skip
