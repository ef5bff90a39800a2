"""Flows whose answers are known, small: what `python -m benchmarks flow` and `flow_truths` print at full size.

Bounds are one and a half times what so few points miss by, so that twice the error fails.
"""

import numpy as np
import pytest

from benchmarks import aluminium_bars, flow, flow_truths
from benchmarks.library.deposits import cells, covered_area, grown


def test_a_layer_of_sand_slides_down_a_rough_slope_as_its_friction_lets_it():
    assert flow_truths.slope(8, duration=0.2) == pytest.approx(1.0, abs=0.05)


def test_a_layer_that_flows_down_an_endless_slope_keeps_its_volumes():
    figures = flow_truths.endless(6, depths=2.0)
    assert figures["way"] == pytest.approx(1.0, abs=0.15)  # .90
    assert figures["area"] == pytest.approx(1.0, abs=0.022) and figures["volumes"] == pytest.approx(1.0, abs=0.003)
    assert 0.984 < figures["1 %"] < figures["99 %"] < 1.006 and figures["scatter"] < 0.06  # .990, 1.003, .037


def test_clay_that_is_pressed_flat_keeps_its_volumes():
    figures = flow_truths.clay(8)
    assert figures["area"] == pytest.approx(1.0, abs=0.08)
    assert 0.99 < figures["1 %"] < figures["99 %"] < 1.003  # .994, 1.0017


def test_a_dam_of_soil_without_friction_follows_ritter_and_keeps_its_area():
    figures = flow_truths.dam(10, heights=2.0)
    assert figures["area"] == pytest.approx(1.0, abs=0.004)  # 1.002
    assert abs(figures["0.4 H"]) < 0.075 and abs(figures["0.2 H"]) < 0.11  # .047, -.074


def test_a_column_falls_the_same_way_turned_and_on_a_map():
    height, rows, turn = 0.1, 10, np.radians(30.0)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    scene = flow.column(height, rows, 0.1, bulk=2.5e6)
    _, (upright,) = flow.collapse(scene, height, ())
    _, (elsewhere,) = flow.collapse(scene, height, (), 0, rotation, (500000.0, 4000000.0))
    for name in ("area", "volumes", "run-out", "height"):
        assert elsewhere[name] == pytest.approx(upright[name], rel=0.02), name


def test_a_slab_between_planes_of_symmetry_falls_as_in_plane_strain():
    plane, slab = (flow.collapse(flow.column(0.1, 10, 0.1, bulk=2.5e6, thick=n), 0.1, ())[1][0] for n in (0, 3))
    for name in ("area", "volumes", "run-out", "height"):
        assert slab[name] == pytest.approx(plane[name], rel=0.02), name


def test_a_pile_of_bars_falls_nearly_as_measured():
    """With 200 points; the table of docs/explanation/aluminium_bars.md has 800 and 3200."""
    sim, moved = aluminium_bars.collapse(0.01)
    figures = aluminium_bars.compare(sim.particles.position[: sim.particles.owned], moved, 0.01)
    assert figures["surface"] < 0.01 and figures["failure line"] < 0.04  # m: .0073, .034
    assert figures["front"] == pytest.approx(1.0, abs=0.1)  # .94


def test_area_by_the_neighbours_of_a_lattice_is_that_of_an_affine_motion():
    first = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), -1).reshape(-1, 2)
    area = grown(first, first @ np.array([[1.2, 0.3], [0.1, 0.9]]), 1.0)
    assert np.isfinite(area).sum() == 2 and area[5] == pytest.approx(1.2 * 0.9 - 0.3 * 0.1)


def test_area_by_voronoi_cells_and_by_the_outline_are_those_of_a_lattice_and_what_is_spread():
    draw = np.random.default_rng(1)
    first = np.stack(np.meshgrid(np.arange(30.0), np.arange(20.0)), -1).reshape(-1, 2) + 0.5
    spread = (first + draw.uniform(-0.3, 0.3, first.shape)) * [1.1, 1.0]
    for position, expected in ((first, 1.0), (spread, 1.1)):
        area = cells(position, 1.0)
        assert 0.5 < np.isfinite(area).mean() < 0.8
        assert np.nanmean(area) == pytest.approx(expected, rel=0.01)
        assert covered_area(position, 1.0) == pytest.approx(600.0 * expected, rel=0.015)
