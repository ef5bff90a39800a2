"""What obstacles and boundaries bear: in balance with the momentum and the energy of the soil; free bodies."""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.scene.build import build
from periporo.core.watch.reactions import Reactions
from periporo.core.watch.state import capture, install, memory
from periporo.io.input.load import parse_scene

G = 9.81
SOIL = {"model": "elastic", "density": 1800.0, "bulk_modulus": 2e6, "shear_modulus": 1e6}
MOTION = {"name": "go", "type": "dynamics", "duration": 0.1}
FLOOR = {"type": "plane", "name": "floor", "point": [0, 0], "normal": [0, 1], "friction": 0.4}


def started(contacts, dimension=2, stage=None, watch=None, **keys):
    """A simulation of a block of ten by five points, 1 m by .5 m, on its first stage."""
    upper = [1.0, 0.5] if dimension == 2 else [0.2, 0.2, 0.2]
    box = {"type": "box", "lower": [0.0] * dimension, "upper": upper}
    scene = {
        "dimension": dimension, "spacing": 0.1, "gravity": [0.0] * (dimension - 1) + [-G], "materials": {"soil": SOIL},
        "bodies": [{"name": "block", "material": "soil", "shape": box}], "contacts": contacts,
        "stages": [stage if stage and "type" in stage else MOTION | (stage or {})],
    }  # fmt: skip
    sim = build(parse_scene(scene | keys, "."), MPI.COMM_SELF)
    if watch is not None:
        sim.call_every(1, watch)
    sim.run()
    return sim


def told(sim):
    return {n: v for part in sim.reactions for n, v in part.histories(sim).items()}


def test_impulses_are_what_the_soil_has_gained_and_work_is_booked():
    """A wall begins to push a block along a rough floor, and a paddle beats on it from above."""
    seen = []
    wall = {"type": "box", "name": "wall", "lower": [-0.5, 0.05], "upper": [0, 1], "friction": 0.3, "damping": 0.1,
            "velocity": {"x": {"times": [0, 0.05, 0.1], "values": [0, 2, 1]}}}  # fmt: skip
    paddle = {"type": "box", "name": "paddle", "lower": [0.4, 0.52], "upper": [2.0, 0.7], "friction": 0.3,
              "reference": [1.9, 0.6], "rotation": {"rate": {"times": [0, 0.1], "values": [0, 100]}}}  # fmt: skip
    sim = started([FLOOR, wall, paddle], watch=lambda s: seen.append((s.dt, told(s))))
    p, now, entries = sim.particles, told(sim), sim.ledger.entries()
    momentum = (p.mass[:, None] * p.velocity[: p.owned]).sum(axis=0)
    given = -np.array([[now[f"{name}_impulse_{a}"] for a in "xy"] for name in ("floor", "wall", "paddle")])
    weight = [0.0, -G * p.mass.sum() * sim.time]
    assert given.sum(axis=0) + weight == pytest.approx(momentum, abs=1e-12 * np.abs(given).max())
    assert abs(given[1, 0]) > 300.0 and given[2, 1] < -10.0
    works = np.array([now[f"{name}_work"] for name in ("floor", "wall", "paddle")])
    assert works[0] == 0.0 and works[1] > 100.0 and works[2] > 1.0
    assert entries["obstacle_work"] == pytest.approx(works.sum(), rel=1e-12)
    unexplained = entries["energy_residual"] - entries["integration_term"]
    assert abs(unexplained) < 1e-12 * works.max()
    overlaps = [0.05 + getattr(p, c.cell)[:, 1] - c.gap(p.position[: p.owned])[0] for c in sim.contacts[:3]]
    squares = [(np.maximum(h, 0.0) ** 2).sum() for h in overlaps]
    stored = sum(0.5 * c.stiffness * square for c, square in zip(sim.contacts, squares, strict=False))
    assert entries["contact_energy"] == pytest.approx(stored, rel=0.02) and entries["friction_dissipation"] > 0.0
    powers = [(dt, h["paddle_power"]) for dt, h in seen]
    assert sum(dt * w for dt, w in powers) == pytest.approx(works[2], rel=0.05)
    dt, last = seen[-1]
    assert last["paddle_power"] == pytest.approx(-last["paddle_torque"] * last["paddle_spin"], rel=1e-9)
    assert last["paddle_spin"] == pytest.approx(np.radians(100.0), rel=0.02)
    force = np.hypot(last["wall_force_x"], last["wall_force_y"])
    assert max(h["wall_peak_force"] for _, h in seen) >= (1.0 - 1e-12) * force


def test_only_obstacles_that_points_are_near_are_added_up():
    """A block bounces from one wall to another, past a third that it never meets; then it is put back to the first."""
    near, kept, wall = [], [], {"type": "box", "friction": 0.0}
    walls = [wall | {"name": name, "lower": [x, y], "upper": [x + 0.5, y + 1.0]}
             for name, x, y in (("left", -0.5, -0.2), ("right", 1.6, -0.2), ("far", 0.0, 3.0))]  # fmt: skip

    def watch(sim):
        (reactions,) = (o for o in sim.observers if isinstance(o, Reactions))
        near.append([o.reaction.name for o in reactions._near[1]])
        if not kept:
            kept.append(capture(sim))

    bodies = [{"name": "block", "material": "soil", "velocity": [-5.0, 0.0],
               "shape": {"type": "box", "lower": [0.0, 0.0], "upper": [1.0, 0.5]}}]  # fmt: skip
    sim = started(walls, stage={"duration": 0.2}, watch=watch, bodies=bodies, gravity=[0.0, 0.0])
    now, p = told(sim), sim.particles
    assert {tuple(names) for names in near} >= {("left",), ("right",)} and "far" not in sum(near, [])
    momentum = (p.mass * (p.velocity[: p.owned, 0] + 5.0)).sum()
    assert -now["left_impulse_x"] - now["right_impulse_x"] == pytest.approx(momentum, rel=1e-12)
    assert now["right_impulse_x"] > 1000.0 and now["left_impulse_x"] < -1000.0 and now["left_force_x"] == 0.0
    assert now["far_impulse_x"] == now["far_peak_force"] == 0.0
    clocks = memory(sim)  # go on, as in a search for a factor of safety, and so does the number of rebuilds
    clocks["simulation"]["skin"] = kept[0].memory["simulation"]["skin"]
    assert "left" not in near[-1]
    install(sim, replace(kept[0], memory=clocks))
    sim.step()
    assert "left" in near[-1]


def test_torque_of_a_weight_and_forces_of_boundaries():
    stage = {"type": "relax", "name": "rest", "tolerance": 1e-6}
    sim = started([FLOOR | {"reference": [-2.0, 0.0]}], stage=stage)
    weight, now = sim.particles.mass.sum() * G, told(sim)
    assert now["floor_force_y"] == pytest.approx(-weight, rel=1e-5)
    assert now["floor_torque"] == pytest.approx(-2.5 * weight, rel=1e-5)
    assert now["floor_impulse_y"] == 0.0
    boundaries = {"base": {"where": {"upper": [None, 0.1]}, "fix": ["x", "y"]},
                  "top": {"where": {"lower": [None, 0.4]}, "velocity": {"x": {"times": [0, 1], "values": [0, 3]}}}}
    momenta = []

    def watch(s):
        p = s.particles
        momenta.append(((p.mass[:, None] * p.velocity[: p.owned]).sum(axis=0), s.dt, told(s)))

    time = started([], stage={"boundaries": ["base", "top"]}, boundaries=boundaries, watch=watch).time
    (before, _, first), (after, dt, second) = momenta[-2:]
    mean = [-0.5 * sum(h[f"{n}_force_{a}"] for h in (first, second) for n in boundaries) for a in "xy"]
    gained = (after - before) / dt + [0.0, weight]
    assert mean == pytest.approx(gained, rel=1e-9)
    assert second["top_power"] == pytest.approx(-3.0 * time * second["top_force_x"], rel=1e-3)


def test_a_peak_between_two_rows_is_told_by_the_second():
    """A paddle strikes and is gone: it tells the largest force of all steps, and then counts anew."""
    forces = []
    paddle = {"type": "plane", "name": "paddle", "point": [0, 0.55], "normal": [0, -1], "friction": 0.0,
              "displacement": {"y": {"times": [0, 0.02, 0.04], "values": [0, -0.06, 0]}}}  # fmt: skip

    def watch(sim):
        (part,) = (part for part in sim.reactions if part.name == "paddle")
        forces.append(np.hypot(*part.loads.sum(axis=0)[:2]))

    now = told(sim := started([FLOOR, paddle], watch=watch))
    assert forces[-1] == 0.0 and now["paddle_peak_force"] == max(forces) > 1e4
    assert told(sim)["paddle_peak_force"] == 0.0


def test_a_wall_in_space_turns_about_its_axis_as_a_right_handed_screw():
    axis, rate, reference = np.array([1.0, 2.0, 2.0]) / 3.0, np.radians(400.0), np.array([5.0, 0.0, 1.0])
    vane = {"type": "box", "name": "vane", "lower": [6, 0, 0], "upper": [7, 1, 1], "friction": 0.0,
            "reference": reference.tolist(), "velocity": [0, 0, 3.0],
            "rotation": {"rate": 400, "axis": [1, 2, 2]}}  # fmt: skip
    floor = FLOOR | {"point": [0, 0, 0], "normal": [0, 0, 1]}
    sim = started([floor, vane], 3, {"duration": 0.2})
    arm = np.array([7.0, 1.0, 0.0]) - reference
    along = (arm @ axis) * axis
    turned = along + np.cos(rate * sim.time) * (arm - along) + np.sin(rate * sim.time) * np.cross(axis, arm)
    corner = sim.contacts[1].motion.pose(sim.time).left((arm + reference)[None])[0]
    assert corner == pytest.approx(reference + [0, 0, 3.0 * sim.time] + turned, rel=1e-9)
    now = told(sim)
    assert [now[f"vane_spin_{a}"] for a in "xyz"] == pytest.approx(rate * axis, rel=1e-6)
    gap, normal = sim.contacts[1].surface.gap(sim.contacts[1].motion.pose(sim.time).entered(corner[None] + 1e-3 * arm))
    assert np.isfinite(normal).all() and abs(gap[0]) < 3e-3


@pytest.mark.parametrize("dimension, share", [(2, 2.0 / 3.0), (3, 5.0 / 7.0)])
def test_a_boulder_rolls_down_an_incline(dimension, share):
    angle, radius = np.radians(20.0), 0.5
    normal = np.array([np.sin(angle), *[0.0] * (dimension - 2), np.cos(angle)])
    away = np.array([-20.0, *[0.0] * (dimension - 1)])
    boulder = {"type": "disc" if dimension == 2 else "sphere", "name": "boulder", "friction": 0.5, "damping": 0.5,
               "center": (away + radius * normal).tolist(), "radius": radius, "free": {"density": 2600}}  # fmt: skip
    incline = {"type": "plane", "name": "incline", "point": away.tolist(), "normal": normal.tolist(), "friction": 0.9}
    seen = []
    started([boulder, incline], dimension, {"duration": 0.6}, lambda s: seen.append((s.time, told(s))))
    half = len(seen) // 2
    (t0, early), (t1, late) = seen[half], seen[-1]
    speeds = [np.hypot(h["boulder_velocity_x"], h[f"boulder_velocity_{'xyz'[dimension - 1]}"]) for h in (early, late)]
    assert (speeds[1] - speeds[0]) / (t1 - t0) == pytest.approx(share * G * np.sin(angle), rel=0.01)
    spin = late["boulder_spin" if dimension == 2 else "boulder_spin_y"]
    assert abs(spin) * radius == pytest.approx(speeds[1], rel=0.01)


@pytest.mark.parametrize("slope, topples", [(0.45, False), (0.55, True)])
def test_a_block_topples_where_it_must(slope, topples):
    """Twice as high as wide, under inclined gravity: its weight points beyond its edge from tan a = .5 on."""
    block = {"type": "box", "name": "block", "lower": [5, 0], "upper": [6, 2], "friction": 1.0, "damping": 0.5,
             "stiffness": 3e8, "free": {"density": 2000}}  # fmt: skip
    gravity = [G * np.sin(np.arctan(slope)), -G * np.cos(np.arctan(slope))]
    sim = started([FLOOR | {"friction": 1.0}, block], stage={"duration": 0.8}, gravity=gravity)
    motion = sim.contacts[1].motion
    turned = np.arctan2(motion.pose(sim.time).turn[0, 1], motion.pose(sim.time).turn[0, 0])
    assert (turned > 0.05) == topples and abs(turned) < 1.5
    if not topples:
        assert abs(turned) < 5e-3 and motion.kinetic() < 1.0


def test_a_pressed_plate_settles_where_soil_bears_its_load():
    """Load control: a light plate on soil, held upright, under gravity and a given force."""
    plate = {"type": "box", "name": "plate", "lower": [0, 0.5], "upper": [1, 0.7], "friction": 0.0, "damping": 1.0,
             "free": {"mass": 200, "force": {"y": {"times": [0, 0.2], "values": [0, -5e3]}}, "hold": ["x", "rotation"]},
             }  # fmt: skip
    sim = started([FLOOR, plate], stage={"duration": 1.5, "damping": {"viscous": 30}})
    now = told(sim)
    assert now["plate_force_y"] == pytest.approx(200 * G + 5e3, rel=0.02)
    assert now["floor_force_y"] == pytest.approx(-(sim.particles.mass.sum() + 200) * G - 5e3, rel=0.02)
    assert now["plate_displacement_y"] < 0.0 and now["plate_spin"] == 0.0
