"""Quasi-static stages: equilibrium at physical times, what they keep, where they end, what they refuse."""

import numpy as np
import pytest

from periporo.core.bonds.bonds import RefusedStep
from periporo.core.watch.watchdog import Watchdog, WatchdogError
from periporo.core.water.flow import flowing_water
from periporo.errors import InputError
from periporo.io.input.load import parse_scene

SAND = {"model": "elastic", "density": 1590.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
SILT = {"model": "drucker_prager", "density": 1500.0, "bulk_modulus": 2e6, "shear_modulus": 1e6, "cohesion": 20.0,
        "friction_angle": 30.0}  # fmt: skip
WATER = {"suction": 0, "drainage": "flowing", "porosity": 0.4, "conductivity": 1e-6}
SIDES = {"base": {"where": {"upper": [None, 0.01]}, "fix": ["x", "y"]},
         "sides": {"where": {"body": "block"}, "fix": ["x"]}}  # fmt: skip


def waiting(scene_of, boundaries, water=WATER, *, duration=1000.0, law=SAND, counts=(4, 20), after=(), **keys):
    """A scene of a block that waits while its water flows."""
    stage = {"name": "wait", "type": "quasi_static", "duration": duration, "boundaries": list(boundaries)}
    return scene_of(counts=counts, materials=law, contacts=[], pore_water=water, boundaries=boundaries,
                    stages=[stage, *after], **keys)  # fmt: skip


def test_a_load_is_borne_by_the_water_first_and_by_the_soil_at_last(scene_of, started):
    """At once p = q; after long times p is hydrostatic and the soil is compressed as Hooke says; energy is known.

    Half of the work of the load has gone by flow.
    """
    load = 1e4
    boundaries = SIDES | {
        "load": {"where": {"lower": [None, 0.19]}, "traction": {"stress": [0.0, -load], "side": "y+"}},
        "drain": {"where": {"lower": [None, 0.19]}, "water": {"head": 0.2, "side": "y+"}},
    }
    water = {k: v for k, v in WATER.items() if k != "suction"} | {"water_table": 0.2}
    sim = started(waiting(scene_of, boundaries, water, initial_stress={"type": "geostatic", "K0": 0.5}))
    found, increments = [], flowing_water(sim).increments
    increments.accept, accept = (lambda: (found.append(sim.particles.pore_pressure.copy()), accept())[1],
                                 increments.accept)  # fmt: skip
    y = sim.particles.initial_position[:, 1].copy()
    sim.run()
    p, inner, still = sim.particles, (y > 0.03) & (y < 0.17), 9810.0 * (0.2 - y)
    assert (found[0] - still)[inner] == pytest.approx(np.full(inner.sum(), load), rel=0.03)
    assert np.abs(p.pore_pressure - still).max() < 0.01 * load and sim.time == pytest.approx(1000.0)
    down = (p.initial_position - p.position)[:, 1]
    strain = np.polyfit(y[inner], down[inner], 1)[0]
    assert strain == pytest.approx(load / (25e6 + 4.0 / 3.0 * 15e6), rel=0.01)
    sums, entries = flowing_water(sim).histories(), sim.ledger.entries()
    assert sums["water_outflow"] == pytest.approx(down.max() * 0.04, rel=0.06)
    assert abs(sums["water_balance"]) < 1e-13 * sums["water_stored"]
    half = 0.5 * load * sums["water_outflow"]  # of the work of the load; what the soil stores is the other
    assert sums["flow_dissipation"] == pytest.approx(half, rel=0.03)
    error = entries["energy_residual"] - entries["integration_term"]
    assert abs(error) < 1e-9 * entries["external_work"]


def test_what_is_in_equilibrium_stays(scene_of, started):
    """Water at rest in soil at rest: one increment after the other does nothing, and so they grow."""
    water = {k: v for k, v in WATER.items() if k != "suction"} | {"water_table": 0.2}
    boundaries = SIDES | {"drain": {"where": {"lower": [None, 0.19]}, "water": {"head": 0.2, "side": "y+"}}}
    settle = {"name": "settle", "type": "relax", "tolerance": 1e-6, "boundaries": list(SIDES)}
    scene = waiting(scene_of, boundaries, water, initial_stress={"type": "geostatic", "K0": 0.5})
    scene["stages"].insert(0, settle)
    sim = started(scene)
    sim.stages[0].run(sim)
    p = sim.particles
    place, pressure = p.position.copy(), p.pore_pressure.copy()
    sim.stage_number = 1
    sim.stages[1].run(sim)
    assert np.abs(p.position - place).max() < 1e-9 and np.abs(p.pore_pressure - pressure).max() < 1.0
    assert sim.stages[1].increments < 40 and not sim.stages[1].lost


def test_where_equilibrium_is_lost_the_next_stage_goes_on(scene_of, started):
    """A wall of silt that suction holds falls once rain has wetted it; motion begins at that time.

    Increments after which it does not stand are begun again, shorter, until the time is known to a thousandth.
    """
    water = WATER | {"suction": 5e3, "conductivity": 1e-4, "bulk_modulus": 1e7,
                     "retention": {"van_genuchten": {"alpha": 0.3, "n": 2.0}}}  # fmt: skip
    boundaries = {"base": SIDES["base"], "rain": {"where": {"body": "block"}, "water": {"rain": 5e-5, "side": "y+"}}}
    fall = {"name": "fall", "type": "dynamics", "duration": 0.1, "boundaries": ["base", "rain"]}
    scene = waiting(scene_of, boundaries, water, duration=1e5, law=SILT, counts=(8, 16), after=[fall],
                    initial_stress={"type": "geostatic", "K0": 0.5})  # fmt: skip
    scene["stages"][0] |= {"accuracy": 0.1, "tolerance": 2e-2, "max_steps": 1000}
    sim = started(scene)
    sim.stages[0].run(sim)
    lost, sums = sim.time, flowing_water(sim).histories()
    assert sim.stages[0].repeated > 1 and sim.stages[0].length < 1.01e-3 * lost
    assert sim.stages[0].lost and 60.0 < lost < 1e5
    assert abs(sums["water_balance"]) < 1e-12 * sums["water_stored"] and sums["water_inflow"] > 0.0
    sim.stage_number = 1
    sim.stages[1].run(sim)
    assert sim.time == pytest.approx(lost + 0.1, rel=1e-3)
    assert sim.particles.velocity[:, 1].min() < -0.01  # it was at rest


def test_what_is_no_number_ends_the_run_and_not_the_stage(scene_of, started, tmp_path):
    """Neither forces nor pressures: the next stage would go on from there. The watchdog tries it again first."""
    fall = {"name": "fall", "type": "dynamics", "duration": 0.1}
    for spoil in (lambda sim: sim.bonds.blocks[0].stress[3:4], lambda sim: sim.particles.pore_pressure[7:8]):
        sim = started(waiting(scene_of, SIDES, after=[fall]))
        spoil(sim)[:] = np.nan
        with pytest.raises(RefusedStep, match="stage 'wait': (forces|pressures) of points are no numbers any more"):
            sim.run()
        assert sim.stage_number == 0
    said = []
    sim.guards = [Watchdog(0.01, ["soil"], tmp_path / "run.diagnostic.csv", message=said.append)]
    with pytest.raises(WatchdogError, match=r"point \d+ at \(.*\) m, material 'soil', is not a number"):
        sim.run()
    assert len(said) == 3 and (tmp_path / "run.diagnostic.csv").exists()


def test_what_it_needs_is_said(scene_of):
    scene = waiting(scene_of, SIDES)
    with pytest.raises(InputError, match="goes by the time in which water flows; give pore_water with"):
        parse_scene(scene | {"pore_water": WATER | {"drainage": "undrained"}}, ".")
    with pytest.raises(InputError, match="moves, for which a quasi_static stage has no time"):
        pushed = SIDES | {"sides": {"where": {"body": "block"}, "velocity": {"x": 1e-3}}}
        parse_scene(scene | {"boundaries": pushed}, ".")
