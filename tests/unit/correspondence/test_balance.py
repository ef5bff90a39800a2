"""Tilted gradients: forces of a uniform stress vanish inside displaced points, and nothing else is lost."""

import numpy as np
import pytest
from mpi4py import MPI

from periporo import Simulation
from periporo.core.correspondence import balance
from periporo.core.motion.timestep import apply_stiffness, highest_frequency
from periporo.core.points.faces import turn
from periporo.errors import InputError
from periporo.io.input.load import parse_scene

BONDS = {"scheme": "bond_projected", "balance": True}
POINTS = {"scheme": "point_state", "sharpened": True, "balance": True}
PLAIN = {"scheme": "point_state", "balance": True}
every_scheme = pytest.mark.parametrize("scheme", (BONDS, POINTS, PLAIN), ids=("bonds", "points", "plain points"))


@pytest.fixture(
    params=[(s, d, j) for s in (BONDS, POINTS) for d in (2, 3) for j in (0.1, 0.2)] + [(PLAIN, 2, 0.1)], ids=str
)
def block(request, scene_of, started):
    """A free block of points with jitter, at rest."""
    scheme, d, jitter = request.param
    scene = scene_of(d, (18, 16) if d == 2 else (9, 9, 9), contacts=[], correspondence=scheme)
    scene["bodies"][0]["jitter"] = jitter
    return started(scene)


def forces_of_uniform_stress(sim):
    """Force (n, d) N of a stress of 1 Pa all around, and of one in shear."""
    p, found = sim.particles, []
    for components in (slice(0, p.dimension), slice(3, 4)):
        for b in sim.bonds.blocks:
            b.stress[:] = 0.0
            b.stress[:, components] = 1.0
        force = np.zeros((p.total, p.dimension))
        sim.scheme.internal_force(p, sim.bonds, sim.halo, force)
        found.append(force[: p.owned])
    return found


def test_uniform_stress_exerts_no_force_inside(block):
    p = block.particles
    inner = (np.abs(p.position - p.position.mean(axis=0)) < np.ptp(p.position, axis=0) / 2 - 0.027).all(axis=1)
    assert inner.sum() >= 10
    balanced = forces_of_uniform_stress(block)
    assert p.tilt.any()
    p.tilt[:] = 0.0
    for force, plain in zip(balanced, forces_of_uniform_stress(block), strict=True):
        assert np.linalg.norm(force[inner]) < 0.1 * np.linalg.norm(plain[inner]), (force[inner], plain[inner])
        assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(plain).max()


def test_points_near_surfaces_keep_a_tilt_of_zero(block):
    p = block.particles
    depth = (np.ptp(p.position, axis=0) / 2 - np.abs(p.position - p.position.mean(axis=0))).min(axis=1)
    assert not p.tilt[depth < 0.012].any()
    assert (p.tilt[depth > 0.027] ** 2).sum(axis=1).min() > 0.0


def test_the_operator_is_symmetric_and_positive_and_moves_no_centre(block):
    p, random = block.particles, np.random.default_rng(2)
    u, v = random.normal(size=(2, p.owned, p.dimension))
    x, force = p.position[: p.owned].copy(), apply_stiffness(block, v.copy())
    assert (u * force).sum() == pytest.approx((v * apply_stiffness(block, u.copy())).sum(), rel=1e-10)
    assert (v * force).sum() > 0.0
    size = np.abs(force).sum() * np.ptp(x)
    for a in range(p.dimension):
        assert abs(force[:, a].sum()) < 1e-12 * np.abs(force).sum()
        for b in range(a):
            assert abs((x[:, a] * force[:, b] - x[:, b] * force[:, a]).sum()) < 1e-12 * size


def test_affine_motion_is_exact(block):
    p = block.particles
    gradient = 1e-3 * np.random.default_rng(4).normal(size=(p.dimension, p.dimension))
    block.dt = 1.0
    p.velocity[:] = p.position @ gradient.T
    block.evaluate_forces()
    for b in block.bonds.blocks:
        strain = b.strain_increment[b.active > 0]
        assert len(strain) >= p.owned and np.abs(strain - strain[0]).max() < 1e-14 < 1e-10 * np.abs(strain).max()


def test_tilts_turn_with_the_body(block):
    p, d, steps = block.particles, block.particles.dimension, 100
    axis = np.zeros((d, d))
    axis[0, 1], axis[1, 0] = -1.0, 1.0
    angle = 0.5 * np.pi / steps
    p.gradient[:] = (np.sin(angle) * axis).ravel()  # of a rigid rotation, with respect to the end of its step
    before = p.tilt.copy()
    for _ in range(steps):
        turn(p.tilt, p.gradient, 1.0)
    quarter = np.eye(d)
    quarter[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    assert np.abs(p.tilt - before @ quarter.T).max() < 1e-6 * np.abs(before).max()


def test_the_measured_frequency_leaves_tilts_alone(block):
    before = block.particles.tilt.copy()
    assert before.any()
    highest_frequency(block)
    assert np.array_equal(block.particles.tilt, before)


@pytest.mark.parametrize("scheme", (BONDS, POINTS), ids=("bonds", "points"))
def test_a_column_of_displaced_points_collapses_as_without_and_comes_to_rest(scheme, scene_of, cam_clay_input):
    """Where soil flows tilts are of no use, but do no harm; single runs of so few points scatter by a tenth."""
    stages = [{"name": "collapse", "type": "dynamics", "duration": 1.0, "stop_when_at_rest": 1e-6}]
    soft = {"bulk_modulus": 2.5e6, "shear_modulus": 1.5e6}  # long steps; its weight still strains it by a thousandth
    scene = scene_of(counts=(8, 8), materials=cam_clay_input | soft, stages=stages)
    scene["bodies"][0]["jitter"] = 0.1
    scene["contacts"][0]["damping"] = 0.2
    scene["initial_stress"] = {"type": "geostatic", "K0": 0.7}
    sizes = []
    for balanced in (True, False):
        sim = Simulation.from_scene(scene | {"correspondence": scheme | {"balance": balanced}}, MPI.COMM_SELF)
        sim.run()
        assert sim.time < 0.9
        sizes.append(np.quantile(np.abs(sim.particles.position), 0.95, axis=0))
    assert sizes[0] == pytest.approx(sizes[1], rel=0.2) and sizes[0][0] > 0.075 > 0.065 > sizes[0][1], sizes


def test_few_inner_points_are_balanced_without_adding_up_rounding(scene_of, started):
    """Four points, eight unknowns: forty directions are more than there are."""
    scene = scene_of(counts=(8, 8), correspondence=POINTS)
    scene["bodies"][0]["jitter"] = 0.1
    sim = started(scene)
    largest = np.abs(sim.particles.tilt).max() * sim.spacing
    assert 0.01 < largest < 2.0, largest
    assert 0 < balance.inner_points(sim).sum() < 10  # which overwrites the tilts


@every_scheme
def test_a_grid_needs_hardly_any_tilt(scheme, scene_of, started):
    sim = started(scene_of(counts=(12, 12), correspondence=scheme))
    assert np.abs(sim.particles.tilt).max() * sim.spacing < 1e-3


@every_scheme
def test_initial_stress_and_its_forces_survive(scheme, scene_of, started):
    keys = {"initial_stress": {"type": "geostatic", "K0": 0.5}}
    sim = started(scene_of(counts=(12, 12), correspondence=scheme, **keys))
    plain = started(scene_of(counts=(12, 12), correspondence=scheme | {"balance": False}, **keys))
    force = plain.particles.internal_force
    assert np.abs(force).max() > 0.0
    assert sim.particles.internal_force == pytest.approx(force, abs=1e-3 * np.abs(force).max())


def test_the_input_names_the_balance(scene_of):
    with pytest.raises(InputError, match=r"'sub_horizon' has no option balance; .* point_state or\s+bond_projected"):
        parse_scene(scene_of(correspondence={"scheme": "sub_horizon", "balance": True}))
    with pytest.raises(InputError, match=r"leave out dilatation, or\s+balance"):
        parse_scene(scene_of(correspondence=BONDS | {"dilatation": "points"}))
