"""Soil on grounds from files: lattices that stand on them, geostatic weight, and what cannot be meant."""

import numpy as np
import pytest

from periporo import Simulation
from periporo.core.scene.geostatic import GeostaticStress
from periporo.errors import InputError
from periporo.io.geometry.lattice import build_lattices
from periporo.io.geometry.layers import layer_of
from periporo.io.geometry.origin import relative, scene_origin
from periporo.io.input.load import parse_scene

SPACING = 1.0


def grid(path, values, corner=(0.0, 0.0), cell=2.0):
    """Write values (ny, nx), rows from the south, whose first stands at `corner`."""
    values = np.asarray(values, float)
    rows = "\n".join(" ".join(f"{v:.12g}" for v in row) for row in values[::-1])
    path.write_text(f"ncols {values.shape[1]}\nnrows {values.shape[0]}\nxllcenter {corner[0]!r}\n"
                    f"yllcenter {corner[1]!r}\ncellsize {cell}\nNODATA_value -9999\n{rows}\n")
    return path.name


def slope(corner=(0.0, 0.0), n=(21, 26)):
    y, x = np.meshgrid(*(2.0 * np.arange(k) for k in n), indexing="ij")
    return 30.0 - 0.5 * x + 0.1 * y


def thick():
    level = np.full((21, 26), -9999.0)
    level[6:14, 5:15] = 4.2
    return level


def scene_of(folder, shape=None, corner=(0.0, 0.0), **more):
    names = {"ground": grid(folder / "ground.asc", slope(), corner),
             "thickness": grid(folder / "release.asc", thick(), corner)}
    scene = {
        "dimension": 3, "spacing": SPACING, "gravity": [0, 0, -9.81],
        "materials": {"soil": {"model": "elastic", "density": 1800, "bulk_modulus": 25e5, "shear_modulus": 15e5}},
        "bodies": [{"name": "slide", "material": "soil", "shape": {"type": "raster", **names, **(shape or {})}}],
        "contacts": [{"type": "terrain", "ground": names["ground"], "friction": 0.4}],
        "stages": [{"name": "slide", "type": "dynamics", "duration": 1.0}], **more,
    }  # fmt: skip
    return parse_scene(scene, folder)


def points(scene):
    (lattice,) = build_lattices(scene)
    return lattice, lattice.sites(0, lattice.size)


def test_each_column_of_points_stands_on_the_ground(tmp_path):
    scene = scene_of(tmp_path)
    lattice, (ids, position, volume, _) = points(scene)
    layer = layer_of(scene.bodies[0].shape)
    steep = np.sqrt(1.0 + 0.5**2 + 0.1**2)
    height = position[:, 2] - layer.ground.at(position)
    row = np.rint(height - 0.5 * steep)
    assert height == pytest.approx(0.5 * steep * SPACING + row * SPACING, abs=1e-8)  # half a spacing along the normal
    assert sorted(set(row)) == [0.0, 1.0, 2.0, 3.0]
    assert volume.sum() == pytest.approx(layer.thickness(position[row == 0]).sum(), rel=0.05)
    assert len(set(ids)) == len(ids) == len(position)
    low, high = position.min(axis=0) + [3.0, 2.0, 1.0], position.max(axis=0) - [2.0, 3.0, 4.0]
    mine = ((position >= low) & (position <= high)).all(axis=1)
    assert np.array_equal(lattice.sites_within(low, high)[0], ids[mine]) and 0 < mine.sum() < len(ids)


def test_a_level_lattice_leaves_out_cells_that_cut_the_ground(tmp_path):
    scene = scene_of(tmp_path, {"conform": False})
    _, (_, position, *_) = points(scene)
    layer = layer_of(scene.bodies[0].shape)
    above = (position[:, 2] - layer.ground.at(position)) / np.sqrt(1.26)
    assert above.min() >= 0.5 * SPACING - 1e-6 and above.min() < 0.6 * SPACING
    assert len(np.unique(np.round(position[:, 2] % SPACING, 6))) == 1


def test_a_surface_is_another_way_to_say_the_thickness(tmp_path):
    scene = scene_of(tmp_path)
    level = np.where(thick() > 0.0, slope() + 4.2, -9999.0)
    shape = {"type": "raster", "ground": "ground.asc", "surface": grid(tmp_path / "top.asc", level)}
    data = scene.model_dump(mode="json", exclude_none=True)
    other = parse_scene(data | {"bodies": [data["bodies"][0] | {"shape": shape}]}, tmp_path)
    assert points(other)[1][1] == pytest.approx(points(scene)[1][1], abs=1e-9)


def test_far_from_zero_all_is_as_near_it(tmp_path):
    (tmp_path / "far").mkdir()
    corner = (512_000.25, 4_012_000.5)
    near, far = scene_of(tmp_path), scene_of(tmp_path / "far", corner=corner)
    origin = scene_origin(far)
    assert origin[0] == pytest.approx(corner[0], abs=100.0) and origin[1] == pytest.approx(corner[1], abs=100.0)
    here, there = points(near)[1], points(relative(far, origin))[1]
    assert np.array_equal(here[0], there[0])
    assert here[1] + np.array([*corner, 0.0]) - origin == pytest.approx(there[1], abs=1e-9)


def test_the_weight_above_ends_at_the_surface_of_the_layer(tmp_path):
    scene = scene_of(tmp_path)
    lattice, (_, position, *_) = points(scene)
    stress = GeostaticStress([lattice], np.array([1800.0]), np.array([0.0, 0.0, -9.81]), 0.5)(position)
    layer = layer_of(scene.bodies[0].shape)
    depth = layer.ground.at(position) + layer.thickness(position) - position[:, 2]
    assert stress[:, 2] == pytest.approx(-1800.0 * 9.81 * np.maximum(depth, 0.0), abs=1e-6)


@pytest.mark.parametrize("change, reason", [
    (lambda g, t: t.__setitem__((slice(None), slice(None)), 0.3), "there is no soil: it is nowhere as thick"),
    (lambda g, t: t.__setitem__((8, 9), -0.7), r"0.7 m below the ground at \(18, 16\), row 13, column 10"),
    (lambda g, t: g.__setitem__((8, 9), -9999.0), r"NODATA\) under soil at \(18, 16\), row 13, column 10"),
])
def test_soil_that_cannot_be_is_told_with_its_place(tmp_path, change, reason):
    ground, release = slope(), thick()
    change(ground, release)
    scene_of(tmp_path)
    data = scene_of(tmp_path).model_dump(mode="json", exclude_none=True)
    grid(tmp_path / "ground.asc", ground)
    grid(tmp_path / "release.asc", release)
    with pytest.raises(InputError, match="(?s)" + reason.replace(" ", r"\s+")):
        parse_scene(data, tmp_path)


def test_ground_must_reach_under_all_soil(tmp_path):
    scene = scene_of(tmp_path).model_dump(mode="json", exclude_none=True)
    grid(tmp_path / "small.asc", slope()[:, :8])
    box = {"type": "box", "lower": [4, 4, 40], "upper": [30, 8, 44]}
    bodies = [{"name": "block", "material": "soil", "shape": box}]
    terrain = [{"type": "terrain", "ground": "small.asc", "friction": 0.4}]
    with pytest.raises(InputError, match=r"(?s)point at \(16.5, 4.5, 40.5\), and\s+the\s+ground\s+ends\s+before\s+it"):
        parse_scene(scene | {"bodies": bodies, "contacts": terrain}, tmp_path)
    holed = slope()
    holed[3, 5] = -9999.0
    grid(tmp_path / "small.asc", holed)
    with pytest.raises(InputError, match=r"(?s)NODATA\) there, row"):
        parse_scene(scene | {"bodies": bodies, "contacts": terrain}, tmp_path)


def test_a_surface_and_soil_in_different_coordinates_are_told(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    trimesh.Trimesh([[0, 0, 0], [50, 0, 0], [50, 40, 0], [0, 40, 0]], [[0, 1, 2], [0, 2, 3]]).export(tmp_path / "g.ply")
    contacts = [{"type": "terrain", "ground": "g.ply", "friction": 0.4}]
    scene_of(tmp_path, contacts=contacts)
    with pytest.raises(InputError) as caught:
        scene_of(tmp_path, corner=(500000.0, 4000000.0), contacts=contacts)
    (problem,) = caught.value.problems
    assert problem.path == ("contacts", 0, "ground")
    assert "around (25, 20, 0) is 4.031e+06 m from the body 'slide' and only 64.03 m large" in problem.message


@pytest.mark.parametrize("kind", ["two boxes", "a spike"])
def test_a_release_surface_that_crosses_itself_is_told_with_the_place(tmp_path, kind):
    trimesh = pytest.importorskip("trimesh")
    solid = trimesh.creation.box((6, 6, 6))
    if kind == "two boxes":
        solid = trimesh.util.concatenate([solid, solid.copy().apply_translation((3, 3, 3))])
    else:  # its tip is pushed through to the other side
        solid = trimesh.creation.icosphere(1, 4.0)
        solid.vertices[solid.vertices[:, 2].argmax(), 2] -= 16.0
    solid.apply_translation((20, 20, 60)).export(tmp_path / "m.stl")
    with pytest.raises(InputError, match=r"(?s)crosses\s+itself\s+around\s+\([0-9.]+, [0-9.]+, [0-9.]+\);\s+mend"):
        scene_of(tmp_path, bodies=[{"name": "slide", "material": "soil", "shape": {"type": "mesh", "file": "m.stl"}}])


def test_heights_are_along_z(tmp_path):
    with pytest.raises(InputError, match=r"(?s)rasters and terrains need gravity against z"):
        scene_of(tmp_path, gravity=[1.0, 0.0, -9.0])


def sledges(folder, friction):
    """Two stiff blocks slide along x over level ground, side by side."""
    ground = grid(folder / "level.asc", np.zeros((21, 26)))
    stiff = {"model": "elastic", "density": 1800, "bulk_modulus": 25e5, "shear_modulus": 15e5}
    boxes = {"left": [4.0, 6.0, 0.0], "right": [4.0, 30.0, 0.0]}
    return {
        "dimension": 3, "spacing": SPACING, "gravity": [0, 0, -9.81], "materials": {"soil": stiff},
        "bodies": [{"name": name, "material": "soil", "velocity": [3.0, 0.0, 0.0],
                    "shape": {"type": "box", "lower": low, "upper": [low[0] + 4, low[1] + 4, 2.0]}}
                   for name, low in boxes.items()],
        "initial_stress": {"type": "geostatic", "K0": 0.5},
        "contacts": [{"type": "terrain", "ground": ground, "friction": friction, "damping": 0.3}],
        "stages": [{"name": "slide", "type": "dynamics", "duration": 0.5}],
    }  # fmt: skip


def test_friction_may_vary_over_the_ground(tmp_path):
    rough = np.full((21, 26), 0.1)
    rough[11:] = 0.4  # from y = 22 on
    sim = Simulation.from_scene(parse_scene(sledges(tmp_path, grid(tmp_path / "friction.asc", rough)), tmp_path))
    sim.run()
    p = sim.particles
    speed = [p.velocity[: p.owned][p.body[: p.owned] == k, 0].mean() for k in (0, 1)]
    assert (3.0 - np.array(speed)) / (9.81 * sim.time) == pytest.approx([0.1, 0.4], rel=0.03)


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (-9999.0, "the friction has no value (NODATA) at (8, 6), row 18, column 5 of the file"),
        (-0.5, "the friction is -0.5 at (8, 6), row 18, column 5 of the file"),
    ],
)
def test_friction_is_needed_wherever_soil_may_come(tmp_path, value, reason):
    rough = np.full((21, 26), 0.1)
    rough[3, 4] = value
    with pytest.raises(InputError) as caught:
        parse_scene(sledges(tmp_path, grid(tmp_path / "friction.asc", rough)), tmp_path)
    (problem,) = caught.value.problems
    assert problem.path == ("contacts", 0, "friction") and reason in problem.message


@pytest.mark.parametrize("friction", [-0.1, 11.0, "rough.txt", "missing.asc", [0.1], True, None])
def test_friction_is_a_number_or_a_raster(tmp_path, friction):
    with pytest.raises(InputError) as caught:
        parse_scene(sledges(tmp_path, friction), tmp_path)
    assert {problem.path[:3] for problem in caught.value.problems} == {("contacts", 0, "friction")}
    print(caught.value)
