"""What water stores and flow takes: against the work of pressure, of pores squeezed, dried, or flowed through."""

import numpy as np
import pytest

from periporo.core.water.content import fill_content, fill_pressure, stored_energy
from periporo.core.water.flow import flowing_water
from periporo.core.water.retention import Retention, exponential, packed, tabulated, van_genuchten

PORES, BULK = 0.4, 2e7
SAND = {"model": "elastic", "density": 1590.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
ONE, START, POROSITY = np.ones(1), np.zeros(1, np.int64), np.array([PORES])
GAMMA, SPEED = 9810.0, 1e-3


def known(curves, ratio):
    return 1, START, POROSITY, ONE, np.array([ratio]), BULK, curves


def test_what_a_squeeze_stores():
    """Full pores squeezed by a tenth of their volume: minus the integral of p dV."""
    curves, content = packed([Retention(0)]), np.empty(1)
    s, p = np.empty(1), np.zeros(1)
    fill_content(*known(curves, 1.0), p, s, content)
    ratios, pressures = np.linspace(1.0, 1.0 - 0.1 * PORES, 2001), []
    for ratio in ratios:
        fill_pressure(*known(curves, ratio), content, s, p)
        pressures.append(p[0])
    energy = stored_energy(START, POROSITY, BULK, curves, p, np.array([ratios[-1]]), ONE)[0]
    assert energy == pytest.approx(-np.trapezoid(pressures, ratios), rel=1e-3) and energy > 1e4


@pytest.mark.parametrize("curve", [van_genuchten(0.2, 2.0, 0.1), exponential(0.1, 0.0), tabulated([0, 3e4], [1, 0.3])])
def test_what_drying_stores(curve):
    """Rigid pores that are dried: the integral of p over the water that has left."""
    curves, suctions = packed([curve]), np.linspace(0.0, 2e4, 2001)
    contents = []
    for suction in suctions:
        content, s = np.empty(1), np.empty(1)
        fill_content(*known(curves, 1.0), np.array([-suction]), s, content)
        contents.append(content[0])
    energy = stored_energy(START, POROSITY, BULK, curves, np.array([-2e4]), ONE, ONE)[0]
    assert energy == pytest.approx(-np.trapezoid(suctions, contents), rel=2e-3)


def test_steady_flow_takes_what_its_heads_give(scene_of, started):
    """Water that falls from one head to another gives rho g Q dh, in pairs and half cells; none is lost or stored."""
    def row(level):
        return {"lower": [None, level - 0.005], "upper": [None, level + 0.005]}

    boundaries = {"still": {"where": {"body": "block"}, "fix": ["x", "y"]},
                  "top": {"where": row(0.095), "water": {"head": 0.5, "side": "y+"}},
                  "base": {"where": row(0.005), "water": {"head": 0.1, "side": "y-"}}}  # fmt: skip
    stage = {"name": "flow", "type": "dynamics", "duration": 0.1, "boundaries": list(boundaries)}
    water = {"suction": 0, "drainage": "flowing", "porosity": PORES, "bulk_modulus": 1e6, "conductivity": SPEED}
    sim = started(scene_of(counts=(3, 10), materials=SAND, contacts=[], pore_water=water, boundaries=boundaries,
                           stages=[stage], time_step={"fixed": 2e-3}))  # fmt: skip
    sim.run()
    process = flowing_water(sim)
    before = process.histories()
    for _ in range(10):
        sim.step()
    after = process.histories()
    passed = after["water_inflow"] - before["water_inflow"]
    taken = after["flow_dissipation"] - before["flow_dissipation"]
    assert passed > 0.0 and taken == pytest.approx(GAMMA * passed * 0.4, rel=1e-3)
    assert after["water_energy"] == pytest.approx(before["water_energy"], rel=1e-3)


def ringing(scene_of, started, step, steps, **water):
    """A free square of full pores after `steps` from a start at which it is squeezed evenly."""
    pores = {"suction": 0, "drainage": "undrained", "porosity": PORES, "bulk_modulus": BULK, "report_work": True}
    sim = started(scene_of(counts=(8, 8), materials=SAND, contacts=[], gravity=None, pore_water=pores | water,
                           time_step={"fixed": step}))  # fmt: skip
    p = sim.particles
    p.velocity[:] = (p.position - p.position.mean(axis=0)) * [-60.0, -30.0]
    for _ in range(steps):
        sim.step()
    return sim


def test_work_on_shut_in_water_is_what_it_stores(scene_of, started):
    """But for the volume of rows, which is that of gradients that are not sharpened; to second order in the step."""
    work = []
    for step, steps in ((4e-6, 20), (2e-6, 40), (1e-6, 80)):
        sim = ringing(scene_of, started, step, steps)
        process = next(part for part in sim.point_processes if hasattr(part, "energies"))
        stored = process.histories()["water_energy"]
        work.append(sim.ledger.entries()["water_work"])
        assert work[-1] == pytest.approx(stored, rel=2e-3) and stored > 0.01
    coarse, middle, fine = work
    assert abs((coarse - middle) / (middle - fine)) == pytest.approx(4.0, rel=0.3)


def test_work_on_water_and_soil_is_the_internal_work(scene_of, started):
    """Under a constant suction: the stress of elastic soil tells what it stores, and the links hold little."""
    sim = ringing(scene_of, started, 1e-6, 60, drainage="drained", suction=5e4)
    p, entries, (block,) = sim.particles, sim.ledger.entries(), sim.bonds.blocks
    mean = block.stress[:, :3].mean(axis=1)
    deviator = block.stress[:, :3] - mean[:, None]
    shear = (deviator**2).sum(axis=1) + 2.0 * block.stress[:, 3] ** 2
    stored = ((0.5 * mean**2 / 25e6 + 0.25 * shear / 15e6) * p.volume[: p.owned] * p.share[: p.owned, 2]).sum()
    assert entries["internal_energy"] - entries["water_work"] == pytest.approx(stored, rel=0.02)
    assert abs(entries["water_work"]) > 0.2 * stored
    assert "water_work" not in started(scene_of()).ledger.entries()
