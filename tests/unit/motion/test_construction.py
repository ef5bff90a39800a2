"""Stages that dig and build: points go with their stress and energy, come without, and the ledger closes."""

import numpy as np
import pytest

from periporo import Simulation
from periporo.core.points import fields
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


STIFF = SOIL | {"bulk_modulus": 400e6, "shear_modulus": 200e6, "density": 2500.0}


@pytest.mark.parametrize("scheme", ["point_state", "standard", "bond_projected"])
def test_points_that_change_their_material_keep_their_stress_and_answer_as_the_new_one(scheme):
    """The ground becomes stiffer, and the hill heavier: what is added settles by the new modulus."""
    both = {"soil": SOIL, "stiff": STIFF, "heavy": SOIL | {"density": 2500.0}}
    change = [{"body": "ground", "into": "stiff"}, {"lower": [None, 4], "into": "heavy"}]
    stages = [SETTLE, SETTLE | {"name": "treat", "change": change}]
    sim = Simulation.from_scene(scene(stages) | {"materials": both, "correspondence": scheme})
    sim.start()
    before = {}

    def look(sim):
        key = (sim.stage_number, sim.stages[sim.stage_number].relaxation.steps)
        before.setdefault(key, fields.values(sim, ("stress",))["stress"].copy())

    sim.call_every(1, look)
    sim.run()
    p = sim.particles
    ground = p.body == 0
    assert (p.material == np.where(ground, 1, 2)).all()
    assert p.mass == pytest.approx(np.full(p.owned, 2500.0))
    first = {number: next(s for (n, _), s in before.items() if n == number) for number in (0, 1)}
    rested = [s for (n, _), s in before.items() if n == 0][-1]
    assert first[1] == pytest.approx(rested, abs=0.04 * np.abs(rested).max())  # one step of the new stage
    stress = fields.values(sim, ("stress",))["stress"]
    middle = (np.floor(p.initial_position[:, 1]) == 2) & (np.abs(p.initial_position[:, 0] - 3.0) < 2.0)
    assert stress[middle, 1] / rested[middle, 1] == pytest.approx(np.full(middle.sum(), 1.25), rel=0.05)
    entries = sim.ledger.entries()
    assert abs(entries["energy_residual"] - entries["integration_term"]) < 1e-9 * abs(entries["external_work"])


def test_layers_are_dug_by_their_material():
    layered = scene([SETTLE, DIG | {"remove": [{"material": "clay"}]}])
    layered["materials"]["clay"] = SOIL
    layered["bodies"][1]["layers"] = [{"above": 6.0, "material": "clay"}]
    sim = Simulation.from_scene(layered)
    sim.run()
    assert sim.particles.owned == 36 and (sim.particles.material == 0).all()


@pytest.mark.parametrize("key, entry", [
    ("gravity_factor", 0.5), ("gravity_factor", {"times": [0, 10], "values": [0.5, 3.0]}), ("boundaries", "load"),
])  # fmt: skip
def test_gravity_and_tractions_go_by_their_factors(key, entry):
    """Equilibrium at half of the weight, and a traction of half of a row's weight at half of its factor."""
    stage = SETTLE | {"name": "part"}
    stage[key] = [*HELD, entry] if key == "boundaries" else entry
    data = scene([stage])
    del data["initial_stress"]
    load = {"stress": [0.0, -40e3], "side": "y+", "factor": {"times": [0.0, 1.0], "values": [0.5, 1.0]}}
    data["boundaries"]["load"] = {"where": {"lower": [None, 7]}, "traction": load}
    sim = Simulation.from_scene(data)
    sim.run()
    expected = 20e3 * 5.5 * 0.5 if key == "gravity_factor" else 20e3 * (5.5 + 1.0)
    assert -vertical_stress(sim)[2] == pytest.approx(expected, rel=0.1)


def test_a_factor_follows_its_history_in_motion():
    ramp = {"name": "spin", "type": "dynamics", "duration": 0.02,
            "gravity_factor": {"times": [0.0, 1.0], "values": [0.0, 100.0]}}  # fmt: skip
    data = scene([ramp])
    del data["initial_stress"]
    sim = Simulation.from_scene(data)
    sim.run()
    assert sim.particles.velocity[:, 1].mean() == pytest.approx(-10.0 * 100.0 * sim.time**2 / 2.0, rel=1e-9)


@pytest.mark.parametrize("change, message", [
    ({"body": "ground", "into": "steel"}, r"stages\[0\].change\[0\].into: there is no material 'steel'"),
    ({"material": "sole", "into": "soil"}, r"change\[0\].material: there is no material 'sole'; did you mean 'soil'"),
    ({"lower": [50, 0], "into": "soil"}, r"stages\[0\].change\[0\]: there is no point in it at this stage"),
])  # fmt: skip
def test_changes_of_what_is_not_there_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        Simulation.from_scene(scene([SETTLE | {"change": [change]}]))


def test_a_stage_that_removes_all_is_refused():
    with pytest.raises(InputError, match=r"stages\[1\].remove: takes all points away"):
        Simulation.from_scene(scene([SETTLE, DIG | {"remove": [{"lower": [None, None], "upper": [9, 9]}]}]))


def test_factors_without_gravity_are_refused():
    data = scene([SETTLE | {"gravity_factor": 0.5}])
    del data["gravity"], data["initial_stress"]
    with pytest.raises(InputError, match=r"stages\[0\].gravity_factor: there is no gravity"):
        Simulation.from_scene(data)


@pytest.mark.parametrize("key, message", [
    ({"change": [{"body": "ground", "into": "soil"}]}, r"change\[0\]: soil with pore_water keeps its material"),
    ({"gravity_factor": 0.5}, r"gravity_factor: the weight of pore_water does not follow it"),
])  # fmt: skip
@pytest.mark.parametrize("water", [{"suction": 0}, {"water_table": 8.0, "free_water": {"level": 8.0}}])
def test_what_would_change_the_water_is_refused(key, message, water):
    with pytest.raises(InputError, match=message):
        Simulation.from_scene(scene([SETTLE | key]) | {"pore_water": water | {"porosity": 0.4}})
