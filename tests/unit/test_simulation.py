"""The time loop: what does not depend on it, its clock, and its neighbours."""

import numpy as np
import pytest

from periporo.core.motion.rebuilds import adapt_skin, neighbours_are_stale

SPACING = 0.01


def run(cloud, grid, steps=150, skin=0.3, shift=0.0, order=None):
    """Positions in id order after a body flew, turned and deformed."""
    position = grid(6, 5, spacing=SPACING, jitter=0.15)
    middle = position.mean(axis=0)
    velocity = np.stack([4.0 - 60.0 * (position - middle)[:, 1], 60.0 * (position - middle)[:, 0]], axis=1)
    velocity += 0.3 * np.random.default_rng(7).normal(size=velocity.shape)
    sim = cloud(position + shift, velocity=velocity, fixed=2e-5, start=False)
    sim.skin = sim.largest_skin = skin * SPACING
    if order is not None:
        rows = {name: array[order] for name, array in sim.particles.take(np.arange(30)).items()}
        sim.particles.replace(rows, 0)
    sim.start()
    for _ in range(steps):
        sim.step()
    return sim


def test_bits_do_not_depend_on_when_neighbours_are_found(cloud, grid):
    rare, often = run(cloud, grid, skin=0.6), run(cloud, grid, skin=0.1)
    assert often.rebuild_count > 2 * rare.rebuild_count
    for name in ("position", "velocity", "volume", "internal_force", "work"):
        assert (getattr(rare.particles, name) == getattr(often.particles, name)).all()


def test_bits_do_not_depend_on_the_order_of_the_rows(cloud, grid):
    order = np.random.default_rng(0).permutation(30)
    assert (run(cloud, grid, 30).particles.position == run(cloud, grid, 30, order=order).particles.position).all()


def test_results_do_not_depend_on_where_the_body_is(cloud, grid):
    here, there = run(cloud, grid), run(cloud, grid, shift=1.0)
    assert there.particles.position - 1.0 == pytest.approx(here.particles.position, abs=1e-10)


@pytest.mark.parametrize("counts", [(6, 5), (4, 3, 3)])
def test_momenta_of_a_free_body_of_two_materials_are_conserved(cloud, grid, counts):
    """To rounding over hundreds of steps and rebuilds, with large deformation."""
    from periporo.materials.elastic import Elastic

    position = grid(*counts, spacing=SPACING, jitter=0.2)
    n, d = position.shape
    rng = np.random.default_rng(2)
    soft = Elastic(density=2100.0, bulk_modulus=1e6, shear_modulus=4e5)
    velocity = 3.0 + 2.0 * rng.normal(size=position.shape)
    sim = cloud(position, laws=[Elastic.example(), soft], law_of=rng.integers(0, 2, n), velocity=velocity)
    p = sim.particles

    def momenta():
        moments = np.einsum("n,na,nb->ab", p.mass, p.position, p.velocity)
        return (p.mass[:, None] * p.velocity).sum(axis=0), moments - moments.T

    linear, angular = momenta()
    for _ in range(300):
        sim.step()
    assert sim.rebuild_count > 10
    scale = (p.mass[:, None] * np.abs(p.velocity)).sum()
    now = momenta()
    assert now[0] == pytest.approx(linear, abs=1e-12 * scale)
    assert now[1] == pytest.approx(angular, abs=1e-12 * scale * np.abs(p.position).max())


def test_mass_never_changes_and_volume_follows_the_jacobian(cloud, grid):
    sim = cloud(grid(6, 5, spacing=SPACING))
    p = sim.particles
    mass, start = p.mass.copy(), p.volume.copy()
    rate, dt = 5.0, 1e-5
    sim.time_step.fixed = sim.dt = dt
    centre = p.position.mean(axis=0)
    for _ in range(200):  # a homogeneous stretch of both directions
        p.velocity[:] = rate * (p.position - centre) * (1.0 + 0.5 * rate * dt)
        p.internal_force[:] = 0.0
        sim.step()
    assert (p.mass == mass).all()
    stretch = np.ptp(p.position[:, 0]) / (5 * SPACING)
    total = p.present_volume() / start
    assert total == pytest.approx(np.full(30, stretch**2), rel=1e-10)


def test_clock_does_not_drift(cloud):
    sim = cloud(np.array([[0.0, 0.0]]), fixed=1e-7)
    for _ in range(100_000):
        sim._advance_clock(1e-7)
    assert sim.time == 0.01 and sim.step_number == 100_000
    sim.reset_clock(5.0)
    assert sim.time == 5.0


def test_neighbours_go_stale_at_half_the_skin(cloud, grid):
    sim = cloud(grid(4, 4, spacing=SPACING), fixed=1e-6)
    for moved, stale in ((0.499, False), (0.501, True), (np.nan, True)):
        sim.moved = moved * sim.skin
        assert neighbours_are_stale(sim) is stale


def test_skin_follows_the_motion_and_shows_in_no_bit(cloud, grid):
    fast = run(cloud, grid, skin=0.1)
    adaptive, thick = (cloud(grid(6, 5, spacing=SPACING, jitter=0.15), velocity=fast.particles.velocity, fixed=2e-5)
                       for _ in range(2))  # fmt: skip
    thick.skin = thick.largest_skin
    for _ in range(150):
        adaptive.step()
        thick.step()
    assert adaptive.skin == adaptive.largest_skin  # many rebuilds made it thick
    assert (adaptive.particles.position == thick.particles.position).all()
    adaptive.rebuilt_at = adaptive.step_number - 1000
    adapt_skin(adaptive)
    assert adaptive.skin == pytest.approx(0.7 * adaptive.largest_skin)


def test_start_leaves_the_body_where_it_is(cloud, grid):
    position = grid(4, 4, spacing=SPACING)
    sim = cloud(position)
    assert (sim.particles.position == position).all() and sim.time == 0.0 and sim.step_number == 0
    assert sim.reach == pytest.approx(2.23 * SPACING) and sim.rebuild_count == 1


@pytest.mark.parametrize("speed", [50.0, 150.0])
def test_no_step_moves_or_strains_a_point_by_more_than_a_tenth(scene_of, started, speed):
    """A block thrown at a wall at the speed of its waves and at three times that."""
    soft = {"model": "elastic", "density": 1800.0, "bulk_modulus": 25e5, "shear_modulus": 15e5}
    scene = scene_of(counts=(6, 4), materials=soft, gravity=[0.0, 0.0])
    scene["bodies"][0] |= {"velocity": [0.0, -speed]}
    scene["contacts"][0] |= {"stiffness": 1e11}  # or the wall would be passed
    sim = started(scene)
    strains, ways = [], []
    for _ in range(60):
        before, row = sim.particles.position.copy(), sim.particles.id
        sim.step()
        if sim.particles.id is row:
            ways.append(np.abs(sim.particles.position - before).max() / SPACING)
        strains += [np.sqrt((b.strain_increment**2).sum(axis=1).max()) for b in sim.bonds.blocks]
    assert max(ways) <= 0.1 and 0.01 < max(strains) <= 0.1
