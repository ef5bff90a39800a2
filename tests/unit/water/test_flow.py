"""Water that flows: conductances, faces, Darcy's law, boundaries, conservation, input."""

import numpy as np
import pytest

from periporo.core.motion.rebuilds import rebuild
from periporo.core.numerics.jit import kernel
from periporo.core.points.fields import values
from periporo.core.water.conductance import pair_conductance, stretched
from periporo.core.water.flow import flowing_water
from periporo.core.water.stages import integrate
from periporo.errors import InputError, WaterError
from periporo.io.input.load import parse_scene

SAND = {"model": "elastic", "density": 1590.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
GAMMA, SPEED = 9810.0, 1e-3
FLOWING = {"suction": 0, "drainage": "flowing", "porosity": 0.4, "bulk_modulus": 1e7, "conductivity": SPEED}
EVERYWHERE = {"where": {"body": "block"}, "fix": ["x", "y"]}

OPEN = {"drain": {"where": {"body": "block"}, "water": {"pressure": 0}}}


def held(scene_of, water, boundaries, *, counts=(3, 20), duration=1.0, step=0.01, **keys):
    """A scene of water that flows in a block whose grains stand still."""
    named = {"still": EVERYWHERE} | boundaries
    stage = {"name": "flow", "type": "dynamics", "duration": duration, "boundaries": list(named)}
    return scene_of(counts=counts, materials=SAND, contacts=[], pore_water=water, boundaries=named,
                    stages=[stage], time_step={"fixed": step}, **keys)  # fmt: skip


def row(level, spacing=0.01):
    return {"lower": [None, level - spacing / 2], "upper": [None, level + spacing / 2]}


def histories(sim):
    return flowing_water(sim).histories()


@kernel
def _conductances(first, second, weight, position, volume, conduction, result, dim):
    for b in range(first.shape[0]):
        result[b] = pair_conductance(first[b], second[b], weight[b], position, volume, conduction, dim)


def second_moments(sim, factors=None):
    """sum_j a xi (x) xi of each point over twice its volume."""
    p, pairs = sim.particles, sim.bonds.pairs
    a = np.empty(len(pairs.first))
    place = stretched(p.position, np.ones(p.dimension) if factors is None else np.array(factors))
    _conductances(pairs.first, pairs.second, pairs.weight, place, p.volume, p.conduction, a, p.dim)
    xi = p.position[pairs.second] - p.position[pairs.first]
    terms = a[:, None, None] * xi[:, :, None] * xi[:, None, :]
    sums = np.zeros((p.owned, p.dimension, p.dimension))
    np.add.at(sums, pairs.first, terms)
    np.add.at(sums, pairs.second, terms)
    return sums / (2.0 * p.volume[:, None, None]), a


@pytest.mark.parametrize("dimension, counts", [(2, (14, 14)), (3, (9, 9, 9))])
def test_conductances_are_those_of_the_continuum(dimension, counts, scene_of, started):
    """On a lattice to rounding, on jittered points on average; none is negative."""
    for jitter, tolerance in ((0.0, 1e-6), (0.1, 0.03)):
        scene = scene_of(dimension, counts, materials=SAND, contacts=[], pore_water=FLOWING)
        scene["bodies"][0]["jitter"] = jitter
        sim = started(scene)
        moments, a = second_moments(sim)
        p = sim.particles
        middle = 0.5 * (p.position.min(axis=0) + p.position.max(axis=0))
        inner = (np.abs(p.position - middle) < 0.5 * 0.01 * np.array(counts) - 0.03).all(axis=1)
        assert inner.sum() > 20 and (a >= 0.0).all()
        assert moments[inner].mean(axis=0) == pytest.approx(np.eye(dimension), abs=tolerance)
        assert np.abs(moments[inner] - np.eye(dimension)).max() < 10 * tolerance


@pytest.mark.parametrize("factors", [(1.0, 0.1), (0.2, 1.0), (1.0, 0.3, 0.05)])
def test_layered_soil_conducts_by_its_axes(factors, scene_of, started):
    """Second moments are the tensor of the factors, none is negative, and faces are as large as they were."""
    d = len(factors)
    sim = started(scene_of(d, (14, 14) if d == 2 else (9, 9, 9), materials=SAND, contacts=[],
                           pore_water=FLOWING | {"anisotropy": factors}, boundaries=OPEN))  # fmt: skip
    moments, a = second_moments(sim, factors)
    p = sim.particles
    middle = 0.5 * (p.position.min(axis=0) + p.position.max(axis=0))
    inner = (np.abs(p.position - middle) < (0.04 if d == 2 else 0.015)).all(axis=1)
    assert (a >= 0.0).all() and inner.sum() >= 8
    assert moments[inner] == pytest.approx(np.tile(np.diag(factors), (inner.sum(), 1, 1)), abs=1e-5)
    side = p.position[:, 0] > p.position[:, 0].max() - 1e-6
    face = np.sqrt((flowing_water(sim).outer_faces(p)[side, :d] ** 2).sum(axis=1))
    assert np.median(face) == pytest.approx(0.01 ** (d - 1), rel=0.05)


def test_flow_along_and_across_layers(scene_of, started):
    """Heads at both ends of a column whose permeability upwards is .2 of that given: a fifth flows."""
    boundaries = {"top": {"where": row(0.195), "water": {"head": 0.5, "side": "y+"}},
                  "base": {"where": row(0.005), "water": {"head": 0.1, "side": "y-"}}}  # fmt: skip
    water = FLOWING | {"anisotropy": [1.0, 0.2], "bulk_modulus": 1e6}
    sim = started(held(scene_of, water, boundaries, counts=(4, 20), duration=1.0, step=1e-2))
    sim.run()
    p = sim.particles
    head = p.pore_pressure / GAMMA + p.position[:, 1]
    assert head == pytest.approx(0.1 + 0.4 * p.position[:, 1] / 0.2, rel=0.01)
    flux = values(sim, ["flux"])["flux"]
    assert flux[:, 1] == pytest.approx(-0.2 * SPEED * 0.4 / 0.2, rel=0.025)
    before, steps = histories(sim)["water_inflow"], 5
    for _ in range(steps):
        sim.step()
    assert histories(sim)["water_inflow"] - before == pytest.approx(0.2 * SPEED * 2.0 * 0.04 * steps * 1e-2, rel=0.02)


def test_compressed_points_conduct_as_before(scene_of, started):
    """Rows at .7 of their distance: the flux along both axes is still that of a unit gradient."""
    sim = started(scene_of(counts=(14, 20), materials=SAND, contacts=[], pore_water=FLOWING))
    p = sim.particles
    p.position[:, 1] *= 0.7
    p.volume *= 0.7
    rebuild(sim)
    sim.evaluate_forces()
    moments, _ = second_moments(sim)
    p = sim.particles
    inner = (np.abs(p.position[:, 0]) < 0.035) & (np.abs(p.position[:, 1] - 0.07) < 0.03)
    assert moments[inner] == pytest.approx(np.tile(np.eye(2), (inner.sum(), 1, 1)), abs=1e-6)


def test_faces_of_the_surface(scene_of, started):
    """Area vectors point outwards, are as long as the cells' faces, half a spacing away, and sum up to nothing."""
    sim = started(scene_of(counts=(8, 8), materials=SAND, contacts=[], pore_water=FLOWING, boundaries=OPEN))
    p, face = sim.particles, flowing_water(sim).outer_faces(sim.particles)
    top = (p.position[:, 1] > 0.07) & (np.abs(p.position[:, 0]) < 0.02)
    assert face[top, 1] == pytest.approx(0.01, rel=0.02) and np.abs(face[top, 0]).max() < 1e-5
    assert 0.5 * face[top, 3] / face[top, 1] == pytest.approx(0.005, rel=0.02)
    inner = (np.abs(p.position - [0, 0.04]) < 0.03).all(axis=1)
    assert not face[inner].any() and np.abs(face[:, :2].sum(axis=0)).max() < 1e-12


def test_faces_follow_the_volume(scene_of, started):
    """A block pressed to .7 of its height takes the same flux through its upper face as before."""
    boundaries = {"top": {"where": row(0.195), "water": {"flux": SPEED, "side": "y+"}}}
    sim = started(held(scene_of, FLOWING, boundaries, step=1e-4, counts=(12, 20)))
    p = sim.particles
    p.position[:, 1] *= 0.7
    p.pore_dilation[:] = 0.7
    rebuild(sim)
    sim.inflows = sim.stages[0].inflows
    before = histories(sim)["water_inflow"]
    sim.step()
    assert histories(sim)["water_inflow"] - before == pytest.approx(SPEED * 0.12 * sim.dt, rel=0.02)


def test_stages_are_of_second_order():
    """On decaying modes, also those that an explicit step would blow up."""
    rates = np.array([0.3, 1.0, 40.0])

    def error(dt, stages):
        return np.abs(integrate(lambda y: -rates * y, np.ones(3), dt, stages) - np.exp(-rates * dt))

    assert np.log2(error(0.2, 5)[:2] / error(0.1, 5)[:2]) == pytest.approx([3.0, 3.0], abs=0.2)
    assert (error(1.0, 13)[:2] < [2e-3, 0.04]).all() and error(1.0, 13)[2] < 0.65
    assert integrate(lambda y: -rates * y, np.ones(3), 0.01, 1) == pytest.approx(1.0 - 0.01 * rates)


def test_water_at_rest_stays(scene_of, started):
    """Hydrostatic pressure, a head at the top: nothing flows, to rounding."""
    boundaries = {"top": {"where": row(0.195), "water": {"head": 0.3, "side": "y+"}}}
    water = {k: v for k, v in FLOWING.items() if k != "suction"} | {"water_table": 0.3}
    sim = started(held(scene_of, water, boundaries))
    before = sim.particles.water_content.copy()
    sim.run()
    p = sim.particles
    assert np.abs(p.water_content / before - 1.0).max() < 1e-12
    assert p.pore_pressure == pytest.approx(GAMMA * (0.3 - p.position[:, 1]), rel=1e-9)


def test_steady_flow_is_darcys(scene_of, started):
    """Heads at both ends: q = K dh/L between the faces, heads linear, and no water is lost."""
    boundaries = {"top": {"where": row(0.195), "water": {"head": 0.5, "side": "y+"}},
                  "base": {"where": row(0.005), "water": {"head": 0.1, "side": "y-"}}}  # fmt: skip
    sim = started(held(scene_of, FLOWING, boundaries, duration=0.2, step=2e-3))
    sim.run()
    p, first = sim.particles, histories(sim)
    head = p.pore_pressure / GAMMA + p.position[:, 1]
    assert head == pytest.approx(0.1 + 0.4 * p.position[:, 1] / 0.2, rel=0.01)
    flux = values(sim, ["flux"])["flux"]
    assert flux[:, 1] == pytest.approx(-SPEED * 0.4 / 0.2, rel=0.02) and np.abs(flux[:, 0]).max() < 0.05 * SPEED
    for _ in range(20):
        sim.step()
    last = histories(sim)
    expected = SPEED * 0.4 / 0.2 * 0.03 * 20 * 2e-3
    assert last["water_inflow"] - first["water_inflow"] == pytest.approx(expected, rel=0.01)
    assert last["water_outflow"] - first["water_outflow"] == pytest.approx(expected, rel=0.01)
    assert abs(last["water_balance"]) < 1e-13 * last["water_stored"] * 400


@pytest.mark.parametrize("rain, taken", [(0.2 * SPEED, 1.0), (20.0 * SPEED, None)])
def test_rain_enters_or_runs_off(rain, taken, scene_of, started):
    """Little rain enters as a whole; of much the pressure at the surface stays 0, and the rest runs off."""
    curve = {"van_genuchten": {"alpha": 1.0, "n": 3.0, "residual": 0.05}}
    water = FLOWING | {"suction": 2e3, "retention": curve}
    boundaries = {"rain": {"where": row(0.195), "water": {"rain": rain, "side": "y+"}}}
    sim = started(held(scene_of, water, boundaries, duration=2.0, step=0.02))
    sim.run()
    p, sums = sim.particles, histories(sim)
    fallen = rain * 0.03 * sim.time
    assert sums["water_inflow"] + sums["water_runoff"] == pytest.approx(fallen, rel=0.02)
    assert abs(sums["water_balance"]) < 1e-12 * sums["water_stored"]
    top = p.position[:, 1] > 0.19
    if taken is not None:
        assert sums["water_inflow"] == pytest.approx(taken * fallen, rel=0.02) and p.pore_pressure.max() < 0.0
    else:
        assert sums["water_runoff"] > 0.3 * fallen
        assert np.abs(p.pore_pressure[top]).max() < 0.3 * 2e3
    assert sums["water_outflow"] == 0.0


def test_a_seepage_face_lets_water_out_only(scene_of, started):
    """A full block drains through its base until its pressure is that of the suction which holds the water up."""
    boundaries = {"base": {"where": row(0.005), "water": {"rain": 0, "side": "y-"}}}
    water = {k: v for k, v in FLOWING.items() if k != "suction"} | {"water_table": 0.2}
    sim = started(held(scene_of, water, boundaries, duration=0.2, step=2e-3))
    sim.run()
    p, sums = sim.particles, histories(sim)
    assert sums["water_inflow"] == 0.0 and sums["water_outflow"] > 0.0
    assert p.pore_pressure == pytest.approx(-GAMMA * p.position[:, 1], abs=0.01 * GAMMA * 0.2)


def test_flow_through_soils_in_series(scene_of, started):
    """Two layers, conductivities 1 and 10: the drop of head is ten times as large in the first."""
    boundaries = {"top": {"where": row(0.195), "water": {"head": 0.5, "side": "y+"}},
                  "base": {"where": row(0.005), "water": {"head": 0.1, "side": "y-"}}}  # fmt: skip
    water = FLOWING | {"bulk_modulus": 1e6, "soils": {"upper": {"permeability": SPEED * 1e-3 / GAMMA * 10.0}}}
    scene = held(scene_of, water, boundaries, duration=1.0, step=0.01)
    scene["materials"] = {"soil": SAND, "upper": SAND}
    scene["bodies"][0]["layers"] = [{"above": 0.1, "material": "upper"}]
    sim = started(scene)
    sim.run()
    p = sim.particles
    head = p.pore_pressure / GAMMA + p.position[:, 1]
    lower, upper = (np.polyfit(p.position[part, 1], head[part], 1)[0] for part in (
        p.position[:, 1] < 0.08, p.position[:, 1] > 0.12))  # fmt: skip
    assert lower / upper == pytest.approx(10.0, rel=0.02)
    assert lower == pytest.approx(0.4 / (0.1 + 0.01), rel=0.02)
    assert values(sim, ["flux"])["flux"][:, 1] == pytest.approx(-SPEED * lower, rel=0.03)


def test_what_flow_needs_is_said(scene_of, started, tmp_path):
    scene = scene_of(materials=SAND, pore_water=FLOWING)
    dry = {k: v for k, v in FLOWING.items() if k != "conductivity"}
    with pytest.raises(InputError, match=r"needs\s+a\s+conductivity\s+\(m/s\),\s+or\s+a\s+permeability\s+\(m\^2\)"):
        started(scene | {"pore_water": dry})
    with pytest.raises(InputError, match=r"one\s+of:\s+conductivity\s+in\s+m/s,\s+permeability\s+in\s+m"):
        parse_scene(scene | {"pore_water": FLOWING | {"permeability": 1e-9}}, ".")
    with pytest.raises(InputError, match="would pull water of a bulk_modulus of 1000 Pa apart".replace(" ", r"\s+")):
        parse_scene(scene | {"pore_water": FLOWING | {"suction": 500, "bulk_modulus": 1e3}}, ".")
    for porosity in (0, 1):
        with pytest.raises(InputError, match=rf"than\s+0\s+and\s+less\s+than\s+1,\s+not\s+{porosity}"):
            parse_scene(scene | {"pore_water": FLOWING | {"porosity": porosity}}, ".")
    named = next(iter(scene["materials"]))
    for own, place in (({"permeability": 1e-5}, r"pore_water\.permeability"),
                       ({"conductivity": 1e-3, "soils": {named: {"permeability": 1e-5}}}, r"soils\.\w+\.permeability")):
        with pytest.raises(InputError, match=rf"(?s){place}: .* too\s+fast\s+for\s+the\s+time\s+step"):
            started(scene | {"pore_water": dry | own})
    sim = started(scene)
    process = flowing_water(sim)
    with pytest.raises(WaterError, match=r"too fast for the time step .* are conductivity \(m/s\) and permeability"):
        process._flow(sim.particles, 1e3)
    for text, words in (("0,1\n1000\n", "row 2 has 1 columns, not the 2"), ("0,.9\n1000,.5\n", "saturation must be 1"),
                        ("0,1\n1e3,.5\n2e3,.6\n", "from row 2 to row 3 the saturation rises from 0.5 to 0.6"),
                        ("0,1\n1e3,50\n", "row 2 has a saturation of 50; it must lie in")):
        (tmp_path / "curve.csv").write_text("suction,saturation\n" + text)
        with pytest.raises(InputError, match=words.replace(" ", r"\s+")):
            started(scene | {"pore_water": FLOWING | {"retention": {"table": "curve.csv"}}}, tmp_path)
    with pytest.raises(InputError, match=r"there\s+is\s+no\s+material\s+'sol'"):
        parse_scene(scene | {"pore_water": FLOWING | {"soils": {"sol": {}}}}, ".")
    rain = {"rain": {"where": {"body": "block"}, "water": {"rain": 1e-6}}}
    with pytest.raises(InputError, match=r"nothing\s+enters\s+or\s+leaves\s+unless\s+water\s+flows"):
        parse_scene(scene | {"boundaries": rain, "pore_water": {"suction": 0, "porosity": 0.4}}, ".")
    with pytest.raises(InputError, match=r"rain\s+needs\s+gravity"):
        parse_scene(scene | {"boundaries": rain, "gravity": None}, ".")
    with pytest.raises(InputError, match=r"exactly\s+one\s+of\s+pressure,\s+head,\s+flux,\s+rain"):
        parse_scene(scene | {"boundaries": {"rain": {"where": {"body": "block"}, "water": {}}}}, ".")


def test_water_needs_a_surface(scene_of, started):
    rain = {"rain": {"where": row(0.105), "water": {"rain": 1e-6, "side": "y+"}}}
    with pytest.raises(InputError, match=r"none of its points has a face at the surface that looks to y\+"):
        started(held(scene_of, FLOWING, rain))
