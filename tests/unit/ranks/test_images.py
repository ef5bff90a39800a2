"""Planes of symmetry and periodic axes: a part does what the whole does, and what crosses a seam stays as it is."""

import numpy as np
import pytest

from periporo.core.motion.rebuilds import rebuild
from periporo.core.numerics.tensors import from_matrix, to_matrix
from periporo.core.points import fields
from periporo.core.points.particles import Field, Particles, matrix, symmetric, tensor, vector
from periporo.core.ranks.images import Images
from periporo.core.scene.doubts import doubts_about
from periporo.errors import ContactError, InputError
from periporo.io.input.load import parse_scene

G, SLOPE, DENSITY = 9.81, np.radians(25.0), 1800.0
ELASTIC = {"model": "elastic", "density": DENSITY, "bulk_modulus": 25e6, "shear_modulus": 15e6}
FLOOR = {"type": "plane", "name": "floor", "point": [0, 0], "normal": [0, 1], "friction": 0.9}
DEFAULT = {"scheme": "point_state", "sharpened": True, "regular": True}


def block(lower, upper, **keys):
    """A block of elastic soil in the plane, for 6 ms."""
    return {
        "dimension": 2, "spacing": 0.1, "materials": {"soil": ELASTIC}, "time_step": {"fixed": 2e-4},
        "bodies": [{"name": "block", "material": "soil", "shape": {"type": "box", "lower": lower, "upper": upper}}],
        "stages": [{"name": "go", "type": "dynamics", "duration": 6e-3}],
    } | keys  # fmt: skip


def moving(velocity, **keys):
    """A block that fills a periodic cell, with this velocity."""
    scene = block([0, 0], [0.8, 0.5], periodic={"lower": [0, None], "upper": [0.8, None]}, **keys)
    scene["bodies"][0]["velocity"] = velocity
    return scene


def finished(sim):
    """Run it; displacements (n, d) and initial places of its points."""
    sim.run()
    p = sim.particles
    return p.position[: p.owned] - p.initial_position, p.initial_position.copy()


@pytest.mark.parametrize("scheme", [DEFAULT, "bond_projected", "standard"])
def test_a_quarter_moves_as_the_whole_does(started, scheme):
    push = {"type": "uniform", "components": {"xx": -2e4, "yy": -1e4, "zz": -1e4}}
    keys = {"initial_stress": push, "correspondence": scheme, "time_step": {"fixed": 2e-4, "added_inertia": 1}}
    whole, place = finished(started(block([-0.5, -0.5], [0.5, 0.5], **keys)))
    quarter, quarters = finished(started(block([-0.5, 0], [0, 0.5], **keys, symmetry={"lower": [None, 0],
                                                                                     "upper": [0, None]})))  # fmt: skip
    same = np.flatnonzero((place[:, 0] < 0.0) & (place[:, 1] > 0.0))
    order, orders = np.lexsort(np.round(place[same], 6).T), np.lexsort(np.round(quarters, 6).T)
    assert np.abs(whole).max() > 1e-5
    assert quarter[orders] == pytest.approx(whole[same][order], rel=0, abs=1e-10 * np.abs(whole).max())


@pytest.mark.parametrize("dimension", [2, 3])
def test_images_of_tensors_are_reflected(dimension):
    p, d, rng = Particles(dimension), dimension, np.random.default_rng(1)
    axes = {"v": vector(d), "m": matrix(d), "s": symmetric(d), "t": tensor(d)}
    for name, along in axes.items():
        p.add_field(Field(name, len(along), "", axes=along))
    images = Images(p, {(1, -1): 0.5}, {})
    owned = {f.name: np.full(1 if f.columns is None else (1, f.columns), 0.2).astype(f.dtype) for f in p.migrating()}
    p.replace(dict(owned), 0)
    p.replace(owned, images.find(p, 2.0))
    for name in axes:
        getattr(p, name)[0] = rng.normal(size=len(axes[name]))
    images.fill(p, ("position", *axes))
    mirror = np.eye(3)
    mirror[1, 1] = -1.0
    plane = mirror[:d, :d]
    assert p.position[1].tolist() == [0.2, 0.8, 0.2][:d]
    assert (p.v[1] == plane @ p.v[0]).all()
    assert (p.m[1].reshape(d, d) == plane @ p.m[0].reshape(d, d) @ plane).all()
    assert (p.t[1] == from_matrix(mirror @ to_matrix(p.t[:1]) @ mirror, p.components)[0]).all()
    assert (p.s[1, :d] == p.s[0, :d]).all() and p.s[1, d] == -p.s[0, d]


@pytest.mark.parametrize("scheme", [DEFAULT, "bond_projected"])
def test_what_crosses_the_seam_does_what_it_would_do_at_rest(started, scheme):
    push = {"type": "uniform", "components": {"xx": -2e4, "yy": -1e4, "zz": -1e4}}
    there = {"type": "dynamics", "name": "go", "duration": 0.06}
    keys = {"initial_stress": push, "correspondence": scheme, "stages": [there]}
    rests = finished(started(moving([0, 0], **keys)))[0]
    sim = started(moving([20.0, 0], **keys))
    moves = finished(sim)[0]
    assert sim.particles.sheet[: sim.particles.owned, 0].min() == -2
    assert np.abs(sim.particles.position[:, 0]).max() < 1.7
    assert moves - [20.0 * sim.time, 0] == pytest.approx(rests, rel=0, abs=1e-9 * np.abs(rests).max())


def test_an_endless_slope_bears_what_it_must_and_slides_as_it_must(started):
    keys = {"gravity": [G * np.sin(SLOPE), -G * np.cos(SLOPE)], "contacts": [FLOOR]}
    sim = started(moving([0, 0], **keys, stages=[{"name": "rest", "type": "relax", "tolerance": 1e-8}]))
    sim.run()
    depth = 0.5 - sim.particles.initial_position[:, 1]
    stress, weight = fields.values(sim, ("stress",))["stress"], DENSITY * G * depth
    middle = np.abs(depth - 0.25) < 0.01
    assert stress[middle, 1] == pytest.approx(-weight[middle] * np.cos(SLOPE), rel=0.005)
    assert stress[middle, 3] == pytest.approx(weight[middle] * np.sin(SLOPE), rel=0.005)
    assert np.ptp(stress[middle], axis=0).max() < 1e-6 * np.abs(stress[middle]).max()
    (floor,) = sim.reactions
    borne = np.array([floor.histories(sim)[f"floor_force_{a}"] for a in "xy"])
    assert borne == pytest.approx(DENSITY * 0.8 * 0.5 * G * np.array([np.sin(SLOPE), -np.cos(SLOPE)]), rel=1e-6)
    smooth = [FLOOR | {"friction": 0.0}]
    sim = started(moving([2.0, 0], **keys | {"contacts": smooth}))
    sim.run()
    speed = sim.particles.velocity[: sim.particles.owned, 0]
    assert speed == pytest.approx(2.0 + G * np.sin(SLOPE) * sim.time, rel=1e-12)


def test_a_point_that_meets_its_image_and_goes_on_is_told(started):
    sim = started(block([0, 0], [0.5, 0.3], symmetry={"lower": [0, None]}))
    sim.particles.position[0, 0] = -0.06
    with pytest.raises(ContactError, match="symmetry: a point at .*0.06 m behind"):
        rebuild(sim)


@pytest.mark.parametrize("change, words", [
    ({"symmetry": {}}, "gives no place"),
    ({"symmetry": {"lower": [0.1, None]}}, "one side of the"),
    ({"symmetry": {"lower": [0, None]}, "gravity": [1.0, -9.81]}, "across a plane of symmetry"),
    ({"symmetry": {"lower": [0, None]}, "initial_stress": {"type": "uniform", "components": {"xy": 1.0}}},
     "no shear stress"),
    ({"symmetry": {"lower": [0, None]}, "correspondence": "sub_horizon"}, "points with images need"),
    ({"symmetry": {"lower": [0, None]}, "sleep": {"speed": 1e-3}}, "do not sleep"),
    ({"symmetry": {"lower": [0, None]}, "contacts": [
        {"type": "disc", "center": [3, 3], "radius": 1, "friction": 0, "name": "a", "free": {"density": 1e3}}]},
     "not free"),
    ({"periodic": {"lower": [0, None]}}, "both ends along x"),
    ({"periodic": {"lower": [0, 0], "upper": [1, 1]}}, "one axis must stay open"),
    ({"periodic": {"lower": [0, None], "upper": [0.7, None]}}, "what lies in the cell"),
    ({"periodic": {"lower": [0, None], "upper": [1, None]}, "symmetry": {"lower": [0, None]}}, "take one of both"),
    ({"periodic": {"lower": [0, None], "upper": [1, None]}, "domain": {"upper": [2, None]}}, "nothing leaves there"),
    ({"periodic": {"lower": [0, None], "upper": [1, None]}, "contacts": [FLOOR | {"normal": [0.1, 1]}]},
     "does not repeat along x"),
])  # fmt: skip
def test_what_images_cannot_do_is_refused(change, words):
    with pytest.raises(InputError, match=words):
        parse_scene(block([0, 0], [0.8, 0.5], **change))


def test_a_cell_as_narrow_as_the_horizon_is_refused(started):
    with pytest.raises(InputError, match="too narrow"):
        started(block([0, 0], [0.2, 0.5], periodic={"lower": [0, None], "upper": [0.2, None]}))


def test_a_seam_that_is_not_a_whole_number_of_spacings_is_doubted(started):
    scene = block([0, 0], [0.8, 0.5], periodic={"lower": [0, None], "upper": [0.85, None]})
    (text,) = (d for d in doubts_about(parse_scene(scene), started(scene)) if d.startswith("periodic"))
    assert "8.5 spacings along x" in text
