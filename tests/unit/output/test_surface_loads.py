"""Loads along the surface of obstacles: sums are those of the points, even loads are even up to corners."""

import csv

import numpy as np
import pytest

import periporo
from periporo.core.numerics.cells import LINE, POLY_LINE, POLYGON, QUAD
from periporo.io.output.results import ResultError
from periporo.io.output.surface_loads import along_axis, along_outline
from periporo.io.pictures.surface import surface_run

H = 0.1
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)


def beside(x, y):
    """Places (n, 3) m."""
    return np.column_stack(np.broadcast_arrays(np.asarray(x, float), y, 0.0))


def test_even_pressure_on_the_side_of_a_box_is_even_up_to_its_corners():
    places = beside(1.0 + 0.5 * H, np.arange(10) * H + 0.5 * H)
    forces = np.tile([-50.0 * H, 20.0 * H, 0.0], (10, 1))
    load = along_outline((QUAD, SQUARE), places, forces, H, rings=False)
    right = load.place[:, 0] > 1.0 - 1e-9
    assert load.pressure[right] == pytest.approx(50.0) and load.shear[right] == pytest.approx(20.0)
    assert not load.force[~right].any()
    assert np.diff(load.along) == pytest.approx(0.5 * H) and load.along[right].min() == pytest.approx(1.025)


@pytest.mark.parametrize("kind, sense", [(LINE, 1.0), (POLY_LINE, -1.0)])
def test_the_outside_of_a_plane_and_of_a_ground_is_where_its_points_are(kind, sense):
    ends = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])[:: int(-sense)]  # a plane's ends run to the left of its normal
    load = along_outline((kind, ends), beside([0.0], 0.05), np.array([[3.0, -8.0, 0.0]]), H, rings=False)
    step = np.diff(load.along)[0]
    assert load.normal[:, 1] == pytest.approx(1.0)
    assert step * load.pressure.sum() == pytest.approx(8.0)
    assert step * load.shear.sum() == pytest.approx(-3.0 * sense)


def test_pressure_around_a_disc_has_no_seam():
    angle = 2.0 * np.pi * np.arange(62) / 62
    circle = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    sides = 2.0 * np.pi * np.arange(64) / 64
    outline = np.column_stack([np.cos(sides), np.sin(sides), 0.0 * sides])
    load = along_outline((POLYGON, outline), 1.05 * circle, -7.0 * circle, H, rings=False)
    assert load.pressure == pytest.approx(62 * 7.0 / (2.0 * np.pi), rel=0.02)


def test_rings_press_on_the_base_of_a_pile_by_their_whole_circle():
    pile = np.array([[-0.5, 0, 0], [0.5, 0, 0], [0.5, 2, 0], [-0.5, 2, 0]])
    radius = np.arange(5) * H + 0.5 * H
    forces = np.column_stack([0.0 * radius, 9.0 * 2.0 * np.pi * radius * H, 0.0 * radius])
    load = along_outline((QUAD, pile), beside(radius, -0.05), forces, H, rings=True)
    base = load.place[:, 1] < 1e-9
    assert load.place[:, 0].min() > 0.0
    assert load.pressure[base & (load.place[:, 0] > 2.0 * H)] == pytest.approx(9.0, rel=0.12)
    ring = 2.0 * np.pi * load.place[base, 0] * 0.5 * H
    assert (ring * load.pressure[base]).sum() == pytest.approx(forces[:, 1].sum(), rel=1e-12)


def test_force_along_an_axis_keeps_its_sum():
    corners = np.array([[0.0, 0.0, 0.0], [0.2, 0.2, 1.0]])
    forces = np.random.default_rng(3).normal(size=(20, 3))
    places = np.random.default_rng(4).uniform(-0.05, 1.05, size=(20, 3))
    load = along_axis(corners, 2, places, forces, H)
    step = np.diff(load.along)[0]
    assert load.normal is None and load.pressure is None
    inside = (places[:, 2] > 0.0) & (places[:, 2] < 1.0)
    assert inside.any() and step * load.force.sum(axis=0) == pytest.approx(forces.sum(axis=0), rel=1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_file_tells_what_a_floor_bears(tmp_path, dimension):
    """The weight of a block, evenly; in space along an axis, for each length."""
    up = np.eye(dimension)[-1]
    sides = [0.4] * (dimension - 1)
    soil = {"model": "elastic", "density": 2000.0, "bulk_modulus": 1e6, "shear_modulus": 6e5}
    scene = {
        "dimension": dimension, "spacing": H, "gravity": (-10.0 * up).tolist(), "materials": {"soil": soil},
        "bodies": [{"name": "block", "material": "soil",
                    "shape": {"type": "box", "lower": [0.0] * dimension, "upper": [*sides, 0.3]}}],
        "contacts": [{"type": "box", "name": "floor", "friction": 0.0, "lower": [-0.1] * (dimension - 1) + [-0.2],
                      "upper": [0.5] * (dimension - 1) + [0.0]}],
        "boundaries": {"sides": {"where": {"body": "block"}, "fix": list("xy"[: dimension - 1])}},
        "stages": [{"name": "rest", "type": "relax", "tolerance": 1e-6, "boundaries": ["sides"]}],
        "output": {"fields": ["force_on_floor"]},
    }  # fmt: skip
    file = periporo.run(scene, tmp_path / "block.vtkhdf", quiet=True)
    weight = 2000.0 * 10.0 * 0.3 * np.prod(sides)
    with periporo.open_results(file) as results:
        load = results.surface("floor", axis="x")
        assert np.diff(load.along)[0] * load.force[:, -1 if dimension == 3 else 1].sum() == pytest.approx(-weight, 1e-4)
        inside = (load.along > 0.15) & (load.along < 0.25)
        assert load.force[inside, dimension - 1] == pytest.approx(-weight / 0.4, rel=0.02)
        if dimension == 2:
            even = results.surface("floor")
            middle = (even.place[:, 1] > -1e-9) & (np.abs(even.place[:, 0] - 0.2) < 0.05)
            assert even.pressure[middle] == pytest.approx(6000.0, rel=0.02)
        with pytest.raises(ResultError, match="add it to output.fields"):
            results.surface("roof")
    table, picture = surface_run(file, "floor")
    with open(table, newline="") as rows:
        heads = next(csv.reader(rows))
    assert heads[0] == "along [m]" and ("pressure [Pa]" in heads) == (dimension == 2)
    assert picture.stat().st_size > 5000
