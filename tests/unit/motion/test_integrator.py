"""Velocity Verlet: exact where it should be, second order elsewhere."""

import numpy as np
import pytest

from periporo.core.loads.boundary import Gravity
from periporo.core.motion.integrator import drift, first_kick, second_kick

SPACING = 0.01


def lone(cloud, *, dt=1e-3, loads=(), velocity=(0.0, 0.0)):
    return cloud(np.array([[0.0, 0.0]]), fixed=dt, loads=list(loads), velocity=[velocity])


class Spring:
    """Force -k x on every point."""

    def __init__(self, stiffness):
        self.stiffness = stiffness

    def add_force(self, p, time, dt):
        p.external_force[: p.owned] -= self.stiffness * p.position[: p.owned]


def test_constant_acceleration_is_exact(cloud):
    sim = lone(cloud, loads=[Gravity(np.array([1.0, -9.81]))], velocity=(2.0, 3.0))
    for _ in range(100):
        sim.step()
    t = sim.time
    assert sim.particles.position[0] == pytest.approx([2 * t + t**2 / 2, 3 * t - 9.81 * t**2 / 2], rel=1e-13)
    assert sim.particles.velocity[0] == pytest.approx([2 + t, 3 - 9.81 * t], rel=1e-13)


def test_oscillator_is_second_order(cloud):
    errors = []
    for steps in (50, 100, 200):
        sim = lone(cloud, dt=1.0 / steps)
        stiffness = (2.0 * np.pi) ** 2 * sim.particles.mass[0]
        sim.loads = [Spring(stiffness)]
        sim.particles.position[0] = [0.05 * SPACING, 0.0]
        sim.evaluate_forces()
        for _ in range(steps):
            sim.step()
        errors.append(np.abs(sim.particles.velocity[0, 0]) / (2 * np.pi * 0.05 * SPACING))
    assert errors[0] == pytest.approx(2 * np.pi * (2 * np.pi / 50) ** 2 / 24, rel=0.02)  # the phase lag of Verlet
    ratios = [errors[0] / errors[1], errors[1] / errors[2]]
    assert ratios == pytest.approx([4.0, 4.0], rel=0.02)


def test_kicks_and_drift_one_by_one(cloud):
    sim = lone(cloud, velocity=(1.0, 0.0))
    p, forces, dt = sim.particles, sim.forces, 0.1
    mass = p.mass[0]
    p.dilation[0], p.jacobian[0] = 3.0, 1.5
    p.internal_force[0], p.external_force[0] = [2.0 * mass, 0.0], [0.0, 4.0 * mass]
    first_kick(p, forces, dt)
    assert p.velocity[0] == pytest.approx([1.1, 0.2], rel=1e-14) and p.previous_velocity[0].tolist() == [1.0, 0.0]
    moved, way = drift(p, forces, dt)
    assert p.position[0] == pytest.approx([0.11, 0.02], rel=1e-14)
    assert moved == pytest.approx(np.hypot(0.11, 0.02), rel=1e-14)
    assert way == pytest.approx(moved, rel=1e-14)
    assert p.work[0, :2] == pytest.approx([0.5 * dt * 2.0 * mass * 1.1, 0.5 * dt * 4.0 * mass * 0.2], rel=1e-13)
    second_kick(p, forces, dt)
    assert p.velocity[0] == pytest.approx([1.2, 0.4], rel=1e-14)
    assert p.dilation[0] == 4.5 and p.present_volume()[0] == 4.5 * p.volume[0]  # with this step's change, once
    assert p.work[0, :2] == pytest.approx([dt * 2.0 * mass * 1.1, dt * 4.0 * mass * 0.2], rel=1e-13)


@pytest.mark.parametrize("point", [0, 4, 8])
def test_nan_counts_as_moved_wherever_it_is(cloud, grid, point):
    sim = cloud(grid(3, 3, spacing=SPACING), fixed=1e-6)
    sim.particles.position[point] = np.nan
    assert np.isnan(drift(sim.particles, sim.forces, 1e-6)[0])
