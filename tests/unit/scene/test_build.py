"""From the input to a simulation: what is there, with the numbers that the input asks for."""

import numpy as np
import pytest

from periporo.core.loads.boundary import Gravity, PrescribedMotion, ViscousDamping
from periporo.core.motion.stages import DynamicsStage, RelaxStage
from periporo.core.scene.build import SCHEMES


@pytest.mark.parametrize("dimension, counts", [(2, (10, 8)), (3, (5, 4, 3))])
def test_points_fill_the_body(scene_of, started, dimension, counts):
    sim = started(scene_of(dimension, counts))
    p, n = sim.particles, int(np.prod(counts))
    assert p.owned == p.total == n and p.id.tolist() == list(range(n))
    assert p.volume == pytest.approx(np.full(n, 0.01**dimension)) and p.mass == pytest.approx(1760 * p.volume)
    size = np.array(counts) * 0.01
    assert p.position.min(axis=0) == pytest.approx([*(-size[:-1] / 2), 0.0] + np.full(dimension, 0.005))
    assert p.position.max(axis=0) == pytest.approx([*(size[:-1] / 2), size[-1]] - np.full(dimension, 0.005))
    assert (p.initial_position == p.position).all() and not p.velocity.any()


def test_two_bodies_have_their_own_material_and_velocity(scene_of, started):
    scene = scene_of(materials="two")
    scene["bodies"] = [
        {"name": "one", "material": "top", "velocity": [1.0, 2.0],
         "shape": {"type": "box", "lower": [0.0, 0.0], "upper": [0.05, 0.05]}},
        {"name": "two", "material": "soil", "shape": {"type": "box", "lower": [0.2, 0.0], "upper": [0.25, 0.05]}},
    ]  # fmt: skip
    p = started(scene).particles
    one = p.body == 0
    assert one.sum() == (p.body == 1).sum() == 25
    assert (p.material == one).all() and (p.velocity == np.where(one[:, None], [1.0, 2.0], 0.0)).all()
    assert p.mass == pytest.approx(np.where(one, 2100.0, 1760.0) * 1e-4)


def test_layers_take_their_material_by_level(scene_of, started):
    p = started(scene_of(materials="two")).particles
    assert (p.material == (p.position[:, 1] > 0.04)).all()


def test_stages_hold_what_the_input_names(scene_of, started):
    where = {"upper": [-0.04, None]}
    boundaries = {"wall": {"where": where, "fix": ["x"]}, "push": {"where": where, "velocity": {"x": 2.0}}}
    scene = scene_of(boundaries=boundaries)
    scene["contacts"][0]["stages"] = ["fall"]
    scene["stages"] = [
        {"name": "settle", "type": "relax", "tolerance": 1e-3, "max_steps": 7, "boundaries": ["wall"]},
        {"name": "fall", "type": "dynamics", "duration": 0.5, "boundaries": ["push"], "damping": {"viscous": 3.0},
         "stop_when_at_rest": 1e-4},
    ]  # fmt: skip
    sim = started(scene)
    settle, fall = sim.stages
    assert isinstance(settle, RelaxStage) and (settle.tolerance, settle.max_steps) == (1e-3, 7)
    assert isinstance(fall, DynamicsStage) and (fall.duration, fall.rest_fraction) == (0.5, 1e-4)
    assert len(fall.contacts) == len(settle.contacts) + 1
    assert [type(load) for load in fall.loads] == [Gravity, ViscousDamping] and len(settle.loads) == 1
    (wall,), (push,) = settle.prescribed_motions, fall.prescribed_motions
    assert isinstance(wall, PrescribedMotion)
    assert wall.ids.tolist() == np.flatnonzero(sim.particles.position[:, 0] < -0.04).tolist() == push.ids.tolist()
    assert push.velocities[0](0.0, 1e-3) == 2.0 and wall.velocities[0](0.0, 1e-3) == 0.0
    assert sim.loads == settle.loads  # the first stage's conditions are in force


@pytest.mark.parametrize("name", SCHEMES)
def test_every_scheme_runs_with_the_horizon_and_influence_of_the_input(scene_of, started, name):
    sim = started(scene_of(correspondence=name, horizon=2.5, influence="conical"))
    assert type(sim.scheme) is SCHEMES[name] and sim.scheme.horizon == pytest.approx(0.025)
    for _ in range(3):
        sim.step()
    assert np.isfinite(sim.particles.position).all() and sim.particles.internal_force.any()


def test_time_step_options(scene_of, started):
    assert started(scene_of(time_step={"fixed": 1e-6})).dt == 1e-6
    half, full = (started(scene_of(time_step={"safety": s})).dt for s in (0.4, 0.8))
    assert full == pytest.approx(2 * half, rel=1e-12)
    assert started(scene_of(time_step={"update": 3})).time_step.interval == 3


def test_uniform_initial_stress_is_in_equilibrium_inside(scene_of, started):
    stress = {"xx": -1e3, "yy": -2e3, "zz": -1.5e3, "xy": 300.0}
    sim = started(scene_of(counts=(16, 16), initial_stress={"type": "uniform", "components": stress}))
    block, p = sim.bonds.blocks[0], sim.particles
    assert block.stress[block.active] == pytest.approx(np.tile([-1e3, -2e3, -1.5e3, 300.0], (block.active.sum(), 1)))
    inside = np.abs(p.position - [0.0, 0.08]).max(axis=1) < 0.01  # beyond three horizons from the surface
    assert inside.any() and np.abs(p.internal_force[inside]).max() < 1e-10 * np.abs(p.internal_force).max()
