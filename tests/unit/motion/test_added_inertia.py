"""Inertia that is added between neighbours: its mass matrix, the step that it allows, and what it leaves as it was."""

import numpy as np
import pytest

from periporo import Simulation
from periporo.core.correspondence.influence import influences
from periporo.core.correspondence.point_state import PointState
from periporo.core.motion.added_inertia import PART, AddedInertia
from periporo.core.motion.timestep import apply_stiffness, highest_frequency

SPACING = 0.01


def stiff_cloud(cloud, grid, counts, rounds):
    """A jittered grid with points of two masses, and its inertia."""
    position = grid(*counts, spacing=SPACING, jitter=0.2)
    sim = cloud(position, scheme=lambda h, name: PointState(h, name, sharpened=SPACING), start=False)
    sim.added_inertia = AddedInertia(rounds)
    sim.added_inertia.attach(sim.particles, sim.forces)
    sim.start()
    sim.particles.mass[::2] *= 3.0
    return sim


def inverse_mass(sim) -> np.ndarray:
    """P M^-1 by columns."""
    p = sim.particles
    n, d = p.position.shape
    columns = []
    for unit in np.eye(n * d):
        columns.append(sim.added_inertia.answer(sim, unit.reshape(n, d) / p.mass[:, None]).copy().ravel())
    return np.array(columns).T


@pytest.mark.parametrize("counts", [(6, 5), (4, 3, 3)])
@pytest.mark.parametrize("rounds", [1, 3])
def test_accelerations_follow_from_a_mass_matrix_that_only_hinders_neighbours(cloud, grid, counts, rounds):
    sim = stiff_cloud(cloud, grid, counts, rounds)
    p = sim.particles
    d, mass = len(counts), np.repeat(p.mass, len(counts))
    inverse = inverse_mass(sim)
    assert inverse == pytest.approx(inverse.T, abs=1e-12 * np.abs(inverse).max())
    eigenvalues = np.linalg.eigvalsh(np.sqrt(mass[:, None] * mass) * inverse)
    assert (1.0 - 2.0 * PART) ** rounds < eigenvalues[0] < 0.6**rounds  # neighbours against each other
    assert eigenvalues[-d:] == pytest.approx(1.0, abs=1e-12) and eigenvalues[-d - 1] < 1.0 - 1e-3
    force = np.random.default_rng(1).normal(size=(len(mass) // d, d))
    given = (p.mass[:, None] * (inverse @ force.ravel()).reshape(force.shape)).sum(axis=0)
    assert given == pytest.approx(force.sum(axis=0), rel=1e-12)  # momentum
    stiffness = np.array([apply_stiffness(sim, u.reshape(force.shape)).ravel() for u in np.eye(len(mass))]).T
    exact = np.sqrt(np.linalg.eigvals(inverse @ stiffness).real.max())
    assert 0.95 * exact < highest_frequency(sim) < 1.0001 * exact
    sim.added_inertia = None
    assert highest_frequency(sim) > 1.25 * exact


def test_a_long_wave_is_slowed_by_the_inertia_that_is_said(cloud, grid):
    """A wave of 20 spacings along a strip, in the middle of it."""
    sim = cloud(grid(41, 9, spacing=SPACING))
    p, k = sim.particles, 2.0 * np.pi / (20.0 * SPACING)
    sim.added_inertia = AddedInertia(2)
    sim.added_inertia.attach(p, sim.forces)
    middle = int(np.argmin(np.linalg.norm(p.position - p.position.mean(axis=0), axis=1)))
    xi = p.position - p.position[middle]
    weight = influences(1.0 - np.linalg.norm(xi, axis=1) / sim.scheme.horizon, sim.scheme.table)
    weight[middle] = 0.0
    wave = np.stack([np.cos(k * xi[:, 0]), np.zeros(len(xi))], axis=1)
    slowed = sim.added_inertia.answer(sim, wave)[middle, 0]
    r_square = (weight * xi[:, 0] ** 2).sum() / (2.0 * weight.sum())
    assert 1.0 - slowed == pytest.approx(2.0 * PART * k**2 * r_square, rel=0.03)


def flung(rounds: int, **keys) -> Simulation:
    """An elastic bar that falls, stretches and turns, or stands still with other `keys`."""
    soil = {"model": "elastic", "density": 1500.0, "bulk_modulus": 6e5, "shear_modulus": 3e5}

    def half(name, left, velocity):
        shape = {"type": "box", "lower": [left, 1.0], "upper": [left + 0.08, 1.04]}
        return {"name": name, "material": "soil", "shape": shape} | ({} if keys else {"velocity": velocity})

    return Simulation.from_scene({
        "dimension": 2, "spacing": SPACING, "gravity": [0.0, -9.81], "materials": {"soil": soil},
        "bodies": [half("left", 0.0, [-0.2, 0.1]), half("right", 0.08, [0.3, -0.4])],
        "time_step": {"added_inertia": rounds},
        "stages": [{"name": "flight", "type": "dynamics", "duration": 0.02}],
    } | keys)  # fmt: skip


def test_momentum_and_energy_of_a_bar_in_flight():
    sim, plain = flung(2), flung(0)
    steps = []
    for run in (sim, plain):
        run.run()
        steps.append(run.step_number)
    assert steps[0] < 0.75 * steps[1]
    p, mass = sim.particles, sim.particles.mass[:, None]
    momentum = (mass * p.velocity).sum(axis=0)
    expected = mass.sum() * np.array([0.05, -0.15 - 9.81 * sim.time])
    assert momentum == pytest.approx(expected, rel=1e-11)
    entries, others = sim.ledger.entries(), plain.ledger.entries()
    assert entries["energy_residual"] == pytest.approx(entries["integration_term"], abs=1e-13)
    assert 0.0 < abs(entries["inertia_energy"]) < 0.03 * entries["kinetic_energy"]
    assert "inertia_energy" not in others and "inertia_force" not in plain.particles.fields
    middle = (mass * p.position).sum(axis=0) / mass.sum()
    for run in (sim, plain):  # both turn alike
        x, v = run.particles.position - middle, run.particles.velocity
        run.spin = (run.particles.mass * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])).sum()
    assert sim.spin == pytest.approx(plain.spin, rel=0.03)


def test_equilibrium_is_measured_without_it():
    stages = [{"name": "settle", "type": "relax", "tolerance": 1e-5}]
    floor = [{"type": "plane", "point": [0, 1.0], "normal": [0, 1], "friction": 0.5}]
    heights = []
    for rounds in (0, 3):
        sim = flung(rounds, stages=stages, contacts=floor)
        sim.run()
        p = sim.particles
        real = sim.forces.total() - (p.inertia_force if rounds else 0.0)
        assert np.linalg.norm(real) < 1.1e-5 * np.linalg.norm(p.external_force)
        heights.append(p.position[:, 1].copy())
    assert heights[1] == pytest.approx(heights[0], abs=1e-6)
