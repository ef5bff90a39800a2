"""Quasi-static relaxation: the state that it reaches, what it reports, and when it gives up."""

import numpy as np
import pytest

from periporo.core.loads.boundary import Gravity
from periporo.core.motion.relaxation import Relaxation, RelaxationError

WEIGHT = 1760.0 * 9.81


@pytest.fixture
def column(scene_of, started):
    """A block of 8 x 8 points between rollers on a smooth floor."""
    walls = {"fix": ["x"], "where": {"lower": [None, None], "upper": [None, None], "body": "block"}}
    scene = scene_of(counts=(8, 8), boundaries={"walls": walls})
    scene["stages"] = [{"name": "settle", "type": "relax", "tolerance": 1e-5, "boundaries": ["walls"]}]
    return started(scene)


def test_column_carries_its_weight(column):
    column.run()
    p = column.particles
    weight = p.mass.sum() * 9.81
    assert p.contact_force.sum(axis=0) == pytest.approx([0.0, weight], abs=1e-4 * weight)
    column.bonds.average(p, np.arange(p.owned))
    stress = p.average_0[:, 1:]
    inside = (p.position[:, 1] > 0.015) & (p.position[:, 1] < 0.065)
    depth = 0.08 - p.position[inside, 1]
    assert stress[inside, 1] == pytest.approx(-WEIGHT * depth, abs=0.05 * WEIGHT * 0.08)
    ratio = (25e6 - 10e6) / (25e6 + 20e6)  # lambda / (lambda + 2 mu): no strain across
    assert stress[inside, 0] == pytest.approx(ratio * stress[inside, 1], rel=0.05)


def test_it_ends_at_rest_at_its_time_below_its_tolerance(column):
    column.reset_clock(3.0)
    stage = column.stages[0]
    column.prescribed_motions, column.contacts, column.loads = stage.prescribed_motions, stage.contacts, stage.loads
    column.apply_loads(0.0)
    relaxation = Relaxation("settle", 1e-4, 10_000)
    relaxation.run(column)
    p = column.particles
    assert column.time == 3.0 and not p.velocity.any() and not column.rate_independent
    assert 0 < relaxation.steps < 1000
    free = np.array([0.0, 1.0])  # the walls hold the rest
    norm = np.sqrt(((column.forces.total() * free) ** 2).sum() / ((p.mass * 9.81) ** 2).sum())
    assert relaxation.residual == pytest.approx(norm, rel=1e-12) and norm < 1e-4


def test_energy_taken_from_the_motion_counts_as_damping(column):
    column.run()
    entries = column.ledger.entries()
    work = max(abs(entries[name]) for name in ("internal_energy", "external_work", "contact_energy"))
    assert entries["damping_dissipation"] > 0.0 and entries["kinetic_energy"] == 0.0
    assert entries["energy_residual"] == pytest.approx(entries["integration_term"], abs=1e-12 * work)


def test_giving_up_tells_how_far_it_came_and_what_to_do(column):
    stage = column.stages[0]
    column.prescribed_motions, column.contacts, column.loads = stage.prescribed_motions, stage.contacts, stage.loads
    column.apply_loads(0.0)
    with pytest.raises(RelaxationError, match=r"stage 'settle': out-of-balance force is .* after 3 steps, not 1e-08"):
        Relaxation("settle", 1e-8, 3).run(column)


def test_what_falls_is_given_up_before_all_steps_are_taken(cloud, grid, monkeypatch):
    monkeypatch.setattr("periporo.core.motion.relaxation._HOPE", 40)
    sim = cloud(grid(4, 4, spacing=0.01), loads=[Gravity(np.array([0.0, -9.81]))])
    relaxation = Relaxation("settle", 1e-3, 10_000)
    with pytest.raises(RelaxationError, match="out-of-balance force was 1 of the load 40 steps ago, and has"):
        relaxation.run(sim)
    assert relaxation.steps == 40


def test_without_loads_the_reactions_of_what_is_held_are_the_scale(scene_of, started):
    """A bar that was pressed together by 0.1 % and let go to equilibrium: plane strain, free sides."""
    ends = {"where": {"body": "block", "upper": [-0.18, None]}, "fix": ["x"]}
    pressed = {"times": [0.0, 1e-3], "values": [0.0, -3.5e-4]}
    drive = {"where": {"body": "block", "lower": [0.18, None]}, "displacement": {"x": pressed}}
    scene = scene_of(counts=(40, 10), contacts=[], boundaries={"held": ends, "driven": drive})
    del scene["gravity"]
    names = ["held", "driven"]
    scene["stages"] = [
        {"name": "press", "type": "dynamics", "duration": 1e-3, "boundaries": names, "damping": {"viscous": 4000.0}},
        {"name": "settle", "type": "relax", "tolerance": 1e-4, "boundaries": names},
    ]
    sim = started(scene)
    sim.run()
    p, relaxation = sim.particles, sim.stages[1].relaxation
    held = np.abs(p.initial_position[: p.owned, 0]) > 0.18
    force = sim.forces.total()
    out_of_balance = np.sqrt((force[~held] ** 2).sum() + (force[held, 1] ** 2).sum())
    assert relaxation.residual == pytest.approx(out_of_balance / np.linalg.norm(force[held, 0]), rel=1e-12)
    assert relaxation.residual < 1e-4
    sim.bonds.average(p, np.arange(p.owned))
    middle = np.abs(p.initial_position[: p.owned, 0]) < 0.1
    strain = -3.5e-4 / 0.37  # between the innermost held points
    plane_modulus = 4 * 15e6 * (3 * 25e6 + 15e6) / (3 * 25e6 + 4 * 15e6)  # E/(1 - nu^2)
    assert p.average_0[: p.owned, 1][middle] == pytest.approx(plane_modulus * strain, rel=0.02)


def test_no_load_is_no_scale(cloud, grid):
    sim = cloud(grid(4, 4))
    with pytest.raises(RelaxationError, match="there is no load.*set gravity"):
        Relaxation("settle", 1e-4, 10).run(sim)


def test_equilibrium_at_the_start_takes_no_step(cloud, grid):
    sim = cloud(grid(4, 4), loads=[Gravity(np.array([0.0, -9.81]))])
    sim.particles.internal_force[:] = -sim.particles.external_force
    relaxation = Relaxation("settle", 1e-4, 10)
    relaxation.run(sim)
    assert relaxation.steps == 0 and relaxation.residual == 0.0
