"""What stages do to each other: velocities after a relaxation, rest, steps that a contact sets, displacements."""

import re

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.motion.relaxation import RelaxationError
from periporo.core.scene.build import build
from periporo.errors import ContactError, InputError
from periporo.io.input.load import parse_scene

SOFT = {"model": "elastic", "density": 1800.0, "bulk_modulus": 25e5, "shear_modulus": 15e5}
SETTLE = {"name": "settle", "type": "relax", "tolerance": 1e-3}


def built(scene):
    return build(parse_scene(scene), MPI.COMM_SELF)


def test_a_velocity_waits_for_the_first_motion(scene_of):
    """The stone neither loses its velocity in the relaxation nor falls on the soil there."""
    scene = scene_of(counts=(6, 4), materials=SOFT)
    stone = {"type": "box", "lower": [-0.01, 0.06], "upper": [0.01, 0.08]}
    scene["bodies"].append({"name": "stone", "material": "soil", "velocity": [0.2, -1.0], "shape": stone})
    scene["contacts"].append({"type": "bodies", "between": "all", "friction": 0.3})
    scene["stages"] = [SETTLE, {"name": "fall", "type": "dynamics", "duration": 1e-9}]
    sim = built(scene)
    p = sim.particles
    sim.run()
    mine = p.body == 1
    way = (p.position - p.initial_position)[mine]  # of the one step
    assert sim.time < 2e-4 and way == pytest.approx(np.tile([0.2, -1.0], (mine.sum(), 1)) * sim.time, abs=1e-7)
    assert p.velocity[mine] == pytest.approx(np.tile([0.2, -1.0], (mine.sum(), 1)), abs=2e-3)  # and gravity
    energies = sim.ledger.entries()
    assert energies["prescribed_work"] == pytest.approx(0.5 * p.mass[mine].sum() * 1.04, rel=1e-9)
    assert abs(energies["energy_residual"] - energies["integration_term"]) < 1e-12 * energies["prescribed_work"]
    scene["stages"] = [SETTLE]
    with pytest.raises(InputError, match=r"bodies\[1\]\.velocity: would never act"):
        built(scene)


@pytest.mark.parametrize("speed", [-0.5, 0.5])
def test_rest_is_not_before_a_plate_arrives(scene_of, speed):
    """A plate 2 mm above the soil comes down in 4 ms; one that goes up is not waited for."""
    scene = scene_of(counts=(6, 4), materials=SOFT, gravity=[0.0, 0.0])
    plate = {"type": "plane", "point": [0.0, 0.042], "normal": [0.0, -1.0], "friction": 0.0, "velocity": [0.0, speed]}
    scene["contacts"].append(plate)
    scene["bodies"][0]["velocity"] = [0.0, 1e-3]  # a little, which damping takes away
    scene["stages"] = [{"name": "go", "type": "dynamics", "duration": 0.02, "stop_when_at_rest": 1e-3,
                        "damping": {"viscous": 5e3}}]  # fmt: skip
    sim = built(scene)
    sim.run()
    assert (sim.time >= 0.02) == (speed < 0.0)


def test_nothing_is_not_at_rest_and_what_is_scheduled_is_awaited(scene_of):
    history = {"times": [0.0, 0.02, 0.03], "values": [0.0, 0.0, 1e-4]}
    scene = scene_of(counts=(6, 4), materials=SOFT, gravity=[0.0, 0.0])
    scene["boundaries"] = {"push": {"where": {"upper": [None, 0.01]}, "displacement": {"y": history}}}
    stage = {"name": "go", "type": "dynamics", "duration": 0.1, "stop_when_at_rest": 1e-2,
             "damping": {"viscous": 1e3}}  # fmt: skip
    scene["stages"] = [stage | {"boundaries": ["push"]}]
    sim = built(scene)
    sim.run()
    assert 0.03 < sim.time < 0.09
    sim = built(scene | {"stages": [stage]})
    sim.run()
    assert sim.time >= 0.0999  # no motion, so no peak to rest from


def test_the_step_is_chosen_when_a_stage_begins(scene_of):
    """A plane a thousand times as stiff appears in the middle of an interval; the flight ends as it began."""
    stiff = {"type": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.0, "stiffness": 1e12,
             "stages": ["hit"]}  # fmt: skip
    scene = scene_of(counts=(6, 4), materials=SOFT, gravity=[0.0, 0.0], contacts=[stiff])
    scene["bodies"][0]["shape"] = {"type": "box", "lower": [0.0, 1e-4], "upper": [0.06, 0.0401]}
    scene["bodies"][0]["velocity"] = [0.0, -0.1]
    scene["stages"] = [{"name": "fly", "type": "dynamics", "duration": 2.5e-4},
                       {"name": "hit", "type": "dynamics", "duration": 1.6e-3}]  # fmt: skip
    sim = built(scene)
    sim.run()
    energies = sim.ledger.entries()
    assert sim.particles.velocity[:, 1].max() > 0.05
    total = energies["kinetic_energy"] + energies["internal_energy"] + energies["contact_energy"]
    assert total == pytest.approx(sim.ledger.initial_kinetic, rel=1e-2)


@pytest.mark.parametrize("kind", ["box", "short_range_published"])
def test_an_obstacle_that_appears_where_soil_has_come_is_refused(scene_of, kind):
    """Its place is free at the start; the block flies into it, and would be shot out."""
    place = {"lower": [0.05, -0.1], "upper": [0.09, 0.1]}
    wall = {"type": kind, "stages": ["meet"], "friction": 0.0}
    wall |= place if kind == "box" else {"substrate": place}
    scene = scene_of(counts=(6, 4), materials=SOFT, gravity=[0.0, 0.0], contacts=[wall])
    scene["bodies"][0]["velocity"] = [1.0, 0.0]
    scene["stages"] = [{"name": "fly", "type": "dynamics", "duration": 0.03},
                       {"name": "meet", "type": "dynamics", "duration": 1e-3}]  # fmt: skip
    with pytest.raises(ContactError, match=r"contacts\[0\]: a point at \(.*\), .* m behind .* in stage 'meet'"):
        built(scene).run()


@pytest.mark.parametrize("level", [-0.002, -0.02])
def test_soil_that_is_placed_in_an_obstacle_presses_from_there_on_or_is_refused(scene_of, level):
    scene = scene_of(counts=(6, 4), materials=SOFT, gravity=[0.0, 0.0])
    new = {"type": "box", "lower": [0.1, level], "upper": [0.16, level + 0.04]}
    scene["bodies"].append({"name": "new", "material": "soil", "shape": new, "lattice": "own"})
    scene["stages"] = [{"name": "wait", "type": "dynamics", "duration": 1e-4},
                       {"name": "build", "type": "dynamics", "duration": 2e-3, "place": ["new"]}]  # fmt: skip
    sim = built(scene)
    if level < -0.01:
        with pytest.raises(ContactError, match="is in its way in stage 'build'"):
            sim.run()
    else:
        sim.run()
        assert sim.ledger.kinetic() < 1e-20


def test_what_flows_does_not_settle(scene_of):
    """A slope of loose soil; its displacement is told where it stands, and limited where it does not."""
    loose = {"model": "drucker_prager", "density": 1800.0, "bulk_modulus": 25e5, "shear_modulus": 15e5,
             "friction_angle": 5.0, "cohesion": 0.0}  # fmt: skip
    scene = scene_of(counts=(10, 10), materials=loose, stages=[SETTLE | {"max_steps": 5000}])
    sim = built(scene)
    with pytest.raises(RelaxationError, match=r"body 'block' has moved by .* m, more than the 0\.01 m"):
        sim.run()
    scene["materials"] = {"soil": SOFT}
    scene["stages"][0] |= {"reset_displacement": True}
    sim = built(scene)
    told = []
    sim.observers = [type("Ear", (), {
        "start_stage": lambda self, sim, stage: None, "after_step": lambda self, sim: None,
        "finish_stage": lambda self, sim, stage, summary: told.append(summary)})()]  # fmt: skip
    sim.run()
    settled = float(re.search(r"largest displacement (\S+) m", told[0])[1])
    assert settled == pytest.approx(2.4e-5, rel=0.15)  # rho g H^2 / 2 over a modulus between free sides and held ones
    assert (sim.particles.position == sim.particles.initial_position).all()


def test_what_only_one_stage_names_ends_with_it(scene_of):
    """A block rests on a floor of the first stage, and falls freely in the second."""
    scene = scene_of(counts=(4, 4), materials=SOFT)
    scene["contacts"][0] |= {"stages": ["settle"], "name": "floor"}
    scene["stages"] = [SETTLE, {"name": "fall", "type": "dynamics", "duration": 0.02}]
    sim = built(scene)
    sim.run()
    p = sim.particles
    speed = (p.mass @ p.velocity[: p.owned, 1]) / p.mass.sum()
    assert speed == pytest.approx(-9.81 * sim.time, rel=1e-9)
    (floor,) = sim.reactions
    assert floor.histories(sim)["floor_force_y"] == 0.0
