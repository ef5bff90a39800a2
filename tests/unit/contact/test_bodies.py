"""Contact of deformable bodies: an energy that comes back, smooth and even interfaces, momenta, friction, ranks."""

import re

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.motion.rebuilds import rebuild
from periporo.core.scene.build import build
from periporo.errors import ContactError, InputError
from periporo.io.input.load import parse_scene

H = 0.025
SOFT = {"model": "elastic", "density": 1760.0, "bulk_modulus": 2.5e6, "shear_modulus": 1.5e6}
WAVE = np.sqrt((2.5e6 + 2e6) / 1760.0)  # 50.6 m/s


def scene_of(shapes, velocities=None, friction=0.0, dimension=2, h=H, safety=0.8, **keys):
    """Bodies a, b, ... of soft soil, which may all touch."""
    velocities = velocities or {}
    bodies = [
        {"name": name, "material": "soil", "shape": shape, "velocity": velocities.get(name, [0.0] * dimension)}
        for name, shape in zip("abcdef", shapes, strict=False)
    ]
    return {
        "dimension": dimension, "spacing": h, "materials": {"soil": SOFT}, "bodies": bodies,
        "time_step": {"safety": safety}, "contacts": [{"type": "bodies", "between": "all", "friction": friction}],
        "stages": [{"name": "go", "type": "dynamics", "duration": 1.0}],
    } | keys  # fmt: skip


def box(lower, upper):
    return {"type": "box", "lower": lower, "upper": upper}


def disc(center, radius):
    return {"type": "disc", "center": center, "radius": radius}


def square(center, degrees, half):
    corners = np.radians(degrees + 45.0 + 90.0 * np.arange(4))
    corners = np.array(center) + half * np.sqrt(2.0) * np.stack([np.cos(corners), np.sin(corners)], axis=1)
    return {"type": "polygon", "vertices": corners.tolist()}


def started(scene, comm=MPI.COMM_SELF):
    sim = build(parse_scene(scene), comm)
    sim.start()
    sim.prescribed_motions = sim.stages[0].prescribed_motions
    return sim


def contact_of(sim):
    return next(c for c in sim.contacts if hasattr(c, "faces"))


def go(sim, time):
    while sim.time < time:
        sim.step()
    return sim.ledger.entries()


def motion_of(sim, number):
    """Mass, mean velocity (d,) and, in the plane, spin of a body."""
    p = sim.particles
    mine = p.body == number
    m, x, v = p.mass[mine, None], p.position[mine], p.velocity[mine]
    velocity = (m * v).sum(axis=0) / m.sum()
    arm = x - (m * x).sum(axis=0) / m.sum()
    spin = (m[:, 0] * (arm[:, 0] * v[:, 1] - arm[:, 1] * v[:, 0])).sum() / (m * arm**2).sum()
    return m.sum(), velocity, spin


def momenta(sim):
    """Linear and angular momentum, and the sum of |m v| to compare with."""
    p = sim.particles
    mv = p.mass[:, None] * p.velocity
    x = np.pad(p.position, ((0, 0), (0, 3 - p.dimension)))
    angular = np.cross(x, np.pad(mv, ((0, 0), (0, 3 - p.dimension)))).sum(axis=0)
    return np.concatenate([mv.sum(axis=0), angular]), np.sqrt((mv**2).sum(axis=1)).sum()


ELL = {"type": "polygon", "vertices": [[0, 0], [0.3, 0], [0.3, 0.1], [0.1, 0.1], [0.1, 0.3], [0, 0.3]]}
SLOPE = [[0.0, 0.0], [0.4, 0.0], [0.0, 0.22]]


@pytest.mark.parametrize(
    "shapes",
    [
        (box([0, 0], [0.2, 0.1]), box([0, 0.1], [0.2, 0.2])),
        (box([0, 0], [0.2, 0.1]), box([0.0371, 0.1], [0.1371, 0.2])),
        (box([0, 0], [0.1, 0.1]), box([0.1, 0.1], [0.2, 0.2])),
        (ELL, box([0.1, 0.1], [0.2, 0.2])),
        (disc([0, 0], 0.1), disc([0.1, np.sqrt(0.03)], 0.1)),
        (disc([0, 0.1], 0.1), box([-0.2, -0.1], [0.2, 0.0])),
        (square([0, 0], 30.0, 0.1), square(0.2 * np.array([np.cos(np.pi / 6), 0.5]), 30.0, 0.1)),
        (box([0, 0, 0], [0.1, 0.1, 0.1]), box([0, 0, 0.1], [0.1, 0.1, 0.2])),
    ],
    ids=["boxes", "offset", "corners", "corner", "discs", "ground", "slope", "cubes"],
)
def test_what_only_touches_stays_where_it_is(shapes):
    dimension = 3 if len(shapes[0].get("lower", [0, 0])) == 3 else 2
    sim = started(scene_of(shapes, friction=0.3, dimension=dimension))
    assert contact_of(sim)._present
    energies = go(sim, 10 * sim.dt)
    scale = SOFT["bulk_modulus"] * H**dimension  # of a point squeezed by all of itself
    assert energies["kinetic_energy"] < 1e-20 * scale
    assert abs(energies["contact_energy"]) < 1e-20 * scale


@pytest.mark.parametrize(
    ("shapes", "velocity", "friction"),
    [
        ((square([0, 0], 0.0, 0.1), square([0.06, 0.23], 52.0, 0.1)), [0.3, -2.0], 0.0),  # a corner on a face
        ((square([0, 0], 45.0, 0.1), square([0.14, 0.16], 45.0, 0.1)), [-1.0, -2.0], 0.5),
        ((disc([0, 0], 0.1), disc([0.09, 0.185], 0.1)), [0.0, -1.0], 0.5),
        ((ELL, square([0.21, 0.24], 10.0, 0.07)), [-2.0, -2.0], 0.2),
        ((box([0, 0, 0], [0.1, 0.1, 0.1]), box([0.04, 0.11, 0.06], [0.14, 0.21, 0.16])), [-0.5, -2.0, 0.0], 0.3),
    ],
    ids=["corner", "corners", "discs", "re-entrant", "cubes"],
)
def test_an_impact_gives_back_what_it_took_and_keeps_both_momenta(shapes, velocity, friction):
    sim = started(scene_of(shapes, {"b": velocity}, friction, len(velocity)))
    before, scale = momenta(sim)
    initial, lowest = sim.ledger.initial_kinetic, np.inf
    while sim.time < 0.055:
        sim.step()
        lowest = min(lowest, sim.ledger.kinetic() / initial)
    after, _ = momenta(sim)
    d = len(velocity)
    assert np.abs(after - before)[:d].max() < 1e-13 * scale
    assert np.abs(after - before)[d:].max() < 1e-13 * scale * 0.3  # m
    energies = sim.ledger.entries()
    assert lowest < 0.8 and not contact_of(sim).pressures.any()  # hit, and parted
    assert abs(energies["contact_energy"]) < 2e-3 * initial
    assert energies["friction_dissipation"] >= 0.0 if friction else energies["friction_dissipation"] == 0.0
    assert not sim.particles.face_spring.any()


@pytest.mark.parametrize("safety", [0.4, 0.8])
@pytest.mark.parametrize("points", [20, 40])
def test_restitution_of_bars(points, safety):
    """1 for slender bars by St Venant's theory; Poisson's ratio 0, so that none of it goes to their sides."""
    h = 0.4 / points
    scene = scene_of([box([0, 0], [0.4, 2 * h]), box([0.4 + 0.3 * h, 0], [0.8 + 0.3 * h, 2 * h])], {"a": [0.1, 0.0]},
                     h=h, safety=safety)  # fmt: skip
    scene["materials"] = {"soil": SOFT | {"shear_modulus": 3.75e6}}
    wave = np.sqrt(7.5e6 / 1760.0)
    sim = started(scene)
    energies = go(sim, 0.3 * h / 0.1 + 2.3 * 0.4 / wave)
    (_, a, _), (_, b, _) = motion_of(sim, 0), motion_of(sim, 1)
    assert 0.97 < (b - a)[0] / 0.1 < 1.01  # the sharp front of the impact leaves vibration
    assert abs(energies["contact_energy"]) < 2e-3 * sim.ledger.initial_kinetic


def impact_of_discs(along, velocity, friction, points=10, safety=0.8):
    """Disc b hits disc a, which is at rest, with `velocity` where the line of centres is `along`; both after."""
    radius = points * H
    start = (2.0 * radius + 0.01 * H) * along
    scene = scene_of([disc([0, 0], radius), disc(start.tolist(), radius)], {"b": velocity.tolist()}, friction,
                     safety=safety)  # fmt: skip
    sim = started(scene)
    energies = go(sim, 24.0 * radius / WAVE)
    assert abs(energies["contact_energy"]) < 1e-3 * sim.ledger.initial_kinetic
    return motion_of(sim, 0), motion_of(sim, 1)


@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_restitution_of_discs(degrees):
    """Slow against waves, so that little energy remains in vibration (Gerl & Zippelius 1999)."""
    along = np.array([np.sin(np.radians(degrees)), np.cos(np.radians(degrees))])
    (_, a, _), (_, b, _) = impact_of_discs(along, -0.25 * along, 0.0)
    assert (b - a) @ along / 0.25 == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(("friction", "degrees"), [(0.1, 30.0), (0.5, 75.0)])
def test_friction_in_an_oblique_impact(friction, degrees):
    """Sliding throughout: the tangential impulse is friction times the normal one, and spins both discs alike."""
    along, across = np.array([0.0, 1.0]), np.array([1.0, 0.0])
    points, angle = 20, np.radians(degrees)
    velocity = -0.02 * (along + np.tan(angle) * across)
    (m, a, spin_a), (_, _, spin_b) = impact_of_discs(along, velocity, friction, points)
    impulse = m * a
    assert impulse @ across / (impulse @ along) == pytest.approx(friction, rel=0.05)
    assert spin_a == pytest.approx(spin_b, rel=1e-3)
    assert abs(spin_a) == pytest.approx(abs(impulse @ across) / (0.5 * m * points * H), rel=0.02)


def test_restitution_of_discs_in_an_oblique_impact():
    """Along the impulse, which turns a little with the line of centres; what is across it is kept, by momentum."""
    along = np.array([0.0, 1.0])
    velocity = 0.25 * np.array([np.sin(np.pi / 6.0), -np.cos(np.pi / 6.0)])
    (_, a, spin_a), (_, b, spin_b) = impact_of_discs(along, velocity, 0.0)
    impulse = a / np.sqrt(a @ a)
    assert (a - b) @ impulse / (velocity @ impulse) == pytest.approx(1.0, abs=0.02)
    assert abs(impulse[0]) < np.sin(np.radians(1.5))
    assert max(abs(spin_a), abs(spin_b)) * 10 * H < 0.02 * 0.25


def test_a_stack_stands_for_ten_seconds():
    """Two soft bricks side by side, and one across their joint."""
    h = 0.1
    scene = scene_of(
        [box([0, 0], [0.4, 0.3]), box([0.4, 0], [0.8, 0.3]), box([0.2, 0.3], [0.6, 0.6])], friction=0.5, h=h,
        gravity=[0.0, -9.81], initial_stress={"type": "geostatic", "K0": 0.3},
    )  # fmt: skip
    scene["materials"] = {"soil": SOFT | {"bulk_modulus": 4e5, "shear_modulus": 2.4e5}}
    scene["contacts"].append({"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.5})
    scene["stages"] = [{"name": "settle", "type": "relax", "tolerance": 1e-6},
                       {"name": "stand", "type": "dynamics", "duration": 10.0}]  # fmt: skip
    sim = build(parse_scene(scene), MPI.COMM_SELF)
    sim.start()
    sim.stages[0].run(sim, False)
    before = sim.particles.position.copy()
    sim.stage_number = 1
    sim.stages[1].run(sim, False)
    assert np.abs(sim.particles.position - before).max() < 1e-4 * h
    energies = sim.ledger.entries()
    assert energies["kinetic_energy"] < 1e-8 * sim.particles.mass.sum() * 9.81 * h


def test_a_wave_passes_from_body_to_body():
    """As within a body: nothing of a pulse 20 points long comes back; the contact has no softness of its own."""
    n, h = 20, H
    length, wave = 40 * h, WAVE
    scene = scene_of([box([0, 0], [length, 3 * h]), box([length, 0], [2 * length, 3 * h])])
    scene["boundaries"] = {"sides": {"where": {"lower": [-1.0, None]}, "fix": ["y"]}}
    scene["stages"][0]["boundaries"] = ["sides"]
    sim = started(scene)
    p, block = sim.particles, sim.bonds.blocks[0]
    x = p.position[: p.owned, 0]
    pulse = 1e-4 * wave * np.where(np.abs(x - 25 * h) < 10 * h, np.cos(np.pi * (x - 25 * h) / (n * h)) ** 2, 0.0)
    p.velocity[: p.owned, 0] = pulse
    block.stress[:, :3] = -(pulse / wave)[block.first, None] * np.array([4.5e6, 1.5e6, 1.5e6])
    sim.apply_loads(0.0)
    energies = go(sim, 30 * h / wave)
    v = p.velocity[: p.owned, 0] / pulse.max()
    assert np.abs(v[x < 36 * h]).max() < 0.04
    assert v[x > length].max() == pytest.approx(1.0, abs=0.03)
    assert abs(energies["contact_energy"]) < 1e-3 * 0.5 * (p.mass * pulse**2).sum()


def test_flush_blocks_press_evenly_and_bear_their_weight():
    """Pressure of the faces, and stress of the rows beside them against the weight above."""
    n = 10
    scene = scene_of(
        [box([0, 0], [n * H, n * H]), box([0, n * H], [n * H, 2 * n * H])], friction=0.3, gravity=[0.0, -9.81],
        boundaries={"ground": {"where": {"body": "a", "upper": [None, 2.5 * H]}, "fix": ["y"]},
                    "side": {"where": {"body": "a", "upper": [2.5 * H, 2.5 * H]}, "fix": ["x"]}},
        initial_stress={"type": "geostatic", "K0": 0.0, "surface": 2 * n * H},
        stages=[{"name": "settle", "type": "relax", "tolerance": 1e-4, "boundaries": ["ground", "side"]}],
    )  # fmt: skip
    sim = build(parse_scene(scene), MPI.COMM_SELF)
    sim.run()
    p, contact = sim.particles, contact_of(sim)
    pressure = np.zeros(p.owned)
    np.add.at(pressure, contact.pairs[1], contact.pressures)
    pressure = pressure[pressure > 0.0]
    assert len(pressure) == n
    weight = p.mass[p.body == 1].sum() * 9.81
    assert pressure == pytest.approx(np.full(n, weight / n), rel=0.03)
    sim.bonds.average(p, np.arange(p.owned))
    stress = -getattr(p, sim.bonds.blocks[0].average)[:, 2]
    row = np.rint(p.initial_position[:, 1] / H - 0.5).astype(int)
    for r in range(n - 2, n + 2):
        above = (2 * n - r - 0.5) * H * 1760.0 * 9.81
        assert stress[row == r][2:-2] == pytest.approx(np.full(n - 4, above), rel=0.02)


def sled(friction, speed, damping=0.3):
    """A block that slides on a deformable base."""
    boxes = {"base": ([0.0, 0.0], [1.2, 0.1]), "block": ([0.1, 0.1], [0.4, 0.2])}
    return {
        "dimension": 2, "spacing": H, "gravity": [0.0, -9.81], "materials": {"soil": SOFT},
        "initial_stress": {"type": "geostatic", "K0": 0.3},
        "bodies": [{"name": name, "material": "soil", "velocity": [speed if name == "block" else 0.0, 0.0],
                    "shape": {"type": "box", "lower": low, "upper": high}} for name, (low, high) in boxes.items()],
        "boundaries": {"ground": {"where": {"body": "base", "upper": [None, 0.05]}, "fix": ["x", "y"]}},
        "contacts": [{"type": "bodies", "first": "block", "second": "base", "friction": friction, "damping": damping}],
        "stages": [{"name": "slide", "type": "dynamics", "duration": 1.0, "boundaries": ["ground"]}],
    }  # fmt: skip


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_block_slides_on_a_deformable_base(friction):
    speed = 1.0
    sim = started(sled(friction, speed))
    start = sim.particles.position[sim.particles.body == 1].mean(axis=0)
    energies = go(sim, 0.3)
    mass, velocity, _ = motion_of(sim, 1)
    moved = sim.particles.position[sim.particles.body == 1].mean(axis=0) - start
    assert abs(energies["energy_residual"] - energies["integration_term"]) < 1e-12 * 30
    if friction == 0.0:
        resistance = (speed**2 - velocity[0] ** 2) / (2 * 9.81 * moved[0])
        assert 0.0 <= resistance < 0.005  # of the normal force: the interface is smooth over twelve spacings
    else:
        assert moved[0] == pytest.approx(speed**2 / (2 * 0.5 * 9.81), rel=0.05)  # 0.102 m, four spacings
        assert abs(velocity[0]) < 0.02
        assert energies["friction_dissipation"] == pytest.approx(0.5 * mass * speed**2, rel=0.05)


def incline(degrees, friction, settled=0.05):
    """A block on a slope, both of points on lattices along the axes, whose surfaces are steps."""
    down = np.array([np.cos(np.radians(degrees)), -np.sin(np.radians(degrees))])
    out = np.array([-down[1], down[0]])
    ground = [-1.0 * down, 1.0 * down, 1.0 * down - 0.12 * out, -1.0 * down - 0.12 * out]
    block = [-0.15 * down, 0.15 * down, 0.15 * down + 0.1 * out, -0.15 * down + 0.1 * out]
    shapes = [{"type": "polygon", "vertices": [c.tolist() for c in corners]} for corners in (ground, block)]
    scene = scene_of(shapes, friction=friction, gravity=[0.0, -9.81],
                     boundaries={"fast": {"where": {"body": "a"}, "fix": ["x", "y"]}})  # fmt: skip
    scene["contacts"][0]["damping"] = 0.3
    scene["stages"][0]["boundaries"] = ["fast"]
    return scene, down


def test_a_block_on_an_incline_of_lattice_points():
    scene, down = incline(25.0, 0.2)
    sim = started(scene)
    go(sim, 0.1)
    _, first, _ = motion_of(sim, 1)
    go(sim, 0.3)
    _, second, _ = motion_of(sim, 1)
    coulomb = 9.81 * (np.sin(np.radians(25.0)) - 0.2 * np.cos(np.radians(25.0)))
    assert (second - first) @ down / 0.2 == pytest.approx(coulomb, rel=0.03)


def test_a_block_on_an_incline_sticks_below_the_angle_of_friction():
    scene, down = incline(15.0, 0.35)
    sim = started(scene)
    p = sim.particles
    go(sim, 0.1)
    before = p.position[p.body == 1].mean(axis=0)
    go(sim, 0.3)
    assert abs((p.position[p.body == 1].mean(axis=0) - before) @ down) < 1e-3 * H


def test_the_step_is_at_most_a_tenth_shorter():
    block = box([0, 0], [0.2, 0.2])
    alone = started(scene_of([block], contacts=[]))
    both = started(scene_of([block, box([0, 0.2], [0.2, 0.4])], friction=0.5))
    assert 0.95 * alone.dt < both.dt <= alone.dt * (1.0 + 1e-3)


def test_bodies_that_overlap_are_refused_whatever_the_stage():
    overlapping = [box([0, 0], [0.2, 0.1]), box([0.05, 0.09], [0.15, 0.19])]
    with pytest.raises(InputError, match=r"'a' and 'b' overlap by 0\.01 m at \(0\.\d+, 0\.\d+\)"):
        started(scene_of(overlapping))
    scene = scene_of(overlapping)
    scene["contacts"][0]["stages"] = ["later"]
    scene["stages"].append({"name": "later", "type": "dynamics", "duration": 1.0})
    with pytest.raises(InputError, match="overlap by 0.01 m"):
        started(scene)


def test_a_contact_that_appears_presses_from_there_on_or_is_refused():
    sim = started(scene_of([box([0, 0], [0.1, 0.1]), box([0, 0.12], [0.1, 0.22])]))
    p, contact = sim.particles, contact_of(sim)
    p.position[p.body == 1, 1] -= 0.03  # passed through each other while there was no contact
    rebuild(sim)
    sim.evaluate_forces()
    assert p.contact_force.any()
    contact.appear(p, 0.0, [])
    sim.apply_loads(0.0)
    assert np.abs(p.contact_force).max() < 1e-9 * SOFT["bulk_modulus"] * H
    p.position[p.body == 1, 1] -= 0.6 * H
    rebuild(sim)
    with pytest.raises(ContactError, match="more than half a spacing"):
        contact.appear(p, 0.0, [])
    contact.appear(p, 0.0, [contact])  # it was there before


def test_cells_that_are_squeezed_or_come_loose_give_what_they_bear():
    """What they take from the stress, and the force that leads to where they bear less, are slopes of one energy."""
    sim = started(scene_of([box([0, 0], [0.2, 0.1]), box([0.053, 0.1], [0.153, 0.2])]))
    p, contact = sim.particles, contact_of(sim)
    upper = p.body == 1
    p.share[:, 2] = np.where(upper, 0.3, 5.0 * p.position[:, 0])  # integrity times volume over what it was
    p.position[upper, 1] -= 0.05 * H
    aside, along = SOFT["bulk_modulus"] + np.array([-2.0, 4.0]) / 3.0 * SOFT["shear_modulus"]

    def loads(shift, strain):
        """Force on the upper body along the face, and what takes part of the strain across it."""
        contact._find_stress = lambda p: np.copyto(p.face_stress, strain * np.array([aside, along, aside, 0.0]))
        p.position[upper, 0] += shift
        sim.forces.clear()
        contact.add_force(p, 0.0, 0.0)
        p.position[upper, 0] -= shift
        return p.contact_force[upper, 0].sum(), p.internal_moment[:, 3].sum()

    strain, shift = -0.01, 1e-3 * H
    force = loads(0.0, strain)[0] - loads(0.0, 0.0)[0]
    moment = loads(shift, strain)[1] - loads(-shift, strain)[1]
    assert abs(moment) > 1e-6 * abs(loads(0.0, strain)[1])
    assert 2.0 * force / strain == pytest.approx(moment / (2.0 * shift), rel=1e-3)
    whole = loads(0.0, strain)[1]
    p.share[:, 2] *= 0.5
    assert loads(0.0, strain)[1] == pytest.approx(0.5 * whole)


@pytest.mark.parametrize("degrees", [75.0, 81.0, 85.0])
def test_faces_that_turn_towards_each_other_do_the_work_of_their_energy(degrees):
    """The force along them grows with their angle as their moment does with the way along: no pair comes at once."""
    sim = started(scene_of([box([0, 0], [0.2, 0.1]), box([0.053, 0.1], [0.153, 0.2])]))
    p, contact = sim.particles, contact_of(sim)
    upper = p.body == 1
    p.position[upper, 1] -= 0.05 * H
    kept = p.position.copy()

    def loads(shift, turned):
        angle = np.radians(degrees) + turned
        p.position[upper, 0] = kept[upper, 0] + shift
        p.face[upper, 2:] = 0.0
        p.face[upper, 2:4] = [np.sin(angle), -np.cos(angle)]
        sim.forces.clear()
        contact.add_force(p, 0.0, 0.0)
        return p.contact_force[upper, 0].sum(), (p.contact_moment[upper, 2] - p.contact_moment[upper, 1]).sum()

    shift, turned = 1e-4 * H, 1e-4
    force = (loads(0.0, turned)[0] - loads(0.0, -turned)[0]) / turned
    moment = (loads(shift, 0.0)[1] - loads(-shift, 0.0)[1]) / shift
    assert abs(force) > 1e-3 * SOFT["bulk_modulus"] * H**2
    assert force == pytest.approx(moment, rel=1e-3)


def test_torn_bodies_get_new_faces():
    """What was inside comes to light where a body has lost its upper half."""
    sim = started(scene_of([box([0, 0], [0.2, 0.2]), box([0, 0.3], [0.2, 0.4])]))
    p = sim.particles
    p.position[(p.body == 0) & (p.position[:, 1] > 0.1), 1] += 1.0
    p.position[p.body == 1, 1] -= 0.2
    sim.dt = 0.0
    rebuild(sim)
    sim.evaluate_forces()
    assert np.abs(p.contact_force).max() < 1e-9 * SOFT["bulk_modulus"] * H
    surface = (p.body == 0) & (np.abs(p.position[:, 1] - 0.1 + 0.5 * H) < 0.1 * H)
    middle = surface & (np.abs(p.position[:, 0] - 0.1) < 0.05)
    assert p.face[middle, 2:4] == pytest.approx(np.tile([0.0, 1.0], (middle.sum(), 1)), abs=1e-6)
    assert p.face[middle, 1] == pytest.approx(0.5 * H)


def test_a_grain_in_a_cleft_of_a_torn_body_is_not_pushed_by_new_faces():
    """It lies deep behind what the corners of the cleft would get for a face, so that no depth would keep these apart.
    """
    sim = started(scene_of([box([0, 0], [0.2, 0.2]), box([0, 0.3], [0.2, 0.5])]))
    p = sim.particles
    x, y = (p.position / H).T
    p.position[(p.body == 0) & ((y > 4.0) | (abs(x - 4.5) < 0.1) & (y > 2.0)), 1] += 1.0
    grain = np.flatnonzero((p.body == 1) & (abs(x - 4.5) < 0.1) & (abs(y - 16.5) < 0.1))
    p.position[grain] = [4.5 * H, 2.5 * H]
    sim.dt = 0.0
    rebuild(sim)
    sim.evaluate_forces()
    assert len(grain) == 1 and (p.face[:, 1] > 0.0).all()
    assert np.abs(p.contact_force).max() < 1e-9 * SOFT["bulk_modulus"] * H
    assert (p.face[:, 1] < 0.49 * H).sum() == 2  # of the walls, which have drawn back from it


def test_a_grain_inside_another_body_ends_the_run():
    """Between the points of a lattice; in a slot that it just fills it may lie, squeezed by a fifth."""
    for place, inside in (([0.1, 0.1], True), ([0.5 * H, 0.5 * H], False), ([0.1, 0.2 + 0.3 * H], False)):
        sim = started(scene_of([box([0, 0], [0.2, 0.2]), box([0, 0.3], [0.2, 0.4])]))
        p = sim.particles
        grain = np.flatnonzero(p.body == 1)[0]
        p.position[grain] = place
        for _ in range(2):
            rebuild(sim)
            sim.evaluate_forces()
        if inside:
            with pytest.raises(ContactError, match=r"body 'a': a point at \(0.1, 0.1\), inside of it, has passed its"):
                rebuild(sim)
        else:
            rebuild(sim)
    sim = started(scene_of([box([0, 0], [0.2, 0.2]), box([0, 0.3], [0.2, 0.4])]))
    p = sim.particles
    x, y = (p.position / H).T
    slot = (p.body == 0) & (abs(x - 3.5) < 0.1) & (y > 4.0)
    grains = np.flatnonzero((p.body == 1) & (y < 12.6))[: slot.sum()]
    p.position[grains], p.position[slot] = p.position[slot], p.position[grains] + [0.0, 0.5]
    p.position[(p.body == 0) & (abs(x - 2.5) < 0.1), 0] += 0.2 * H
    for _ in range(2):
        rebuild(sim)
        sim.evaluate_forces()
    assert contact_of(sim).breach is None


def test_nothing_is_done_while_nothing_is_near():
    scene = sled(0.5, 0.0)
    scene["bodies"][1]["shape"] = {"type": "box", "lower": [0.1, 0.25], "upper": [0.4, 0.35]}
    sim = started(scene)
    contact = contact_of(sim)
    for _ in range(3):
        sim.step()
    assert contact.pairs.size == 0 and not contact._present
    assert not sim.particles.contact_force.any() and not sim.particles.contact_moment.any()


def test_bodies_in_contact_do_not_bond_and_others_do():
    scene = sled(0.5, 0.0)
    sim = started(scene)
    pairs, body = sim.bonds.pairs, sim.particles.body
    assert (body[pairs.first] == body[pairs.second]).all()
    scene["contacts"] = []
    sim = started(scene)
    pairs, body = sim.bonds.pairs, sim.particles.body
    assert (body[pairs.first] != body[pairs.second]).any()


def test_bodies_that_would_pass_through_each_other_are_refused():
    scene = sled(0.5, 0.0)
    scene["bodies"].append({"name": "stone", "material": "soil",
                            "shape": {"type": "box", "lower": [0.6, 0.1], "upper": [0.7, 0.2]}})  # fmt: skip
    with pytest.raises(InputError, match=re.escape("'base' and 'stone' would pass through each other")):
        started(scene)
    scene["contacts"].append({"type": "bodies", "between": "all", "friction": 0.1})
    contact = contact_of(started(scene))
    assert contact.friction.tolist() == [[0.0, 0.5, 0.1], [0.5, 0.0, 0.1], [0.1, 0.1, 0.0]]
