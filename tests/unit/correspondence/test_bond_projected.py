"""The scheme against its formulas, written out with dense matrices, and its invariants."""

import numpy as np
import pytest

from periporo.core.correspondence.influence import NAMES, support
from periporo.core.correspondence.moments import DEGENERATE, REGULAR
from periporo.core.numerics.tensors import to_matrix
from periporo.errors import InputError
from periporo.io.input.load import parse_scene
from periporo.materials.elastic import Elastic

SPACING = 0.01
CLOUDS = [((6, 5), 1), ((6, 5), 2), ((4, 3, 4), 1), ((4, 3, 4), 2)]
SOFT = Elastic(density=2100.0, bulk_modulus=1e7, shear_modulus=4e6)


@pytest.fixture(params=[(*c, t) for c in CLOUDS for t in (0.0, 1.0)], ids=lambda c: f"{len(c[0])}D, {c[1]}, {c[2]:g}")
def sim(request, cloud, grid):
    """A jittered cloud with unequal volumes, random velocities and random stress in every row; two dilatations."""
    counts, laws, taken = request.param
    rng = np.random.default_rng(4)
    position = grid(*counts, spacing=SPACING, jitter=0.2)
    sim = cloud(position, laws=[Elastic.example(), SOFT][:laws], law_of=rng.integers(0, laws, len(position)))
    p, sim.scheme.taken = sim.particles, taken
    p.volume *= rng.uniform(0.7, 1.4, p.total)
    p.velocity[:] = rng.normal(size=p.velocity.shape)
    sim.scheme.deform(p, sim.bonds, sim.halo, 0.0, np.inf)
    for block in sim.bonds.blocks:
        block.stress[:] = 1e4 * rng.normal(size=block.stress.shape)
    return sim


def dense(sim):
    """w V_i V_j, W, K, K^-1 of all pairs and points, from the definitions."""
    p, n = sim.particles, sim.particles.total
    xi = p.position[None] - p.position[:, None]  # x_j - x_i
    s = np.sqrt((xi**2).sum(axis=2)) / sim.scheme.horizon
    w = np.where(s < 0.5, 1 - 6 * s**2 + 6 * s**3, np.where(s < 1, 2 * (1 - s) ** 3, 0.0))
    np.fill_diagonal(w, 0.0)
    wv = w * p.volume[None]
    shape = np.einsum("ij,ija,ijb->iab", wv, xi, xi)
    return xi, w, wv, wv.sum(axis=1), shape, np.linalg.inv(shape), n


def rows_of(sim):
    """(block, row, lower id, higher id, volume of the row) of all active rows."""
    for block in sim.bonds.blocks:
        volumes = sim.bonds.layout.volumes(block, sim.bonds.pairs, sim.particles, np.arange(len(block.pair)))
        for r in np.flatnonzero(block.active):
            i, j = sim.bonds.pairs.ids[block.pair[r]]
            yield block, r, i, j, volumes[r]


def forces(sim):
    force = np.zeros_like(sim.particles.position)
    sim.scheme.internal_force(sim.particles, sim.bonds, sim.halo, force)
    return force


def test_strain_increments_follow_the_formula(sim):
    p, d, dt = sim.particles, sim.particles.dimension, 1e-9
    xi, _, wv, _, _, inverse, _ = dense(sim)
    dv = p.velocity[None] - p.velocity[:, None]
    gradient = np.einsum("ij,ija,ijb,ibc->iac", wv, dv, xi, inverse)
    sim.scheme.deform(p, sim.bonds, sim.halo, dt, np.inf)
    assert p.gradient == pytest.approx(gradient.reshape(p.total, -1), rel=1e-11, abs=1e-9)
    assert p.jacobian == pytest.approx(1 / np.linalg.det(np.eye(d) - dt * gradient), rel=1e-14)
    for block, r, i, j, _ in rows_of(sim):
        x, mean = xi[i, j], 0.5 * (gradient[i] + gradient[j])
        bond = mean + np.outer(dv[i, j] - mean @ x, x) / (x @ x)
        assert bond @ x == pytest.approx(dv[i, j], rel=1e-10)  # the bond sees its own relative velocity
        if sim.scheme.taken:
            bond += (np.trace(mean) - np.trace(bond)) / d * np.eye(d)  # and expands as its points do
        rate = np.zeros((3, 3))
        rate[:d, :d] = 0.5 * (bond + bond.T)
        found = to_matrix(block.strain_increment[r : r + 1])[0] / dt
        assert found == pytest.approx(rate, rel=1e-5, abs=1e-5 * np.abs(rate).max())


def test_internal_force_follows_the_formula(sim):
    p, d = sim.particles, sim.particles.dimension
    xi, w, _, _, _, inverse, n = dense(sim)
    z, expected = np.zeros((n, d, d)), np.zeros((n, d))
    for block, r, i, j, c in rows_of(sim):
        x = xi[i, j]
        s = to_matrix(block.stress[r : r + 1])[0][:d, :d]
        along = (s - sim.scheme.taken * np.trace(s) / d * np.eye(d)) @ x
        part = 0.5 * c * (s - np.outer(along, x) / (x @ x))
        z[i] += part
        z[j] += part
        t = c * along / (x @ x)
        expected[i] += t
        expected[j] -= t
    flux = z @ inverse / p.volume[:, None, None]
    for i in range(n):
        for j in range(i + 1, n):
            t = w[i, j] * p.volume[i] * p.volume[j] * (flux[i] + flux[j]) @ xi[i, j]
            expected[i] += t
            expected[j] -= t
    assert forces(sim) == pytest.approx(expected, rel=1e-9, abs=1e-11 * np.abs(expected).max())


def test_volumes_of_the_rows_add_up_to_the_volume(sim):
    _, w, _, weight, _, _, _ = dense(sim)
    v = sim.particles.volume
    for block in sim.bonds.blocks:
        assert len(block.pair)
    shares = {}
    for _, _, i, j, c in rows_of(sim):
        shares[i, j] = shares.get((i, j), 0.0) + c
    for (i, j), c in shares.items():
        assert c == pytest.approx(w[i, j] * v[i] * v[j] * (1 / weight[i] + 1 / weight[j]), rel=1e-13)
    assert sum(shares.values()) == pytest.approx(v.sum(), rel=1e-13)


def test_momenta_are_conserved_to_rounding(sim):
    x, f = sim.particles.position, forces(sim)
    size = np.abs(f).sum()
    assert np.abs(f.sum(axis=0)).max() < 1e-14 * size
    d = x.shape[1]
    for a in range(d):
        for b in range(a):
            torque = (x[:, a] * f[:, b] - x[:, b] * f[:, a]).sum()
            assert abs(torque) < 1e-14 * size * np.abs(x).max()


def test_force_is_the_conjugate_of_the_stress_power(sim):
    p, dt = sim.particles, 1e-14
    stress = [b.stress.copy() for b in sim.bonds.blocks]
    power = -(forces(sim) * p.velocity).sum()
    sim.scheme.deform(p, sim.bonds, sim.halo, dt, np.inf)
    found = 0.0
    for block, r, _, _, c in rows_of(sim):
        sigma = to_matrix(stress[block.index][r : r + 1])[0]
        found += c * (sigma * to_matrix(block.strain_increment[r : r + 1])[0]).sum() / dt
    assert found == pytest.approx(power, rel=1e-10)


def test_the_input_names_the_dilatation(scene_of, started):
    points = started(scene_of(correspondence={"scheme": "bond_projected", "dilatation": "points"}))
    own = started(scene_of(correspondence={"scheme": "bond_projected", "dilatation": "bond"}))
    default = started(scene_of(correspondence="bond_projected"))
    assert (points.scheme.taken, own.scheme.taken, default.scheme.taken) == (1.0, 0.0, 0.0)
    with pytest.raises(InputError, match="'standard' has no option dilatation; leave it out, or choose bond_projected"):
        parse_scene(scene_of(correspondence={"scheme": "standard", "dilatation": "points"}))


def test_affine_velocity_is_seen_exactly_by_points_and_bonds(sim):
    p, d, dt = sim.particles, sim.particles.dimension, 1e-12
    gradient = np.random.default_rng(9).normal(size=(d, d))
    p.velocity[:] = p.position @ gradient.T + 1.0
    sim.scheme.deform(p, sim.bonds, sim.halo, dt, np.inf)
    assert p.gradient == pytest.approx(np.tile(gradient.ravel(), (p.total, 1)), rel=1e-11, abs=1e-11)


def test_rigid_rotation_leaves_no_strain_and_turns_the_stress(cloud, grid):
    position = grid(6, 5, spacing=SPACING, jitter=0.2)
    sim = cloud(position)
    p, angle = sim.particles, 0.3
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    block = sim.bonds.blocks[0]
    block.stress[:] = [1.0, 0.0, 0.5, 0.0]
    p.position[:] = position @ turn.T
    p.velocity[:] = p.position - position  # over one second
    sim.scheme.deform(p, sim.bonds, sim.halo, 1.0, np.inf)
    active = block.active
    assert np.abs(block.strain_increment[active]).max() < 1e-13
    c, s = np.cos(angle), np.sin(angle)
    assert block.stress[active] == pytest.approx(np.tile([c * c, s * s, 0.5, c * s], (active.sum(), 1)), abs=1e-13)
    assert p.jacobian == pytest.approx(np.ones(30), abs=1e-13)


def lone_points():
    """Nobody near; two together; three in a line, on which no shape tensor can stand."""
    return np.array([[0.0, 0.0], [1.0, 0.0], [1.01, 0.0], [2.0, 0.0], [2.01, 0.0], [2.02, 0.0]])


def test_free_flying_points_fly_like_stones(cloud):
    from periporo.core.loads.boundary import Gravity

    velocity = np.tile([0.3, 2.0], (6, 1))
    with np.errstate(all="raise"):  # steps in which no point moves by a tenth of the spacing
        sim = cloud(lone_points(), velocity=velocity, fixed=4e-4, loads=[Gravity(np.array([0.0, -9.81]))])
        for _ in range(200):
            sim.step()
    t, p = sim.time, sim.particles
    assert t == pytest.approx(0.08, rel=1e-14)
    path = [0.3 * t, 2.0 * t - 0.5 * 9.81 * t**2]
    assert p.position == pytest.approx(lone_points() + path, rel=1e-13)
    assert not p.share.any() and (p.jacobian == 1.0).all() and not p.internal_force.any()
    assert (p.volume == SPACING**2).all()


def test_a_free_flying_point_lands_and_feels_stress_again(cloud, grid):
    body = grid(6, 3, spacing=SPACING)
    stone = np.array([[0.025, 0.025 + 2.3 * SPACING]])
    velocity = np.zeros((19, 2))
    velocity[18, 1] = -10.0
    sim = cloud(np.vstack([body, stone]), velocity=velocity)
    p = sim.particles
    assert p.share[18, 1] == 0.0
    while p.share[18, 1] < 1.0 and sim.time < 0.2 * SPACING:
        sim.step()
    assert p.share[18, 1] == 1.0 and (sim.bonds.pairs.weight[sim.bonds.pairs.ids[:, 1] == 18] > 0.0).sum() >= 3
    for _ in range(20):
        sim.step()
    momentum = (p.mass[:, None] * p.velocity).sum(axis=0)
    assert momentum == pytest.approx([0.0, -10 * p.mass[18]], rel=1e-12, abs=1e-13)
    assert p.velocity[18, 1] > -9.9 and p.velocity[:18, 1].mean() < -1e-5
    assert sim.bonds.blocks[0].stress[:, 1].min() < -1e2


@pytest.mark.parametrize("height", [0.02, 0.3, 0.45, 0.9])
def test_integrity_falls_with_the_width_of_the_neighbourhood(cloud, height):
    """Points almost on a line: the harmonic mean of the eigenvalues of K/W over the horizon decides."""
    x = SPACING * np.arange(7)
    zigzag = SPACING * height * (np.arange(7) % 2)
    sim = cloud(np.stack([x, zigzag], axis=1), fixed=1e-6)
    _, w, _, weight, shape, _, _ = dense(sim)
    width = 2.0 / (1.0 / np.linalg.eigvalsh(shape)).sum(axis=1) / weight
    wide = (width / sim.scheme.horizon**2 - DEGENERATE) / (REGULAR - DEGENERATE)
    expected = np.clip(wide, 0.0, 1.0) ** 2
    expected[(w > 0).sum(axis=1) < 3] = 0.0
    assert sim.particles.share[:, 1] == pytest.approx(expected, abs=1e-10)
    assert height != 0.3 or ((expected > 0.0) & (expected < 1.0)).any()


def test_lumps_smaller_than_the_horizon_are_degenerate(cloud, grid):
    """Four points of a regular shape carry stress at a spacing of one, none at a quarter of it."""
    for size, beta in ((1.0, 1.0), (0.25, 0.0)):
        sim = cloud(size * grid(2, 2, spacing=SPACING), fixed=1e-6)
        assert sim.particles.share[:, 1] == pytest.approx(beta)


@pytest.mark.parametrize("influence", NAMES)
@pytest.mark.parametrize("counts", [(6, 5), (5, 4, 4)])
@pytest.mark.parametrize("horizon", [2.0, 2.2, 3.0])
def test_every_point_of_a_lattice_is_regular(cloud, grid, influence, counts, horizon):
    """Corners and edges, too, also when the points are a little out of place."""
    if (influence, horizon) == ("cubic", 2.0):
        pytest.skip("corners have three bonds only")
    sim = cloud(grid(*counts, spacing=SPACING, jitter=0.1), influence=influence, horizon=horizon, fixed=1e-6)
    assert (sim.particles.share[:, 1] == 1.0).all()


def test_close_pairs_see_less_of_their_own_velocity(cloud, grid):
    """n = xi/closest^2 below `closest`: strain and its conjugate force, against a pair written out."""
    position = grid(6, 5, spacing=SPACING)
    position[14] = position[13] + SPACING * np.array([0.35, 0.1])
    sim = cloud(position, fixed=1e-6)
    p, dt = sim.particles, 1e-14
    p.velocity[:] = np.random.default_rng(3).normal(size=p.velocity.shape)
    block = sim.bonds.blocks[0]
    block.stress[:] = 1e4 * np.random.default_rng(5).normal(size=block.stress.shape)
    stress = block.stress.copy()
    power = -(forces(sim) * p.velocity).sum()
    sim.scheme.deform(p, sim.bonds, sim.halo, dt, np.inf)
    found = sum(
        c * (to_matrix(stress[r : r + 1])[0] * to_matrix(block.strain_increment[r : r + 1])[0]).sum() / dt
        for _, r, _, _, c in rows_of(sim)
    )
    assert found == pytest.approx(power, rel=1e-9)
    r = int(np.flatnonzero((sim.bonds.pairs.ids == [13, 14]).all(axis=1))[0])
    x, dv = p.position[14] - p.position[13], p.velocity[14] - p.velocity[13]
    assert x @ x < sim.scheme.closest**2 < SPACING**2
    mean = 0.5 * (p.gradient[13] + p.gradient[14]).reshape(2, 2)
    bond = mean + np.outer(dv - mean @ x, x) / sim.scheme.closest**2
    rate = np.zeros((3, 3))
    rate[:2, :2] = 0.5 * (bond + bond.T)
    seen = to_matrix(block.strain_increment[r : r + 1])[0] / dt
    assert seen == pytest.approx(rate, rel=1e-4, abs=1e-4 * abs(rate).max())


def test_rows_hold_the_present_volume(cloud, grid):
    sim = cloud(grid(5, 4, spacing=SPACING), fixed=1e-6)
    p = sim.particles
    for dilation in (0.9, 3.0):
        p.dilation[:] = dilation
        sim.scheme.deform(p, sim.bonds, sim.halo, 0.0, np.inf)
        total = sum(c for *_, c in rows_of(sim))
        assert total == pytest.approx(dilation * p.volume.sum(), rel=1e-12)


def test_integrity_takes_its_share_of_volume(cloud, grid):
    """A degenerate neighbour's bond carries no volume: the sum of the rows is that of what is left."""
    body = grid(5, 4, spacing=SPACING)
    position = np.vstack([body, [[0.025, 0.035 + 1.82 * SPACING]]])
    sim = cloud(position, fixed=1e-6)
    beta = sim.particles.share[:, 1]
    assert 0.1 < beta[20] < 0.95 and (beta[:20] == 1.0).all()
    _, w, _, weight, _, _, _ = dense(sim)
    v = sim.particles.volume
    for _, _, i, j, c in rows_of(sim):
        both = beta[i] * beta[j] * (1 / weight[i] + 1 / weight[j])
        assert c == pytest.approx(w[i, j] * v[i] * v[j] * both, rel=1e-12)


def jump_of_a_newborn_bond(cloud, grid, influence):
    """Largest change of the force, over its size, as one pair comes within the horizon by 1e-12 spacings."""
    position = grid(7, 6, spacing=SPACING, jitter=0.1)
    first, second = 0, 12
    direction = position[first] - position[second]
    away = direction / np.sqrt(direction @ direction)
    found = []
    for gap in (1e-9, -1e-9):
        moved = position.copy()
        moved[first] = position[second] + (support(influence, 2.2) + gap) * SPACING * away
        sim = cloud(moved, influence=influence, fixed=1e-7)
        found.append((len(sim.bonds.pairs.ids), sim, moved))
    sim, near = found[0][1], found[1][2]
    block = sim.bonds.blocks[0]
    block.stress[:] = 1e4 * np.random.default_rng(1).normal(size=block.stress.shape)
    active, before, mass = int(block.active.sum()), forces(sim), sim.particles.mass.copy()
    sim.particles.position[:] = near
    sim.scheme.deform(sim.particles, sim.bonds, sim.halo, 0.0, np.inf)
    after = forces(sim)
    assert block.active.sum() == active + 1
    assert (sim.particles.mass == mass).all()
    assert np.abs(after.sum(axis=0)).max() < 1e-13 * np.abs(after).sum()
    return np.abs(after - before).max() / np.abs(before).max()


@pytest.mark.parametrize("influence", ["cubic", "conical", "gaussian"])
def test_newborn_bond_makes_neither_mass_nor_momentum_nor_force_jump(cloud, grid, influence):
    assert jump_of_a_newborn_bond(cloud, grid, influence) < 1e-7


def test_newborn_bond_jumps_where_the_influence_does_not_vanish(cloud, grid):
    assert jump_of_a_newborn_bond(cloud, grid, "constant") > 1e-4


def test_nan_stress_of_one_bond_shows_in_the_forces_around_it(cloud, grid):
    sim = cloud(grid(6, 5, spacing=SPACING), fixed=1e-6)
    row = np.flatnonzero(sim.bonds.blocks[0].active)[40]
    sim.bonds.blocks[0].stress[row, 0] = np.nan
    sim.step()
    touched = set(np.flatnonzero(np.isnan(sim.particles.internal_force).any(axis=1)))
    assert touched >= set(sim.bonds.pairs.ids[row]) and len(touched) > 2
    assert np.isnan(sim.ledger.entries()["internal_energy"])


def test_nan_velocity_of_one_point_shows_in_its_place_and_in_the_energy(cloud, grid):
    sim = cloud(grid(6, 5, spacing=SPACING), fixed=1e-6)
    sim.particles.velocity[14, 0] = np.nan
    for _ in range(3):
        sim.step()
    assert np.isnan(sim.particles.position[14, 0])
    assert np.isnan(sim.ledger.kinetic())
