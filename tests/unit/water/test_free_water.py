"""Free water around a body: buoyancy, pressure that is everywhere the same exerts nothing, drawdown."""

import numpy as np
import pytest

SAND = {"model": "elastic", "density": 1590.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
GAMMA = 9810.0


def flooded(level, **keys):
    return {"water_table": 0.3, "porosity": 0.4, "free_water": {"level": level}} | keys


def out_of_balance(sim):
    return sim.particles.internal_force + sim.particles.external_force


def test_a_submerged_body_feels_its_buoyant_weight_alone(scene_of, started):
    """Force for force as a dry body of the buoyant density, at surfaces, too; also with jitter, in 3D."""
    for dimension, counts in ((2, (6, 5)), (3, (4, 4, 4))):
        scene = scene_of(dimension, counts, materials=SAND, contacts=[])
        scene["bodies"][0]["jitter"] = 0.1
        wet = started(scene | {"pore_water": flooded(0.3)})
        grains = (1590.0 + 400.0 - 1000.0) * wet.particles.volume * 9.81
        force = out_of_balance(wet)
        assert force[:, -1] == pytest.approx(-grains, rel=1e-5)
        assert np.abs(force[:, :-1]).max() < 1e-12 * grains.max()


def test_the_water_s_weight_is_part_of_the_geostatic_stress(scene_of, started):
    keys = {"materials": SAND, "contacts": [], "initial_stress": {"type": "geostatic", "K0": 0.5}}
    stress = started(scene_of(counts=(6, 8), **keys, pore_water=flooded(0.3))).bonds.blocks[0].stress
    buoyant = started(scene_of(counts=(6, 8), **keys | {"materials": SAND | {"density": 990.0}})).bonds.blocks[0].stress
    assert stress == pytest.approx(buoyant, rel=1e-9, abs=1e-6)


def test_a_cell_is_lifted_as_far_as_it_is_below_the_level(scene_of, started):
    """The lift grows with the level from nothing to the whole cell, and pressure is the mean over the cell."""
    lift, pressure = [], []
    for level in (0.05, 0.0525, 0.0575, 0.06, 0.07):
        scene = scene_of(counts=(6, 6), materials=SAND, contacts=[], pore_water=flooded(level, water_table=0.0))
        p = started(scene).particles
        top = p.position[:, 1] > 0.05
        lift.append((p.external_force + 9.81 * p.mass[:, None] * [0, 1])[top, 1].mean() / (GAMMA * 1e-4))
        pressure.append(p.pore_stress[top].mean() / (GAMMA * 0.01))
    assert lift == pytest.approx([0.0, 0.25, 0.75, 1.0, 1.0], abs=1e-9)
    assert pressure == pytest.approx([0.0, 0.25**2 / 2, 0.75**2 / 2, 0.5, 1.5], abs=1e-9)


def test_drawdown_leaves_the_pressure_behind(scene_of, started):
    """Water outside falls, undrained water inside stays: what held the pressure in the pores is gone."""
    level = {"times": [0.0, 1e-4], "values": [0.3, 0.2]}
    water = flooded(level, drainage="undrained")
    scene = scene_of(
        counts=(8, 8), materials=SAND, contacts=[], pore_water=water,
        boundaries={"all": {"where": {"body": "block"}, "fix": ["x", "y"]}},
        stages=[{"name": "fall", "type": "dynamics", "duration": 1e-4, "boundaries": ["all"]}],
    )  # fmt: skip
    sim = started(scene)
    assert np.abs(sim.particles.pore_stress).max() < 1e-6 * GAMMA
    sim.run()
    p = sim.particles
    assert p.pore_pressure == pytest.approx(GAMMA * (0.3 - p.position[:, 1]))
    assert p.pore_stress == pytest.approx(np.full(p.owned, -GAMMA * 0.1), rel=1e-2)
