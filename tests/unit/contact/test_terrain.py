"""Ground from heights and triangles: the way out of it, what edges do, and that force is the slope of an energy."""

import numpy as np
import pytest

from periporo.contact.surfaces import Plane
from periporo.contact.terrain import HeightField, TriangleSurface
from periporo.core.numerics.meshes import plant, windings

R = 0.5  # reach of a point
NEAR = {"reach": R, "within": 2.0}


def field(level, corner=(0.0, 0.0), cell=(1.0, 1.0)):
    return HeightField(np.asarray(level, float), np.array(corner), np.array(cell), **NEAR)


def mesh_of(field):
    """The same surface as triangles, in a drawn order."""
    ny, nx = field.level.shape
    x, y = np.meshgrid(*(field.corner[a] + np.arange(n) * field.cell[a] for a, n in enumerate((nx, ny))))
    number = np.arange(nx * ny).reshape(ny, nx)
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    triangles = triangles[np.random.default_rng(1).permutation(len(triangles))]
    corners = np.stack([x.ravel(), y.ravel(), field.level.ravel()], axis=1)
    return TriangleSurface(plant(corners, triangles, np.zeros(len(triangles), np.int64)), **NEAR)


def rough(seed=3):
    rng = np.random.default_rng(seed)
    return field(rng.uniform(0.0, 0.8, (9, 11)), (-2.0, 1.0), (0.7, 1.1))


def over(field, n=400, seed=5, low=-0.2, high=1.2):
    rng = np.random.default_rng(seed)
    ny, nx = field.level.shape
    place = field.corner + rng.uniform(1.0, [nx - 2.0, ny - 2.0], (n, 2)) * field.cell
    return np.column_stack([place, rng.uniform(low, high, n)])


def test_heights_and_triangles_of_one_surface_are_one():
    ground = rough()
    places = over(ground)
    (gap, normal), (other, way) = ground.gap(places), mesh_of(ground).gap(places)
    assert other == pytest.approx(gap, abs=1e-12)
    assert way == pytest.approx(normal, abs=1e-9)
    assert 0.1 < (gap < R).mean() < 0.9 and (gap < 0.0).any()


def test_a_slope_of_triangles_is_a_plane_also_over_its_seams():
    slope = np.array([0.3, -0.4])
    x, y = np.meshgrid(np.arange(6.0), np.arange(6.0))
    ground = field(slope[0] * x + slope[1] * y)
    plane = Plane([0.0, 0.0, 0.0], [*-slope, 1.0])
    places = over(ground, high=0.6)
    places[:50, :2] = np.rint(places[:50, :2])  # on corners, and on both kinds of edges
    places[50:100, 0] = np.rint(places[50:100, 0])
    places[100:150, 1] = places[100:150, 0]
    places[:, 2] += places[:, :2] @ slope
    for surface in (ground, mesh_of(ground)):
        (gap, normal), (right, out) = surface.gap(places), plane.gap(places)
        near = right < 1.9
        assert gap[near] == pytest.approx(right[near], abs=1e-12)
        assert normal[near] == pytest.approx(out[near], abs=1e-8)


def test_a_triangle_is_found_wherever_it_lies_and_whatever_else_is_asked():
    """The nearest of loose triangles of many sizes, against all distances; one place alone as among others."""
    rng, n = np.random.default_rng(7), 60
    size = rng.uniform(0.05, 1.0, (n, 1, 1))
    corners = rng.uniform(0.0, 8.0, (n, 1, 3)) + size * rng.normal(0.0, 1.0, (n, 3, 3))
    surface = TriangleSurface(plant(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3), np.zeros(n, int)), **NEAR)
    share = np.array([[a, b] for a in np.linspace(0.0, 1.0, 31) for b in np.linspace(0.0, 1.0, 31) if a + b < 1.01])
    places = rng.uniform(0.0, 8.0, (100, 3))
    ways = corners[:, :1] + share @ (corners[:, 1:] - corners[:, :1]) - places[:, None, None]
    distance = np.sqrt((ways**2).sum(axis=-1)).min(axis=(1, 2))
    gap, normal = surface.gap(places)
    far = (distance > R + 0.05) & (distance < 1.9) & (gap > 0.0)  # who is behind, or touches, is led out by several
    assert far.sum() > 15 and np.abs(gap[far]) == pytest.approx(distance[far], abs=0.01)
    assert np.isinf(gap[distance > 2.05]).all()
    alone = [surface.gap(place[None]) for place in places[:40]]
    assert np.concatenate([g for g, _ in alone]).tolist() == gap[:40].tolist()
    assert np.concatenate([n for _, n in alone]).tolist() == normal[:40].tolist()


def valley(sign=1.0):
    x = np.arange(7.0)
    return field(sign * np.tile(np.abs(x - 3.0), (5, 1)))


def test_an_edge_that_runs_in_has_both_faces_and_one_that_sticks_out_the_nearest():
    """At 45 degrees the way out of a valley is the sum of what both faces ask for."""
    z = 0.6  # .424 from each face
    gap, normal = valley().gap(np.array([[3.0, 2.0, z], [3.0, 2.0, 1.0], [2.0, 2.0, 1.3]]))
    assert R - gap[0] == pytest.approx(R * np.sqrt(2.0) - z, rel=1e-12) and normal[0] == pytest.approx([0.0, 0.0, 1.0])
    assert gap[1] == pytest.approx(np.sqrt(0.5), rel=1e-12)
    assert gap[2] == pytest.approx(0.3 * np.sqrt(0.5)) and normal[2] == pytest.approx([0.5**0.5, 0.0, 0.5**0.5])
    ridge = valley(-1.0)
    gap, normal = ridge.gap(np.array([[3.0, 2.0, 0.3], [3.2, 2.0, 0.3], [3.0, 2.0, -0.3], [3.1, 2.0, -0.3]]))
    assert gap[:2] == pytest.approx([0.3, np.hypot(0.2, 0.3)])
    assert normal[1] == pytest.approx(np.array([0.2, 0.0, 0.3]) / np.hypot(0.2, 0.3))
    assert gap[2] == pytest.approx(-0.3 * np.sqrt(0.5))
    assert gap[3] == pytest.approx(-0.2 * np.sqrt(0.5)) and normal[3] == pytest.approx([0.5**0.5, 0.0, 0.5**0.5])


def test_in_a_corner_of_three_faces_each_pushes():
    """The inside of a box's corner as triangles: three walls at right angles, each with its own overlap."""
    corners = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4]], float)
    triangles = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]])
    surface = TriangleSurface(plant(corners, triangles, np.zeros(3, np.int64)), **NEAR)
    gap, normal = surface.gap(np.array([[0.4, 0.3, 0.2], [0.4, 0.3, 0.9], [0.7, 0.6, 0.9]]))
    overlap = np.array([0.1, 0.2, 0.3])
    size = np.sqrt((overlap**2).sum())
    assert gap[0] == pytest.approx(R - size) and normal[0] == pytest.approx(overlap / size)
    assert gap[1] == pytest.approx(R - np.hypot(0.1, 0.2)) and gap[2] == pytest.approx(0.6)


def test_the_force_is_the_slope_of_an_energy_and_continuous():
    """k u against the slope of k u^2 / 2, over a rough ground with edges of both kinds."""
    ground, h = rough(), 1e-6
    places = over(ground, 1500, low=0.2, high=1.0)
    gap, normal = ground.gap(places)
    pressed = (gap > 0.3 * R) & (gap < R)
    places, force = places[pressed], (R - gap[pressed])[:, None] * normal[pressed]
    slope = np.empty_like(force)
    for a in range(3):
        step = h * np.eye(3)[a]
        ends = [0.5 * np.maximum(R - ground.gap(places + s * step)[0], 0.0) ** 2 for s in (1.0, -1.0)]
        slope[:, a] = (ends[1] - ends[0]) / (2.0 * h)
    assert len(places) > 200
    assert np.abs(slope - force).max() < 2e-4
    path = np.linspace(places[0], places[-1], 4001)
    path[:, 2] = 0.75
    gap, normal = ground.gap(path)
    force = np.maximum(R - gap, 0.0)[:, None] * normal
    step = np.linalg.norm(np.diff(path, axis=0), axis=1).max()
    light = (gap[1:] > 0.5 * R) & (gap[:-1] > 0.5 * R)
    assert np.linalg.norm(np.diff(force, axis=0), axis=1)[light].max() < 1.01 * step


def test_heights_go_on_beyond_their_border_and_holes_are_told():
    ground = field(np.full((3, 3), 2.0))
    gap, normal = ground.gap(np.array([[-30.0, 50.0, 2.3], [1.0, 1.0, -7.0], [1.0, 1.0, 9.0]]))
    assert gap == pytest.approx([0.3, -9.0, np.inf]) and normal[0] == pytest.approx([0.0, 0.0, 1.0])
    holed = np.zeros((4, 4))
    holed[1, 1] = np.nan
    gap, _ = field(holed).gap(np.array([[1.2, 1.1, 0.2], [2.6, 2.6, 0.2]]))
    assert np.isnan(gap[0]) and gap[1] == pytest.approx(0.2)


def test_who_is_behind_the_plane_beyond_a_border_is_behind_nothing():
    corners, triangles = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0]], float), np.array([[0, 1, 2]])
    surface = TriangleSurface(plant(corners, triangles, np.array([63])), **NEAR)
    gap, _ = surface.gap(np.array([[-0.1, 1.0, -0.1], [-0.1, 1.0, 0.1], [0.3, 0.3, -0.1]]))
    assert gap[0] == np.inf
    assert gap[1:] == pytest.approx([np.hypot(0.1, 0.1), -0.1])


def test_beyond_the_border_of_a_slope_nothing_is_behind_it():
    """Also where triangles that have no part in the border lie within what is looked at."""
    x, y = np.meshgrid(np.arange(9.0) / 2, np.arange(9.0) / 2)
    number = np.arange(81).reshape(9, 9)
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    at_border = ((x == 0) | (x == 4) | (y == 0) | (y == 4)).ravel()
    edges = at_border[triangles] & at_border[np.roll(triangles, -1, axis=1)]
    bits = (np.concatenate([edges, at_border[triangles]], axis=1) << np.arange(6)).sum(axis=1)
    surface = TriangleSurface(plant(np.stack([x.ravel(), y.ravel(), 0.5 * x.ravel()], axis=1), triangles, bits), **NEAR)
    gap, _ = surface.gap(np.array([[2, -0.3, 0.3], [2, -1.0, 0.5], [2, 0.3, 0.7], [2, -0.3, 1.3]]))
    assert np.isinf(gap[:2]).all()
    assert gap[2:] == pytest.approx([-0.3 / 1.25**0.5, np.hypot(0.3, 0.3 / 1.25**0.5)])


def cube(offset=0.0):
    corners = np.array(list(np.ndindex(2, 2, 2)), float) + offset
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return corners, np.array([[q[k] for k in row] for q in quads for row in ((0, 1, 2), (0, 2, 3))])


def test_windings_count_how_often_a_surface_lies_around_a_place():
    corners, triangles = cube()
    other, _ = cube(0.5)
    both = plant(np.concatenate([corners, other]), np.concatenate([triangles, triangles + 8]), np.zeros(24, np.int64))
    count = np.empty(5, np.int64)
    places = np.array([[0.25, 0.25, 0.25], [0.75, 0.75, 0.75], [1.2, 1.2, 1.2], [0.25, 1.25, 0.5], [0.5, 0.5, 0.1]])
    windings(both.corners, both.triangles, both.boxes, places, count)
    assert count.tolist() == [1, 2, 1, 0, 1]  # the last ray runs through a corner and along diagonals


def test_a_fine_ground_is_drawn_coarsely():
    ground = field(np.zeros((400, 300)))
    for surface in (ground, mesh_of(ground)):
        points, cells = surface.outline(np.array([150.0, 200.0, 0.0]), 200.0)
        assert 2_000 < len(cells) < 21_000
        assert points.min(axis=0)[:2] == pytest.approx([0.0, 0.0], abs=4.0)
        assert points.max(axis=0)[:2] == pytest.approx([299.0, 399.0], abs=4.0)
