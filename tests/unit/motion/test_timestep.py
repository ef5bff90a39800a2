"""The stable time step against the spectrum of the assembled stiffness, and against stability itself."""

import numpy as np
import pytest

from periporo.contact.rigid import RigidContact
from periporo.contact.surfaces import Plane
from periporo.core.correspondence.point_state import PointState
from periporo.core.motion.timestep import StableTimeStep, apply_stiffness, highest_frequency, local_frequency
from periporo.errors import InputError
from periporo.materials.drucker_prager import DruckerPrager
from periporo.materials.elastic import Elastic

SPACING = 0.01


def spectrum(sim):
    """All angular frequencies by probing the stiffness column by column."""
    p = sim.particles
    n, d = p.position.shape
    columns = []
    for k in range(n * d):
        unit = np.zeros(n * d)
        unit[k] = 1.0
        columns.append(apply_stiffness(sim, unit.reshape(n, d)).ravel())
    stiffness = np.array(columns).T
    root = np.sqrt(np.repeat(p.mass, d))
    scaled = stiffness / root[:, None] / root
    assert np.abs(scaled - scaled.T).max() < 1e-9 * np.abs(scaled).max()  # the operator is symmetric
    return np.linalg.eigvalsh(0.5 * (scaled + scaled.T))


@pytest.mark.parametrize("counts", [(7, 6), (4, 4, 3)])
@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_highest_frequency_is_that_of_the_assembled_stiffness(cloud, grid, counts, jitter):
    sim = cloud(grid(*counts, spacing=SPACING, jitter=jitter))
    estimate = highest_frequency(sim)
    squares = spectrum(cloud(grid(*counts, spacing=SPACING, jitter=jitter)))
    exact = np.sqrt(squares[-1])
    assert 0.95 * exact < estimate < 1.0001 * exact
    d = len(counts)
    rigid = d * (d + 1) // 2
    assert np.abs(squares[:rigid]).max() < 1e-9 * squares[-1]  # translations and rotations cost nothing
    assert squares[rigid] > 1e-4 * squares[-1]  # and nothing else does


def test_measuring_changes_nothing(cloud, grid):
    sim = cloud(grid(6, 5, spacing=SPACING, jitter=0.2))
    rng = np.random.default_rng(0)
    block, p = sim.bonds.blocks[0], sim.particles
    block.stress[:] = rng.normal(size=block.stress.shape)
    p.velocity[:], p.jacobian[:] = rng.normal(size=p.velocity.shape), 1.1
    kept = [a.copy() for a in (block.stress, block.active, p.velocity, p.jacobian, p.position, p.volume)]
    highest_frequency(sim)
    now = (block.stress, block.active, p.velocity, p.jacobian, p.position, p.volume)
    assert all((a == b).all() for a, b in zip(kept, now, strict=True))


class Stiffening(Elastic):
    """Elastic, with moduli four times as large at a pressure of 1 MPa as without."""

    def elastic_moduli(self, stress, state):
        bulk, shear = super().elastic_moduli(stress, state)
        factor = 1.0 - 1e-6 * stress[:, :3].sum(axis=1)
        return factor * bulk, factor * shear


def test_step_follows_the_stiffness_at_the_present_stress(cloud, grid):
    parameters = dict(density=1760.0, bulk_modulus=25e6, shear_modulus=15e6)
    steps = []
    for law, pressure in ((Stiffening(**parameters), 0.0), (Stiffening(**parameters), 1e6)):
        sim = cloud(grid(6, 5, spacing=SPACING, jitter=0.1), laws=[law])
        sim.bonds.blocks[0].stress[:] = -pressure * np.array([1.0, 1.0, 1.0, 0.0])
        steps.append(StableTimeStep(0.8, None, 10).choose(sim))
    assert steps[0] / steps[1] == pytest.approx(2.0, rel=1e-6)


def test_step_is_the_given_share_of_the_limit(cloud, grid):
    sim = cloud(grid(6, 5, spacing=SPACING, jitter=0.1))
    limit = 2.0 / highest_frequency(sim)
    for safety in (0.3, 0.8):
        assert StableTimeStep(safety, None, 10).choose(sim) == pytest.approx(safety * limit, rel=1e-12)


def test_energy_stays_below_the_limit_and_grows_above_it(cloud, grid):
    growth = []
    for share in (0.95, 1.1):
        position = grid(6, 5, spacing=SPACING, jitter=0.1)
        velocity = 1e-9 * np.random.default_rng(1).normal(size=position.shape)
        sim = cloud(position, velocity=velocity, fixed=share * 2.0 / highest_frequency(cloud(position)))
        before = sim.ledger.kinetic()
        for _ in range(400):
            sim.step()
        growth.append(sim.ledger.kinetic() / before)
    assert growth[0] < 3.0 and growth[1] > 1e3


def test_contact_and_compression_shorten_the_step(cloud, grid):
    position = grid(6, 5, spacing=SPACING)
    floor = RigidContact("f", Plane([0.0, 0.0], [0.0, 1.0]), spacing=SPACING, skin=0.3 * SPACING, stiffness=1e9,
                         friction=0.0)  # fmt: skip
    free, held = cloud(position), cloud(position, contacts=[floor])
    assert local_frequency(held, held.contacts) == pytest.approx(
        np.sqrt(local_frequency(held, ()) ** 2 + 1e9 / held.particles.mass[0]), rel=0.3
    )
    assert held.time_step.choose(held) < 0.5 * free.time_step.choose(free)
    assert cloud(0.8 * position, spacing=SPACING).dt < free.dt


def test_an_obstacle_that_comes_counts_before_it_is_there(cloud, grid):
    """A block falls to a stiff floor and meets it within the next twenty steps: in the exact frequency, too."""
    position = grid(6, 5, spacing=SPACING) + [0.0, 1.2 * SPACING]
    steps = []
    for speed in (0.0, 5.0):
        floor = RigidContact("f", Plane([0.0, 0.0], [0.0, 1.0]), spacing=SPACING, skin=3.0 * SPACING, stiffness=1e12,
                             friction=0.0)  # fmt: skip
        sim = cloud(position, velocity=np.tile([0.0, -speed], (30, 1)), contacts=[floor])
        sim.time_step.interval = 20
        sim.dt = 1e-4
        steps.append(sim.time_step.choose(sim))
        if speed:
            assert highest_frequency(sim) > 0.9 * np.sqrt(1e12 / sim.particles.mass[0])
    assert steps[1] == pytest.approx(0.8 * 2.0 / np.sqrt(1e12 / sim.particles.mass[0]), rel=0.1)
    assert steps[0] > 20.0 * steps[1]


def test_the_next_look_comes_before_what_was_looked_for(cloud, grid):
    """After a step that is ten times shorter, contacts were looked for in twenty of these only."""
    sim = cloud(grid(6, 5, spacing=SPACING))
    step = sim.dt
    sim.time_step.interval = 20
    sim.dt, sim.step_number = 0.1 * step, 40
    assert sim.time_step.choose(sim) == pytest.approx(step)
    assert [k for k in range(41, 60) if sim.time_step.due(k)][0] == 42


def test_what_meets_fast_makes_the_step_short_before(cloud, grid):
    """A block at 40 m/s strains by a thirtieth in a step when it meets the floor, and has not to be slowed then."""
    floor = RigidContact("f", Plane([0.0, 0.0], [0.0, 1.0]), spacing=SPACING, skin=0.3 * SPACING, stiffness=1e9,
                         friction=0.0)  # fmt: skip
    position = grid(6, 5, spacing=SPACING) + [0.0, 0.2 * SPACING]
    sim = cloud(position, velocity=np.tile([0.0, -40.0], (30, 1)), contacts=[floor])
    assert sim.time_step.choose(sim) == pytest.approx(0.9 * 0.1 / 3.0 * SPACING / 40.0, rel=0.01)


def test_when_it_is_due():
    assert [StableTimeStep(0.8, None, 3).due(k) for k in range(5)] == [True, False, False, True, False]
    assert not StableTimeStep(0.8, 1e-5, 3).due(0)


def test_fixed_step_is_taken_as_it_is(cloud, grid):
    assert cloud(grid(4, 4, spacing=SPACING), fixed=1.25e-7).dt == 1.25e-7


def test_nothing_to_limit_the_step_is_an_error_that_says_what_to_do(cloud):
    with pytest.raises(InputError, match="time_step.fixed: no point has a bond or a contact"):
        cloud(np.array([[0.0, 0.0], [1.0, 0.0]]))


def test_nan_shows_in_the_local_frequency_wherever_it_is(cloud, grid):
    for point in (0, 17, 29):
        sim = cloud(grid(6, 5, spacing=SPACING), fixed=1e-6)
        sim.particles.mass[point] = np.nan
        assert np.isnan(local_frequency(sim, ()))


def test_the_ratio_is_measured_less_often_while_nothing_changes(cloud, grid, monkeypatch):
    """After 200, 400, 800, 800 steps; at once when a spring stiffens, and then often again."""
    sim = cloud(grid(6, 5, spacing=SPACING, jitter=0.1))
    measured = []
    exact = highest_frequency(sim)
    monkeypatch.setattr(
        "periporo.core.motion.timestep.highest_frequency", lambda sim, limit: measured.append(sim.step_number) or exact
    )
    step = StableTimeStep(0.8, None, 10)
    for sim.step_number in range(0, 3000, 10):
        if sim.step_number == 2500:
            sim.particles.mass *= 0.5
        step.choose(sim)
    assert measured == [0, 200, 600, 1400, 2200, 2500, 2700]


def test_viscosity_limits_the_step_as_it_does_the_integrator(cloud, grid):
    """Kicks with velocities half a step old, K and C probed: stable below the limit that looks come to, not above."""
    sim = cloud(grid(6, 5, spacing=SPACING, jitter=0.1), laws=[DruckerPrager.example()],
                scheme=lambda h, name: PointState(h, name, sharpened=SPACING, regular=True))  # fmt: skip
    p = sim.particles
    p.activity[:] = np.random.default_rng(2).uniform(0.5, 1.0, p.owned)
    for _ in range(12):
        step = sim.time_step.choose(sim)
    units = np.eye(2 * p.owned).reshape(-1, p.owned, 2)
    mass = np.repeat(p.mass, 2)
    stiffness = np.array([apply_stiffness(sim, unit).ravel() / mass for unit in units]).T
    damping = np.array([apply_stiffness(sim, unit, 2.0).ravel() / mass for unit in units]).T - stiffness
    largest = []
    for dt in (step / 0.8 * 0.98, step / 0.8 * 1.04):
        velocity = np.hstack([np.eye(len(mass)) - dt * damping, -dt * stiffness])
        both = np.vstack([velocity, np.hstack([np.zeros_like(stiffness), np.eye(len(mass))]) + dt * velocity])
        largest.append(np.abs(np.linalg.eigvals(both)).max())
    assert largest[0] < 1.0 + 1e-6 and largest[1] > 1.05
    assert highest_frequency(sim, step / 0.8) > 1.04 * highest_frequency(sim)  # and it counts
