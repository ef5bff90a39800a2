"""Boundaries of water that come and go with the stages, and ground that is dug away and filled up while water flows."""

import json

import numpy as np
import pytest
import yaml

from periporo.core.water.flow import flowing_water

SAND = {"model": "elastic", "density": 1590.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
WATER = {"suction": 0, "drainage": "flowing", "porosity": 0.4, "bulk_modulus": 1e7, "conductivity": 1e-3}
SURFACE, FLOOR = ({"lower": [None, y - 0.005], "upper": [None, y + 0.005]} for y in (0.195, 0.005))
BOUNDARIES = {
    "still": {"where": {"body": "column"}, "fix": ["x", "y"]},
    "pond": {"where": SURFACE, "water": {"head": 0.5, "side": "y+"}},
    "drain": {"where": FLOOR, "water": {"head": 0.1, "side": "y-"}},
    "drawdown": {"where": FLOOR, "water": {"head": {"times": [0.2, 0.3], "values": [0.1, 0.0]}, "side": "y-"}},
    "rain": {"where": SURFACE, "water": {"rain": 2.5e-4, "side": "y+"}},
}


def body(name, base, top):
    return {"name": name, "material": "sand", "shape": {"type": "box", "lower": [0, base], "upper": [0.04, top]}}


def column(stages, kind="dynamics", **keys):
    """Sand .04 m wide and .2 m high, whose pressures even out in .02 s, in stages (boundaries, other keys) of .2 s."""
    listed = [{"name": f"stage {k}", "type": kind, "duration": 0.2, "boundaries": ["still", *named]} | other
              for k, (named, other) in enumerate(stages)]  # fmt: skip
    return {
        "dimension": 2, "spacing": 0.01, "gravity": [0, -9.81], "materials": {"sand": SAND}, "pore_water": WATER,
        "bodies": [body("column", 0.0, 0.2)], "boundaries": BOUNDARIES, "stages": listed,
    } | ({"time_step": {"fixed": 2e-3}} if kind == "dynamics" else {}) | keys  # fmt: skip


def ends(sim):
    """Of each stage: head of floor and surface (m), what came in, left and ran off, and what is stored more (m^3)."""
    found = []
    for number, stage in enumerate(sim.stages):
        sim.stage_number, before = number, flowing_water(sim).histories()
        stage.run(sim)
        p, after = sim.particles, flowing_water(sim).histories()
        head, y = p.pore_pressure / 9810.0 + p.position[:, 1], p.position[:, 1]
        gained = [after[f"water_{n}"] - before[f"water_{n}"] for n in ("inflow", "outflow", "runoff", "stored")]
        found.append([head[y < y.min() + 1e-3].mean(), head[y > y.max() - 1e-3].mean(), *gained])
    return np.array(found)


@pytest.mark.parametrize("kind", ["dynamics", "quasi_static"])
def test_pond_drawdown_and_rain_act_in_their_stages(started, kind):
    """A pond drains to the floor; it is gone and the floor falls to 0; rain on a floor at .1; rain alone; nothing."""
    stages = [(["pond", "drain"], {}), (["drawdown"], {}), (["drain", "rain"], {}), (["rain"], {}), ([], {})]
    found = ends(started(column(stages, kind)))
    heads, (entered, left, ran_off, stored) = found[:, :2], found[:, 2:].T
    # half a spacing within the faces; Darcy's flow of 1 mm/s and of the rain
    known = np.array([[0.11, 0.49], [0, 0], [0.10125, 0.14875], [0.2, 0.2], [0.2, 0.2]])
    assert heads == pytest.approx(known, abs=8e-4)
    assert entered[0] == pytest.approx(1e-3 * 0.4 / 0.2 * 0.04 * 0.2, rel=0.04)  # and what fills the pores at first
    assert entered[1] == pytest.approx(0.0, abs=1e-8) and left[1] > 0.0
    assert entered[2] > 2.5e-4 * 0.04 * 0.2 and ran_off[:3] == pytest.approx(0.0, abs=1e-12)
    assert entered[3] + ran_off[3] == pytest.approx(2.5e-4 * 0.04 * 0.2, rel=0.02) and ran_off[3] > 5.0 * entered[3]
    assert found[4, 2:] == pytest.approx(0.0, abs=1e-9)
    assert stored == pytest.approx(entered - left, abs=1e-12)


def cut(where):
    """The column is dug off to half its height, under a pond of .1 m on what is dug; then filled up by a quarter."""
    named = BOUNDARIES | {"cut": {"where": where, "water": {"head": 0.2, "side": "y+"}},
                          "held": {"where": {"body": "fill"}, "fix": ["x", "y"]}}  # fmt: skip
    dug = {"remove": [{"lower": [None, 0.1]}]}
    stages = [(["drain"], {}), (["drain", "cut"], dug), (["drain", "held"], {"place": ["fill"]})]
    return column(stages, bodies=[body("column", 0.0, 0.2), body("fill", 0.1, 0.15)], boundaries=named)


def test_water_goes_through_the_floor_of_an_excavation_until_it_is_filled_up(started):
    found = ends(started(cut({"lower": [None, 0.09], "upper": [None, 0.1]})))
    heads, (entered, left, _, stored) = found[:, :2], found[:, 2:].T
    assert heads == pytest.approx(np.array([[0.1, 0.1], [0.105, 0.195], [0.1, 0.1]]), abs=1e-3)
    flow = 1e-3 * 0.1 / 0.1 * 0.04 * 0.2
    assert [entered[1], left[1]] == pytest.approx([flow, flow], rel=0.05)
    held = 0.4 * 0.04  # m^2 of pores by m of height
    assert stored + left - entered == pytest.approx([0.0, -0.1 * held, 0.05 * held], rel=0.01, abs=1e-9)


def test_a_boundary_within_what_is_left_is_refused_when_it_is_dug(call, tmp_path):
    """With file, line, entry and stage; what was recorded before stays."""
    text = yaml.safe_dump(json.loads(json.dumps(cut({"lower": [None, 0.05], "upper": [None, 0.06]}))))  # no aliases
    (tmp_path / "dug.yaml").write_text(text)
    status, _, error = call("dug.yaml", "--quiet", "--no-plot")
    line = text.splitlines().index("    water:", text.splitlines().index("  cut:")) + 1
    found = " ".join(error.split())
    assert status == 2 and f"dug.yaml: 1 problem line {line}, boundaries.cut.water: none of its points has" in found
    assert "that looks to y+ in stage 'stage 1'" in found and (tmp_path / "dug.vtkhdf").exists()
