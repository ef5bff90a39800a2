"""Scenes far from zero move as they do at zero; an origin near the bodies takes the distance."""

import copy

import numpy as np
import pytest
from mpi4py import MPI

import periporo
from periporo.core.scene.build import build
from periporo.io.geometry.origin import relative, scene_origin
from periporo.io.geometry.points import counted_from
from periporo.io.input.load import parse_scene
from periporo.io.schema.base import SceneModel

FAR = np.array([500_000.0, 4_000_000.0])
LENGTHS = {"spacing", "radius", "height", "displacement", "thickness", "width", "length"}
"""Keys in metres that are no places."""
FILES = {"ground", "surface", "corner", "cell", "phreatic_surface"}
"""Those of rasters, which move when they are read."""

DEPTHS = {("_Table", "at"), ("DepthField", "at")}  # below the surface, while the levels of another field are places


def subclasses(kind):
    for below in kind.__subclasses__():
        yield below
        yield from subclasses(below)


def test_every_key_in_metres_says_whether_it_is_a_place():
    keys = [(m, name, info) for m in subclasses(SceneModel) for name, info in m.model_fields.items()]
    extras = {(m.__name__, name): info.json_schema_extra or {} for m, name, info in keys}
    metres = {key: extra.get("place") for key, extra in extras.items() if extra.get("unit") == "m"}
    assert len(metres) > 20
    metres = {key: place for key, place in metres.items() if key not in DEPTHS}
    assert {name for (_, name), place in metres.items() if place is None} <= LENGTHS | FILES
    assert {name for (_, name), place in metres.items() if place is not None}.isdisjoint(LENGTHS)


def shifted(value, by):
    """A scene's dictionary with every place moved."""
    data = copy.deepcopy(value)
    for body in data["bodies"]:
        for corner in ("lower", "upper", "center"):
            if corner in body["shape"]:
                body["shape"][corner] = (np.array(body["shape"][corner]) + by).tolist()
        for layer in body.get("layers", ()):
            layer["above"] += by[1]
    for contact in data["contacts"]:
        for name in ("point", "lower", "upper"):
            if name in contact:
                contact[name] = (np.array(contact[name]) + by).tolist()
        if "vertices" in contact:
            contact["vertices"] = (np.array(contact["vertices"]) + by).tolist()
    for boundary in data.get("boundaries", {}).values():
        for corner in ("lower", "upper"):
            if corner in boundary["where"]:
                pair = zip(boundary["where"][corner], by, strict=True)
                boundary["where"][corner] = [None if x is None else x + b for x, b in pair]
    if "initial_stress" in data:
        data["initial_stress"]["surface"] += by[1]
    data["monitor"] = {"points": [(np.array(p) + by).tolist() for p in data["monitor"]["points"]]}
    return data


@pytest.fixture
def slow(scene_of):
    """A layered block, of which a wall pushes one side at a micrometre a second, beside obstacles of three kinds."""
    scene = scene_of(counts=(12, 8), materials="two", spacing=0.125)
    scene["boundaries"] = {"wall": {"where": {"upper": [-0.625, None]}, "velocity": {"x": 1e-6}}}
    scene["contacts"] += [{"type": "box", "lower": [0.75, 0.0], "upper": [1.0, 1.0], "friction": 0.0},
                          {"type": "polyline", "vertices": [[-2.0, -3.005], [2.0, -3.0]], "friction": 0.1}]
    scene["initial_stress"] = {"type": "geostatic", "K0": 0.5, "surface": 1.0}
    scene["stages"][0] |= {"duration": 4e-3, "boundaries": ["wall"]}
    scene["monitor"] = {"points": [[0.0, 0.5]]}
    return scene | {"output": {"history_interval": 5}}


def test_motion_far_from_zero_is_that_at_zero(slow, tmp_path):
    near, far = tmp_path / "near.vtkhdf", tmp_path / "far.vtkhdf"
    periporo.run(slow, near, quiet=True)
    periporo.run(shifted(slow, FAR), far, quiet=True)
    size = 1.5
    with periporo.open_results(near) as a, periporo.open_results(far) as b:
        assert not a.origin.any() and (b.origin[:2] > 0.0).all() and (np.abs(b.origin[:2] - FAR) <= 10.0).all()
        wall = a.positions(0)[:, 0] < -0.625
        assert b.field("displacement")[wall, 0] == pytest.approx(np.full(8, 4e-9), rel=0.1)
        for name in a.fields:
            scale = np.abs(a.field(name)).max()
            assert np.abs(a.field(name) - b.field(name)).max() <= 1e-9 * scale, name
        assert np.abs(a.field("displacement") - b.field("displacement")).max() < 1e-12 * size
        assert b.positions() == pytest.approx(a.positions() + np.append(FAR, 0.0), rel=0, abs=1e-9)
        for name in a.history_names:
            assert b.history(name) == pytest.approx(a.history(name), rel=1e-6, abs=1e-12), name
        assert len(a.obstacles()) == 3
        for (number, kind, corners), (same, alike, there) in zip(a.obstacles(), b.obstacles(), strict=True):
            assert (number, kind) == (same, alike)
            assert there == pytest.approx(corners + np.append(FAR, 0.0), rel=0, abs=1e-8)


def test_scenes_near_zero_are_left_alone(slow):
    scene = parse_scene(shifted(slow, [50.0, -20.0]))
    assert not scene_origin(scene).any() and relative(scene, scene_origin(scene)) is scene


def test_coordinates_keep_the_digits_they_were_written_with():
    assert counted_from(4_000_000.005, 4_000_000.0) == 0.005
    assert counted_from(499_999.9999, 500_000.0) == -0.0001
    assert counted_from(1 / 3, 0.0) == 1 / 3
    rows = counted_from(np.array([[500_000.125, 4_000_000.005], [500_000.3, 4_000_001.7]]), tuple(FAR))
    assert rows.tolist() == [[0.125, 0.005], [0.3, 1.7]]


def test_points_from_a_file_and_messages_far_from_zero(slow, tmp_path):
    x, y = np.meshgrid((np.arange(12) + 0.5) * 0.125, (np.arange(8) + 0.5) * 0.125, indexing="ij")
    places = np.stack([x.ravel() - 0.75, y.ravel()], axis=1) + FAR
    np.savetxt(tmp_path / "soil.csv", places, delimiter=",", header="x,y", comments="", fmt="%.4f")
    data = shifted(slow, FAR)
    data["bodies"][0]["shape"] = {"type": "points", "file": "soil.csv"}
    sim = build(parse_scene(data, tmp_path), MPI.COMM_SELF)
    assert sim.particles.position[:96] + sim.origin == pytest.approx(places, rel=0, abs=1e-9)
    steps = np.diff(np.unique(sim.particles.position[:96, 0]))
    assert steps == pytest.approx(np.full(11, 0.125), rel=0, abs=1e-15)
    data["contacts"][0]["point"][1] += 0.5
    with pytest.raises(periporo.InputError, match=r"the point at \(499999\.\d+,\s+4000000\.06"):
        build(parse_scene(data, tmp_path), MPI.COMM_SELF)
