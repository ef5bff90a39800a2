"""What can be written at the points."""

import numpy as np
import pytest

from periporo.core.points import fields


@pytest.fixture
def sim(scene_of, started, cam_clay_input):
    scene = scene_of(materials="two")
    scene["materials"]["top"] = cam_clay_input
    scene["initial_stress"] = {"type": "uniform", "components": {"xx": -2e3, "yy": -3e3, "zz": -1e3, "xy": 100.0}}
    return started(scene)


def test_every_available_field_has_its_declared_shape(sim):
    known = fields.available(sim)
    assert set(fields.DEFAULT) <= set(known)
    assert {s.name for s in sim.bonds.blocks[1].material.state_fields} <= set(known)
    values = fields.values(sim, tuple(known))
    for name, field in known.items():
        assert field.name == name
        assert values[name].shape == ((80,) if field.columns == 1 else (80, field.columns)), name


def test_values_of_plain_fields(sim):
    p = sim.particles
    p.position[:] += [0.001, -0.002]
    values = fields.values(sim, ("displacement", "density", "integrity", "material", "body"))
    assert values["displacement"] == pytest.approx(np.tile([0.001, -0.002], (80, 1)), rel=1e-12)
    assert values["density"] == pytest.approx(p.mass / p.volume) and set(values["material"]) == {0, 1}
    assert (values["integrity"] == 1.0).all() and not values["body"].any()


def test_stress_is_that_of_the_bonds_of_each_points_own_law(sim):
    stress = fields.values(sim, ("stress",))["stress"]
    assert stress == pytest.approx(np.tile([-2e3, -3e3, -1e3, 100.0], (80, 1)), rel=1e-9)
    top = sim.particles.material == 1
    sim.bonds.blocks[1].stress[:] = [1.0, 2.0, 3.0, 4.0]
    stress = fields.values(sim, ("stress",))["stress"]
    assert stress[top] == pytest.approx(np.tile([1.0, 2.0, 3.0, 4.0], (top.sum(), 1)))
    assert stress[~top] == pytest.approx(np.tile([-2e3, -3e3, -1e3, 100.0], ((~top).sum(), 1)), rel=1e-9)


def test_state_of_a_law_is_zero_where_another_law_rules(sim):
    name = sim.bonds.blocks[1].material.state_fields[0].name
    state = fields.values(sim, (name,))[name]
    top = sim.particles.material == 1
    assert state[top].all() and not state[~top].any()


@pytest.mark.parametrize("gradient, shear, volumetric", [
    ([[0, 1.0], [0, 0]], np.sqrt(2 / 3 * 0.5), 0.0),
    ([[1.0, 0], [0, -1.0]], np.sqrt(2 / 3 * 2.0), 0.0),
    ([[1.0, 0], [0, 1.0]], np.sqrt(2 / 3 * (2 - 4 / 3)), 2.0),
    ([[0, 1.0], [-1.0, 0]], 0.0, 0.0),
])  # fmt: skip
def test_strain_measures_of_simple_motions(sim, gradient, shear, volumetric):
    p = sim.particles
    measures = next(process for process in sim.point_processes if isinstance(process, fields.StrainMeasures))
    p.gradient[:] = np.ravel(gradient)
    p.equivalent_shear_strain[:], p.volumetric_strain[:] = 0.0, 0.0
    for _ in range(4):
        measures.update(p, sim.bonds, 0.25)
    assert p.equivalent_shear_strain == pytest.approx(np.full(80, shear), abs=1e-14)
    assert p.volumetric_strain == pytest.approx(np.full(80, volumetric), abs=1e-14)
