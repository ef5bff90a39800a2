"""Gaps and normals of rigid surfaces against geometry."""

import numpy as np
import pytest
from mpi4py import MPI

from periporo.contact.solids import block
from periporo.contact.surfaces import Box, Cylinder, Disc, Plane, Polyline
from periporo.core.scene.build import build
from periporo.core.scene.obstacles import solid_of
from periporo.errors import InputError
from periporo.io.input.load import parse_scene

CLOCKWISE = [[0, 0], [0, 2], [1, 2], [3, 0], [0, 0]]
TERRAIN = [[-1.0, 0.5], [0.0, 0.0], [1.0, 0.0], [1.5, 1.0], [3.0, 0.4]]
SURFACES = {
    "plane": (Plane([0.1, 0.2], [1.0, 2.0]), 2),
    "plane 3D": (Plane([0.1, 0.2, 0.3], [1.0, 2.0, -0.5]), 3),
    "box": (Box([-0.5, -0.3], [0.7, 0.4]), 2),
    "box 3D": (Box([-0.5, -0.3, -0.6], [0.7, 0.4, 0.5]), 3),
    "disc": (Disc([0.2, -0.1], 0.8), 2),
    "cylinder": (Cylinder([0.1, 0.0, -0.5], 2, 0.6, 1.1), 3),
    "cylinder along x": (Cylinder([-0.5, 0.1, 0.0], 0, 0.6, 1.1), 3),
    "terrain": (Polyline(TERRAIN), 2),
    "obstacle": (Polyline(CLOCKWISE), 2),
}


@pytest.mark.parametrize("name", SURFACES)
def test_normal_is_the_gradient_of_the_gap(name):
    surface, d = SURFACES[name]
    x = np.random.default_rng(1).uniform(-2.0, 3.0, (2000, d))
    gap, normal = surface.gap(x)
    assert np.abs((normal**2).sum(axis=1) - 1.0).max() < 1e-12
    step = 1e-7
    ends = np.stack([surface.gap(x + sign * step * normal)[0] for sign in (1, -1)])
    smooth = np.abs(ends - gap).max(axis=0) < 1.5 * step  # not across an edge's bisector
    assert smooth.all()
    assert np.median(np.abs((ends[0] - ends[1]) / (2 * step) - 1.0)) < 1e-7
    # a distance never changes faster than its place
    other = np.random.default_rng(2).uniform(-2.0, 3.0, (2000, d))
    assert (np.abs(surface.gap(other)[0] - gap) <= np.sqrt(((other - x) ** 2).sum(axis=1)) + 1e-12).all()


@pytest.mark.parametrize("name", SURFACES)
def test_the_foot_of_an_outer_point_lies_on_the_surface(name):
    surface, d = SURFACES[name]
    x = np.random.default_rng(3).uniform(-2.0, 3.0, (500, d))
    gap, normal = surface.gap(x)
    outside = gap > 0.0
    foot = x[outside] - gap[outside, None] * normal[outside]
    assert outside.sum() > 100
    assert np.abs(surface.gap(foot)[0]).max() < 1e-12


def test_known_gaps():
    box, disc = Box([0, 0], [2, 1]), Disc([1, 1], 0.5)
    assert box.gap(np.array([[3.0, 2.0], [1.0, 0.9], [-1.0, 0.5]]))[0] == pytest.approx([np.sqrt(2.0), -0.1, 1.0])
    assert disc.gap(np.array([[1.0, 3.0], [1.0, 1.0]]))[0] == pytest.approx([1.5, -0.5])
    assert np.isfinite(disc.gap(np.array([[1.0, 1.0]]))[1]).all()
    cylinder = Cylinder([0, 0, 0], 2, 1.0, 2.0)
    x = np.array([[3.0, 0, 1.0], [0, 0, 4.0], [0, 0, -1.0], [2.0, 0, 3.0], [0.9, 0, 1.0], [0.0, 0.0, 1.8]])
    gap, normal = cylinder.gap(x)
    assert gap == pytest.approx([2.0, 2.0, 1.0, np.sqrt(2.0), -0.1, -0.2])
    assert normal[[1, 2, 4, 5]] == pytest.approx(np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, 0, 1]]))


def test_polyline_ends_go_on_and_a_closed_one_is_a_solid():
    terrain = Polyline(TERRAIN)
    # beyond the first vertex the slope of -1/2 goes on
    x = np.array([[-5.0, 2.5 + 1.0], [-5.0, 2.5 - 1.0]])
    assert terrain.gap(x)[0] == pytest.approx(np.array([1.0, -1.0]) * 2.0 / np.sqrt(5.0))
    # in the concave corner at (0, 0) both sides are outside, below it is solid
    assert terrain.gap(np.array([[0.0, 0.1], [0.0, -0.1]]))[0] == pytest.approx([0.2 / np.sqrt(5.0), -0.1])
    # the closed one agrees with the box that it is drawn around
    box, line = Box([0, 0], [2, 1]), Polyline([[0, 0], [0, 1], [2, 1], [2, 0], [0, 0]])
    x = np.random.default_rng(4).uniform(-1, 3, (1000, 2))
    assert line.gap(x)[0] == pytest.approx(box.gap(x)[0], abs=1e-13)


def test_nan_stays_visible():
    for surface, d in SURFACES.values():
        assert np.isnan(surface.gap(np.full((1, d), np.nan))[0]).all()


@pytest.mark.parametrize("name", SURFACES)
def test_outlines_lie_on_the_surface(name):
    """Corners and middles of cells, but for what a polygon cuts off a circle; endless ones reach the whole view."""
    surface, d = SURFACES[name]
    middle, size = np.full(d, 0.4), 5.0
    points, cells = surface.outline(middle, size)
    assert points.shape[1] == d and {row for _, rows in cells for row in rows} == set(range(len(points)))
    assert np.abs(surface.gap(points)[0]).max() < 1e-12
    if isinstance(surface, Plane):
        assert (((points - middle) ** 2).sum(axis=1) >= size**2).all()
    if name == "terrain":
        assert np.sqrt(((points[[0, -1]] - middle) ** 2).sum(axis=1)).min() > 0.9 * size
    area = cells_size(points, cells)
    expected = {"box": 1.2 * 0.7, "disc": np.pi * 0.64, "cylinder": 2 * np.pi * (0.36 + 0.6 * 1.1)}
    if name in expected:
        assert area == pytest.approx(expected[name], rel=3e-3)


def cells_size(points, cells):
    """Sum of the areas of flat cells."""
    total = 0.0
    for _, rows in cells:
        corners = np.pad(points[list(rows)], ((0, 0), (0, 3 - points.shape[1])))
        spokes = corners[1:] - corners[0]
        total += 0.5 * np.linalg.norm(np.cross(spokes[:-1], spokes[1:]).sum(axis=0)) if len(corners) > 2 else 0.0
    return total


def test_a_closed_surface_of_triangles_is_the_solid_that_it_is_around(tmp_path):
    """A box from a file: the same gap and the same mass, centre and inertia; an open one is told."""
    trimesh = pytest.importorskip("trimesh")
    lower, upper = np.array([1.0, 0.0, 2.0]), np.array([2.0, 3.0, 2.5])
    surface = trimesh.creation.box(bounds=[lower, upper])
    surface.export(tmp_path / "box.obj")
    surface.update_faces(np.arange(11))
    surface.export(tmp_path / "open.obj")
    soil = {"model": "elastic", "density": 2000.0, "bulk_modulus": 40e6, "shear_modulus": 20e6}
    scene = {
        "dimension": 3, "spacing": 0.25, "gravity": [0, 0, -10.0], "materials": {"soil": soil},
        "bodies": [{"name": "b", "material": "soil",
                    "shape": {"type": "box", "lower": [0, 0, 0], "upper": [3, 3, 1]}}],
        "contacts": [{"type": "mesh", "name": "stone", "file": "box.obj", "friction": 0.5,
                      "free": {"density": 2600.0}}],
        "stages": [{"name": "fall", "type": "dynamics", "duration": 0.2}],
    }  # fmt: skip
    sim = build(parse_scene(scene, tmp_path), MPI.COMM_SELF)
    stone = sim.stages[0].contacts[0]
    same = block(lower, upper)
    found = solid_of(parse_scene(scene, tmp_path).contacts[0], 3)
    assert found.volume == pytest.approx(same.volume) and found.centre == pytest.approx(same.centre)
    assert found.inertia == pytest.approx(same.inertia, abs=1e-12) and found.size == same.size
    assert sorted(map(tuple, found.places)) == sorted(map(tuple, same.places))
    places = np.random.default_rng(2).uniform([0.7, -0.3, 1.7], [2.3, 3.3, 2.8], (200, 3))
    outside = ((places < lower) | (places > upper)).any(axis=1)
    gap, _ = stone.surface.gap(places)
    assert gap[outside] == pytest.approx(Box(lower, upper).gap(places)[0][outside])
    assert (gap[~outside] < 0.0).all() and stone.motion.mass == pytest.approx(2600.0 * 1.5)
    scene["contacts"][0]["file"] = "open.obj"
    with pytest.raises(InputError, match=r"contacts\[0\].file: the surface is open: an edge at"):
        parse_scene(scene, tmp_path)
