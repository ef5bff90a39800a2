"""Axial symmetry: rings, their hoop strain and stress, and what is known of cylinders."""

import numpy as np
import pytest

from periporo.core.numerics.tensors import to_matrix
from periporo.core.points import fields
from periporo.errors import InputError
from periporo.io.input.load import parse_scene

BULK, SHEAR, DENSITY = 25e6, 15e6, 1800.0
ELASTIC = {"model": "elastic", "density": DENSITY, "bulk_modulus": BULK, "shear_modulus": SHEAR}
AXIS = {"type": "plane", "point": [0, 0], "normal": [1, 0], "friction": 0}
SCHEMES = ("standard", "point_state", {"scheme": "point_state", "sharpened": True, "regular": True})


def rings(inner=0.0, outer=1.0, height=1.0, spacing=0.1, **keys):
    """The scene of a hollow cylinder."""
    return {
        "dimension": 2, "axisymmetric": True, "spacing": spacing, "materials": {"soil": ELASTIC}, "contacts": [AXIS],
        "bodies": [{"name": "ring", "material": "soil",
                    "shape": {"type": "box", "lower": [inner, 0], "upper": [outer, height]}}],
        "stages": [{"name": "go", "type": "dynamics", "duration": 1e-3}],
    } | keys  # fmt: skip


def pressed(pressure):
    """Uniform stress at the start."""
    return {"type": "uniform", "components": dict.fromkeys(("xx", "yy", "zz"), -pressure)}


def test_volumes_and_masses_are_those_of_rings(started):
    p = started(rings(inner=0.5, height=2.0)).particles
    assert p.volume.sum() == pytest.approx(np.pi * (1.0 - 0.25) * 2.0, rel=1e-12)
    assert p.mass.sum() == pytest.approx(DENSITY * np.pi * (1.0 - 0.25) * 2.0, rel=1e-12)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_force_does_the_work_of_all_stresses(started, scheme):
    sim = started(rings(correspondence=scheme))
    p, dt, rng = sim.particles, 1e-20, np.random.default_rng(3)
    p.velocity[:] = rng.normal(size=p.velocity.shape)
    sim.scheme.deform(p, sim.bonds, sim.halo, dt, np.inf)
    (block,) = sim.bonds.blocks
    block.stress[:] = 1e4 * rng.normal(size=block.stress.shape)
    stress, strain = to_matrix(block.stress), to_matrix(block.strain_increment) / dt
    assert strain[:, 2, 2] == pytest.approx(p.velocity[:, 0] / p.position[:, 0], rel=1e-12)
    force = np.zeros_like(p.position)
    sim.scheme.internal_force(p, sim.bonds, sim.halo, force)
    power = (p.volume * p.share[:, 2] * (stress * strain).sum(axis=(1, 2))).sum()
    assert -(force * p.velocity).sum() == pytest.approx(power, rel=1e-10)


def test_a_uniform_pressure_needs_no_force_inside_and_little_at_the_axis(started):
    sim = started(rings(height=2.0, initial_stress=pressed(1e3)))
    p = sim.particles
    row = np.abs(p.position[:, 1] - 1.05) < 0.01
    residual = (p.internal_force[row, 0] / (p.volume[row] * 1e3 / 0.1))[np.argsort(p.position[row, 0])]
    assert np.abs(residual[:2]).max() < 0.1  # with neighbours on one side alone
    assert np.abs(residual[2:7]).max() < 0.01
    assert p.internal_force[row, 1] == pytest.approx(0.0, abs=1e-9 * (p.volume * 1e4).max())


def test_volume_follows_a_ring_that_grows(started):
    grow = {"all": {"where": {"lower": [-1, -1]}, "velocity": {"x": 10.0, "y": 0.0}}}
    stage = {"name": "grow", "type": "dynamics", "duration": 0.01, "boundaries": ["all"]}
    sim = started(rings(inner=1.0, outer=1.5, height=0.5, spacing=0.05, boundaries=grow, stages=[stage]))
    p, start = sim.particles, sim.particles.position[:, 0].copy()
    sim.run()
    assert p.dilation == pytest.approx(p.position[:, 0] / start, rel=1e-9)  # in the plane nothing is strained
    (block,) = sim.bonds.blocks
    strain = np.log(p.position[:, 0] / start)
    assert block.stress[:, 2] == pytest.approx((BULK + 4 / 3 * SHEAR) * strain, rel=1e-6)


@pytest.mark.parametrize("inner, outer, inside, outside", [(1.0, 2.0, 1e3, 0.0), (0.0, 1.0, 0.0, 1e3)])
def test_thick_and_solid_cylinders_under_pressure(started, inner, outer, inside, outside):
    """Lame's solution (Timoshenko & Goodier 1970, article 28), in plane strain along the axis."""
    h = 0.1
    boundaries = {
        "flat": {"where": {"lower": [-1, -1]}, "fix": ["y"]},
        "in": {"where": {"upper": [inner + h, None]}, "traction": {"stress": [inside, 0], "side": "x-"}},
        "out": {"where": {"lower": [outer - h, None]}, "traction": {"stress": [-outside, 0], "side": "x+"}},
    }
    stage = {"name": "load", "type": "relax", "tolerance": 1e-6, "boundaries": ["flat", "in" if inside else "out"]}
    sim = started(rings(inner, outer, 0.8, h, boundaries=boundaries, stages=[stage]))
    sim.run()
    p = sim.particles
    middle = np.abs(p.initial_position[:, 1] - 0.45) < 0.01
    order = np.flatnonzero(middle)[np.argsort(p.initial_position[middle, 0])]
    r = p.initial_position[order, 0]
    area = outer**2 - inner**2
    a = (inside * inner**2 - outside * outer**2) / area
    b = (inside - outside) * inner**2 * outer**2 / area
    way = a * r / (2.0 * (BULK + SHEAR / 3.0)) + b / (2.0 * SHEAR * r)
    hoop = fields.values(sim, ("stress",))["stress"][order, 2]
    u = p.position[order, 0] - r
    assert u[2:] == pytest.approx(way[2:], rel=0.008)
    assert u[:2] == pytest.approx(way[:2], rel=0.05)
    assert hoop[2:] == pytest.approx((a + b / r**2)[2:], rel=0.01)


def test_energy_is_accounted_for_and_weight_reaches_the_floor(started):
    floor = {"type": "plane", "name": "floor", "point": [0, 0], "normal": [0, 1], "friction": 0.5, "damping": 0.3}
    stage = {"name": "settle", "type": "dynamics", "duration": 0.4, "damping": {"viscous": 60.0}}
    sim = started(rings(
        contacts=[AXIS, floor], gravity=[0, -9.81], initial_stress={"type": "geostatic", "K0": 0.6}, stages=[stage],
        spacing=0.125,
    ))  # fmt: skip
    sim.run()
    (told,) = sim.reactions
    assert told.histories(sim)["floor_force_y"] == pytest.approx(-np.pi * DENSITY * 9.81, rel=1e-3)
    entries = sim.ledger.entries()
    left = entries["energy_residual"] - entries["integration_term"]
    assert abs(left) < 1e-12 * max(abs(v) for v in entries.values())


@pytest.mark.parametrize("change, words", [
    ({"dimension": 3}, "needs dimension 2"),
    ({"gravity": [1.0, -9.81]}, "along the axis"),
    ({"contacts": []}, "need an axis"),
    ({"correspondence": "bond_projected"}, "rings need correspondence"),
    ({"sleep": {"speed": 1e-3}}, "remove 'sleep'"),
    ({"contacts": [AXIS, {"type": "disc", "center": [3, 3], "radius": 1, "friction": 0, "name": "a",
                          "free": {"density": 1e3}}]}, "none of these with rings"),
    ({"materials": {"soil": ELASTIC | {"model": "drucker_prager", "cohesion": 1e3, "friction_angle": 30.0}}},
     "not in plane strain"),
])  # fmt: skip
def test_what_rings_cannot_do_is_refused(change, words):
    scene = rings(**change)
    if scene["dimension"] == 3:
        scene["bodies"][0]["shape"] = {"type": "box", "lower": [0, 0, 0], "upper": [1, 1, 1]}
        scene["contacts"] = [AXIS | {"point": [0, 0, 0], "normal": [1, 0, 0]}]
    with pytest.raises(InputError, match=words):
        parse_scene(scene)


def test_a_body_beyond_the_axis_is_refused():
    with pytest.raises(InputError, match="rings have x > 0"):
        parse_scene(rings(inner=-0.5))
