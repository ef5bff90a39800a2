"""The energy ledger: it closes to rounding whatever happens, and each channel holds the work that it should."""

import numpy as np
import pytest

from periporo.contact.rigid import RigidContact
from periporo.contact.surfaces import Plane
from periporo.core.loads.boundary import Gravity, PrescribedMotion, VelocityHistory, ViscousDamping
from periporo.core.points.forces import WORK, ForceChannels
from periporo.core.points.particles import Particles

SPACING = 0.01


def contact(stiffness=1e5):
    return RigidContact("floor", Plane([0.0, 0.0], [0.0, 1.0]), spacing=SPACING, skin=0.3 * SPACING,
                        stiffness=stiffness, friction=0.3, damping=0.1)  # fmt: skip


def test_ledger_closes_with_everything_at_once(cloud, grid):
    """Contact, friction, gravity, damping, prescribed motion, and a time step that changes in every step."""
    position = grid(8, 5, spacing=SPACING, jitter=0.1) - [0.0, 0.2 * SPACING]
    rng = np.random.default_rng(0)
    velocity = rng.normal(size=position.shape)
    sim = cloud(position, velocity=velocity, contacts=[contact()], fixed=1e-5, start=False)
    sim.forces.need("damping")
    sim.loads = [Gravity(np.array([2.0, -9.81])), ViscousDamping(30.0)]
    motion = PrescribedMotion(np.arange(30, 40), {0: VelocityHistory([0.0, 1.0], [-3.0, 200.0])})
    sim.start()
    sim.prescribed_motions = [motion]
    for _ in range(300):
        sim.dt = 1e-5 * rng.uniform(0.2, 2.5)
        sim.step()
    entries = sim.ledger.entries()
    work = [entries[name] for name in ("internal_energy", "external_work", "contact_energy", "friction_dissipation",
                                       "damping_dissipation", "prescribed_work")]  # fmt: skip
    assert all(abs(w) > 1e-3 for w in work)
    assert entries["friction_dissipation"] > 0.0 and entries["damping_dissipation"] > 0.0
    assert abs(entries["integration_term"]) > 1e-6
    assert entries["energy_residual"] == pytest.approx(entries["integration_term"], abs=1e-12 * max(map(abs, work)))


def test_work_of_gravity_is_the_change_of_potential(cloud, grid):
    sim = cloud(grid(4, 4, spacing=SPACING), fixed=1e-4, loads=[Gravity(np.array([0.0, -9.81]))])
    sim.particles.velocity[:, 1] = 2.0
    sim.ledger.initial_kinetic = sim.ledger.kinetic()
    mass, start = sim.particles.mass, sim.particles.position[:, 1].copy()
    for _ in range(50):
        sim.step()
    fallen = (mass * 9.81 * (start - sim.particles.position[:, 1])).sum()
    entries = sim.ledger.entries()
    assert entries["external_work"] == pytest.approx(fallen, rel=1e-11)
    assert entries["kinetic_energy"] - sim.ledger.initial_kinetic == pytest.approx(fallen, rel=1e-11)
    assert entries["internal_energy"] == pytest.approx(0.0, abs=1e-13)


def test_work_of_a_prescribed_motion_is_the_kinetic_energy_that_it_gives(cloud, grid):
    """A free block that is accelerated evenly as a whole: nothing else does work."""
    sim = cloud(grid(4, 4, spacing=SPACING), fixed=1e-5)
    sim.prescribed_motions = [PrescribedMotion(np.arange(16), {1: VelocityHistory([0.0, 1.0], [0.0, 3000.0])})]
    for _ in range(100):
        sim.step()
    entries = sim.ledger.entries()
    assert entries["prescribed_work"] == pytest.approx(0.5 * sim.particles.mass.sum() * 9.0, rel=1e-9)
    assert entries["kinetic_energy"] == pytest.approx(entries["prescribed_work"], rel=1e-9)


def test_a_boundary_that_starts_at_once_gives_the_energy_it_takes(cloud, grid):
    """The residual is the integrator's error of the wave alone: of second order in the step, from the first one on."""
    residuals = []
    for refined in (1, 2, 4):
        sim = cloud(grid(8, 8, spacing=SPACING), fixed=4e-5 / refined)
        sim.prescribed_motions = [PrescribedMotion(np.arange(8), {0: lambda time, dt: 1.0})]
        for _ in range(4 * refined):
            sim.step()
        entries = sim.ledger.entries()
        assert entries["energy_residual"] == pytest.approx(entries["integration_term"], abs=1e-12)
        residuals.append(abs(entries["energy_residual"]) / entries["prescribed_work"])
    assert residuals[0] < 0.02
    assert np.log2(np.array(residuals[:-1]) / residuals[1:]) == pytest.approx(2.0, abs=0.3)


def test_kinetic_energy(cloud, grid):
    sim = cloud(grid(3, 3, spacing=SPACING), fixed=1e-6, velocity=np.tile([3.0, -4.0], (9, 1)))
    assert sim.ledger.kinetic() == pytest.approx(12.5 * 9 * SPACING**2 * 1760.0, rel=1e-14)


def test_channels_are_declared_once_and_add_up():
    particles = Particles(2)
    forces = ForceChannels(particles)
    for name in ("internal", "contact", "internal"):
        forces.need(name)
    assert forces.names == ["internal", "contact"]
    assert forces.columns.tolist() == [WORK.index("internal"), WORK.index("contact")]
    owned = {f.name: np.zeros(2 if f.columns is None else (2, f.columns), f.dtype) for f in particles.migrating()}
    particles.replace(owned, 1)
    internal, contact_force = forces.arrays()
    internal[:], contact_force[:] = 1.0, [[2.0, 0.0]] * 3
    assert forces.total().tolist() == [[3.0, 1.0], [3.0, 1.0]]


def tension(sim):
    """Volume times stress of each row, shear counted twice."""
    block = sim.bonds.blocks[0]
    volume = sim.bonds.layout.volumes(block, sim.bonds.pairs, sim.particles, np.arange(len(block.pair)))
    return volume[:, None] * np.array([1.0, 1.0, 1.0, 2.0]) * block.stress


def stored_energy_error(cloud, grid, dt, rate):
    """Relative difference of the rows' stress power over a motion, with mean stress, and the ledger."""
    position = grid(7, 5, spacing=SPACING)
    sim = cloud(position, fixed=dt, velocity=rate * (position - position.mean(axis=0)) * [1.0, -1.0])
    stored = 0.0
    for _ in range(round(5e-4 / dt)):
        before = tension(sim)
        sim.step()
        stored += (0.5 * (before + tension(sim)) * sim.bonds.blocks[0].strain_increment).sum()
    assert sim.rebuild_count == 1  # or the rows would have changed places
    return abs(stored / sim.ledger.entries()["internal_energy"] - 1.0)


def test_stress_power_is_the_work_of_the_internal_force(cloud, grid):
    """Exact with the mean stress of a step while shape does not change; the change of shape adds its share."""
    assert stored_energy_error(cloud, grid, 1e-5, rate=1e-3) < 1e-8
    large = [stored_energy_error(cloud, grid, dt, rate=10.0) for dt in (2e-5, 1e-5, 5e-6)]
    assert large[0] < 1e-4 and large[0] > 2.0 * large[1] > 4.0 * large[2]
