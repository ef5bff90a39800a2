"""What the pressure is at the start: water tables of one level, a line, or a raster, pressures known at points."""

import numpy as np
import pytest

import periporo
from periporo.core.scene.doubts import doubts_about
from periporo.errors import InputError
from periporo.io.geometry.fields import linear_around
from periporo.io.input.load import parse_scene

GAMMA = 9810.0
SAND = {"model": "elastic", "density": 1590.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
GEOSTATIC = {"type": "geostatic", "K0": 0.5}
CURVE = {"van_genuchten": {"alpha": 2.0, "n": 2.0}}


def wet(scene_of, water, dimension=2, counts=(6, 6), **keys):
    return scene_of(dimension, counts, materials=SAND, initial_stress=GEOSTATIC, pore_water={"porosity": 0.4} | water,
                    **keys)  # fmt: skip


def refused(scene, message, folder="."):
    with pytest.raises(InputError, match=message.replace(" ", r"\s+")):
        parse_scene(scene, folder)


def plane(x):
    return 0.02 + 0.3 * x[:, 0] - 0.2 * x[:, 1]


def test_a_raster_is_a_water_table(tmp_path, scene_of, started):
    """Linear between its values, level beyond its edge; stress below it has buoyancy, points move under it."""
    x, y = np.meshgrid(np.arange(4) * 0.02, np.arange(3) * 0.02)
    np.save(tmp_path / "table.npy", 0.02 + 0.3 * x - 0.2 * y)
    table = {"file": "table.npy", "corner": [0, 0], "cell": [0.02, 0.02], "first_row": "south"}
    table["registration"] = "corner"
    scene = wet(scene_of, {"phreatic_surface": table, "largest_suction": 100.0}, 3, (5, 4, 4))
    sim = started(scene, tmp_path)
    p = sim.particles
    edge = np.column_stack([np.clip(p.position[:, 0], 0, 0.06), np.clip(p.position[:, 1], 0, 0.04), p.position[:, 2]])
    expected = np.maximum(GAMMA * (plane(edge) - p.position[:, 2]), -100.0)
    assert p.pore_pressure == pytest.approx(expected, abs=1e-9) and (expected > 0.0).any() and (expected < 0.0).any()
    block = sim.bonds.blocks[0]
    assert block.stress[:, 2] == pytest.approx(block.total_stress[:, 2] + expected[block.first], abs=1e-6)
    p.position[:, 2] -= 0.01
    sim.point_processes[-1].update(p, sim.bonds, 0.0)
    assert p.pore_pressure == pytest.approx(np.maximum(GAMMA * (plane(edge) - p.position[:, 2]), -100.0), abs=1e-9)
    level = np.full((3, 4), 0.02)
    level[1, 2] = np.nan
    np.save(tmp_path / "table.npy", level)
    refused(scene, r"1 places without a value .* row 2, column 3", tmp_path)
    refused(scene | {"gravity": [1.0, 0.0, -9.81]}, "heights of a raster go along z", tmp_path)
    refused(wet(scene_of, {"phreatic_surface": table}), "for three dimensions; give a phreatic_line", tmp_path)
    refused(wet(scene_of, {"phreatic_line": [[0, 0], [1, 0]]}, 3, (4, 4, 4)), "give a phreatic_surface")


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("origin", [0.0, 4e6])
def test_pressures_at_points_of_a_file(dimension, origin, tmp_path, scene_of, started):
    """Water at rest, told by scattered points, is what a water table makes: pressure, saturation, mass and stress."""
    counts = (5, 4) if dimension == 2 else (4, 3, 4)
    level, rng = 0.013, np.random.default_rng(1)
    places = rng.uniform(-0.02, 0.08, (60, dimension))
    rows = np.column_stack([places + origin, GAMMA * (level - places[:, -1])])
    np.savetxt(tmp_path / "known.csv", rows, "%.15g", ",", header="x,y,z"[: 2 * dimension - 1] + ",u", comments="")
    body = {"bodies": [{"name": "soil", "material": "soil", "shape": {"type": "box",
            "lower": [origin] * dimension, "upper": (origin + 0.01 * np.array(counts)).tolist()}}]}  # fmt: skip
    keys = {"retention": CURVE, "drainage": "flowing", "conductivity": 1e-5}
    given = wet(scene_of, {"pressure": {"file": "known.csv", "column": "u"}} | keys, dimension, counts)
    table = wet(scene_of, {"water_table": origin + level, "largest_suction": 1e4} | keys, dimension, counts)
    known, sought = (started(s | body | {"contacts": []}, tmp_path) for s in (given, table))
    a, b = known.particles, sought.particles
    assert a.pore_pressure == pytest.approx(b.pore_pressure, abs=1e-2 if origin else 1e-8)
    assert a.saturation == pytest.approx(b.saturation, abs=1e-6) and b.saturation.min() < 0.95
    assert a.water_content == pytest.approx(b.water_content, rel=1e-6)
    stress, expected = (sim.bonds.blocks[0].total_stress for sim in (known, sought))
    assert stress == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())


def test_values_around_points():
    """Those of a point at the point itself, whatever they are; one alone holds everywhere, a row along itself."""
    rng = np.random.default_rng(2)
    places, values = rng.uniform(0, 1, (40, 3)), rng.uniform(0, 1, 40)
    assert linear_around(places, values, places) == pytest.approx(values, abs=1e-14)
    there = rng.uniform(-1, 2, (7, 3))
    assert linear_around(places[:1], values[:1], there) == pytest.approx(np.full(7, values[0]))
    row = np.zeros((5, 3)) + np.arange(5.0)[:, None] * [0, 0, 1]
    assert linear_around(row, 3.0 * row[:, 2], there) == pytest.approx(3.0 * there[:, 2])
    assert linear_around(places, values, there[:0]).shape == (0,)


def test_pressures_of_a_result_file(tmp_path, scene_of, started):
    """Points at the places of a result begin with its pressures; what it lacks is said."""
    water = {"water_table": 0.03, "largest_suction": 200.0}
    stages = {"stages": [{"name": "go", "type": "dynamics", "duration": 1e-6}]}
    scene = wet(scene_of, water, **stages) | {"output": {"fields": ["pore_pressure", "velocity"]}}
    periporo.run(scene, tmp_path / "before.vtkhdf")
    sim = started(wet(scene_of, {"pressure": {"file": "before.vtkhdf", "step": 0}, "drainage": "undrained"}), tmp_path)
    p = sim.particles
    expected = np.maximum(GAMMA * (0.03 - p.position[:, 1]), -200.0)
    assert p.pore_pressure == pytest.approx(expected, abs=1e-3)
    for entry, message in (
        ({"column": "suction"}, "holds no field 'suction'"), ({"column": "velocity"}, "must be one finite number"),
        ({"step": 7}, "7"),
    ):
        with pytest.raises(InputError, match=message.replace(" ", r"\s+")):
            started(wet(scene_of, {"pressure": {"file": "before.vtkhdf"} | entry}), tmp_path)
    with pytest.raises(InputError, match=r"has\s+2\s+dimensions"):
        started(wet(scene_of, {"pressure": {"file": "before.vtkhdf"}}, 3, (4, 4, 4)), tmp_path)


def test_drained_water_follows_histories(scene_of, started):
    """Suction, and the level of a water table, over time."""
    history = {"times": [0, 2e-6], "values": [1e3, 3e3]}
    sim = started(wet(scene_of, {"suction": history}, gravity=None, contacts=[], time_step={"fixed": 1e-6})
                  | {"initial_stress": None})  # fmt: skip
    assert sim.particles.pore_pressure == pytest.approx(-1e3)
    sim.step()
    assert sim.particles.pore_pressure == pytest.approx(-2e3) and sim.particles.pore_stress == pytest.approx(2e3)
    history = {"times": [0, 2e-6], "values": [0.05, 0.03]}
    sim = started(wet(scene_of, {"water_table": history}, time_step={"fixed": 1e-6}))
    sim.step()
    p = sim.particles
    assert p.pore_pressure == pytest.approx(np.maximum(GAMMA * (0.04 - p.position[:, 1]), 0.0), abs=1e-6)


@pytest.mark.parametrize("water, message", [
    ({"suction": -1.0}, "must not be below 0"),
    ({"suction": {"times": [0, 1], "values": [0, 1e3]}, "drainage": "undrained"}, "history of suction is for drained"),
    ({"water_table": {"times": [0, 1], "values": [0, 1]}, "drainage": "flowing"}, "history of water_table is for"),
    ({"water_table": {"times": [0, 1], "values": [0, 1]}, "frozen": True}, "not frozen"),
    ({"suction": 0, "water_table": 1.0}, "give exactly one of: suction"),
    ({}, "give exactly one of: suction"),
    ({"pressure": {"file": "known.csv"}, "largest_suction": 1e3}, "belongs to a water table"),
    ({"pressure": {"file": "known.csv", "step": 1}}, "step is for a result file"),
    ({"pressure": {"file": "none.csv"}}, "none.csv"),
    ({"phreatic_surface": "known.csv"}, "unknown kind of file"),
])  # fmt: skip
def test_starts_that_are_refused(water, message, tmp_path, scene_of):
    (tmp_path / "known.csv").write_text("x,y,pore_pressure\n0,0,0\n")
    refused(wet(scene_of, water), message, tmp_path)


def test_files_that_do_not_suit(tmp_path, scene_of, started):
    """A column that is not there, another dimension, suctions no water bears; points far from all places are told."""
    water = {"pressure": {"file": "known.csv"}}
    for text, more, message in (
        ("x,y,u\n0,0,0\n", {}, "its first line must hold x, y and 'pore_pressure'"),
        ("x,y,z,pore_pressure\n0,0,0,0\n", {}, "of 3 coordinates"),
        ("x,y,pore_pressure\n0,0,nan\n", {}, "finite numbers"),
        ("x,y,pore_pressure\n0,0,-2e9\n", {"drainage": "undrained"}, "pull water .* apart"),
    ):
        (tmp_path / "known.csv").write_text(text)
        with pytest.raises(InputError, match=message.replace(" ", r"\s+")):
            started(wet(scene_of, water | more), tmp_path)
    for reach, doubted in ((0.01, True), (0.06, False)):
        grid = np.stack(np.meshgrid(*[np.linspace(0, reach, 4)] * 2), axis=-1).reshape(-1, 2)
        rows = np.column_stack([grid, 100.0 * grid[:, 1]])
        np.savetxt(tmp_path / "known.csv", rows, "%g", ",", header="x,y,pore_pressure", comments="")
        scene = wet(scene_of, water)
        found = doubts_about(parse_scene(scene, tmp_path), started(scene, tmp_path))
        assert any("from the nearest place" in doubt for doubt in found) == doubted
