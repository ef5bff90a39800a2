"""Stages that dig and build: points go with their stress and energy, come without, and the ledger closes."""

import numpy as np
import pytest

from periporo import Simulation
from periporo.errors import ContactError, InputError

SOIL = {"model": "elastic", "density": 2000.0, "bulk_modulus": 40e6, "shear_modulus": 20e6}


def scene(stages):
    """Two boxes on each other, 6 points wide and 4 high each; the upper one may be dug away, a third one placed."""
    def box(x, y):
        return {"type": "box", "lower": [x[0], y[0]], "upper": [x[1], y[1]]}

    shapes = {"ground": box((0, 6), (0, 4)), "hill": box((0, 6), (4, 8)), "fill": box((0, 3), (4, 6))}
    if not any(stage.get("place") for stage in stages):
        del shapes["fill"]
    return {
        "dimension": 2, "spacing": 1.0, "gravity": [0, -10.0], "materials": {"soil": SOIL},
        "bodies": [{"name": name, "material": "soil", "shape": shape} for name, shape in shapes.items()],
        "initial_stress": {"type": "geostatic", "K0": 0.5},
        "boundaries": {"base": {"where": {"upper": [None, 1]}, "fix": ["y"]},
                       "sides": {"where": {"body": "ground"}, "fix": ["x"]},
                       "above": {"where": {"lower": [None, 4]}, "fix": ["x"]}},
        "stages": stages,
    }  # fmt: skip


HELD = ["base", "sides", "above"]
SETTLE = {"name": "settle", "type": "relax", "tolerance": 1e-6, "boundaries": HELD}
DIG = SETTLE | {"name": "dig", "remove": [{"body": "hill"}]}
FILL = SETTLE | {"name": "fill", "place": ["fill"]}


def vertical_stress(sim):
    """Mean of the rows of each height."""
    (block,) = sim.bonds.blocks
    p = sim.particles
    assert len(block.stress) == p.owned
    rows = np.floor(p.initial_position[:, 1])
    return {int(r): block.stress[rows == r, 1].mean() for r in np.unique(rows)}


def test_what_is_dug_away_unloads_what_lay_below():
    sim = Simulation.from_scene(scene([SETTLE, DIG]))
    sim.start()
    assert sim.particles.owned == 48  # the fill is not there
    before = vertical_stress(sim)
    assert before[0] == pytest.approx(-2000 * 10 * 7.5, rel=0.05)
    work = sim.ledger.entries()["external_work"]
    sim.run()
    p = sim.particles
    assert p.owned == 24 and p.position[:, 1].max() < 4.0 and sim.departures.count == 24
    after = vertical_stress(sim)
    assert after[1] == pytest.approx(-2000 * 10 * 2.5, rel=0.25)  # few rows above a base that is held
    assert np.abs(p.position - p.initial_position)[:, 1].max() > 1e-3  # it has risen
    entries = sim.ledger.entries()
    assert entries["external_work"] != work
    assert abs(entries["energy_residual"] - entries["integration_term"]) < 1e-9 * abs(entries["external_work"])


def test_what_is_placed_comes_without_stress_and_loads_what_lies_below():
    sim = Simulation.from_scene(scene([SETTLE, DIG, FILL]))
    sim.run()
    p = sim.particles
    assert p.owned == 30 and np.array_equal(p.id, np.sort(p.id)) and (p.body == 2).sum() == 6
    (block,) = sim.bonds.blocks
    row, left = np.floor(p.initial_position[:, 1]) == 1, p.initial_position[:, 0] < 3.0
    weight = 2000 * 10 * (2.5 + 1.0)  # of the ground above, and of the fill over twice its width
    assert block.stress[row, 1].mean() == pytest.approx(-weight, rel=0.25)  # few rows above a base that is held
    assert block.stress[row & left, 1].mean() < 1.3 * block.stress[row & ~left, 1].mean()
    entries = sim.ledger.entries()
    assert abs(entries["energy_residual"] - entries["integration_term"]) < 1e-9 * abs(entries["external_work"])


def test_a_stage_that_removes_what_is_not_there_is_refused():
    for region in ({"lower": [20, 0], "upper": [30, 9]}, {"body": "fill"}):
        with pytest.raises(InputError, match=r"stages\[0\].remove\[0\]: there is no point in it at this stage"):
            Simulation.from_scene(scene([SETTLE | {"remove": [region]}, DIG, FILL]))
    with pytest.raises(InputError, match=r"stages\[2\].remove\[0\]: there is no point"):
        Simulation.from_scene(scene([SETTLE, DIG, DIG | {"name": "again"}]))
    with pytest.raises(InputError, match=r"'fill' has been placed before"):
        Simulation.from_scene(scene([SETTLE, DIG, FILL, FILL | {"name": "again"}]))


def test_what_would_be_placed_into_soil_is_refused_with_the_place():
    sim = Simulation.from_scene(scene([SETTLE, FILL]))
    with pytest.raises(ContactError, match=r"fill cannot be placed: points would be .* m apart at \("):
        sim.run()
