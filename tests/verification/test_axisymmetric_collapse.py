"""The benchmark of collapsing cylinders with few points: stopped, resumed, measured, skipped when finished."""

import numpy as np
import pytest

from benchmarks import axisymmetric_collapse as benchmark
from benchmarks.library import runs


def test_a_small_cylinder_collapses_to_rest_and_is_not_run_again(tmp_path, capsys):
    text = benchmark.scene(1.0, 100)
    result = tmp_path / benchmark.RESULT
    assert benchmark.run(text, tmp_path, walltime=1e-3) == 0 and not runs.is_finished(result)
    assert benchmark.run(text, tmp_path) == 0 and runs.is_finished(result)
    m = benchmark.measure(result)
    assert 80 < m["points"] < 130
    assert 0.3 < m["run-out"] <= m["outermost"] < 1.6  # Lube et al. (2004): 1.24; five rows of points spread less
    assert 0.4 < m["height"] < 1.0
    assert m["kinetic"] < 1e-5 and m["time"] < 1.0
    before = result.stat().st_mtime_ns
    assert benchmark.run(text, tmp_path) == 0 and result.stat().st_mtime_ns == before
    benchmark.draw({1.0: result}, benchmark.RADIUS, tmp_path / "cylinder.png")
    assert (tmp_path / "cylinder.png").stat().st_size > 10_000
    assert benchmark.line(1.0, m).count("|") == len(benchmark.COLUMNS) + 1


def test_rings_collapse_like_the_quarter(tmp_path):
    rings = benchmark.scene(1.0, 650, rings=True)
    assert benchmark.run(rings, tmp_path) == 0
    m = benchmark.measure(tmp_path / benchmark.RESULT)
    assert m["points"] == 81 and m["kinetic"] < 1e-5
    assert 0.9 < m["run-out"] <= m["outermost"] < 1.3  # of finer rings 1.22; Lube et al. (2004): 1.24
    assert 0.55 < m["height"] < 0.8
    assert m["run-out of 95 %"] == pytest.approx(1.13, rel=0.15)  # of quarters and of finer rings
    assert m["cone"] == pytest.approx(0.693, rel=0.05)  # the limit of quarters: their coarse ones are lower


def test_the_cone_of_the_inner_soil():
    """A cone of slope .5 and height .7, which ends in a disc beyond .8, as rings and as points of a quarter."""
    r = (np.arange(2000) + 0.5) / 2000
    height = 0.7 - 0.5 * np.minimum(r, 0.8)
    assert benchmark._cone(r, 2.0 * r * height / 2000) == pytest.approx(0.7, rel=1e-5)


def test_the_parameters_of_a_variant():
    plain, changed = benchmark.scene(2.0, 42_000), benchmark.scene(2.0, 42_000, stiffer=4.0, slope=1.2)
    sand, stiff = plain["materials"]["sand"], changed["materials"]["sand"]
    assert stiff["bulk_modulus"] == 4 * sand["bulk_modulus"] and stiff["shear_modulus"] == 4 * sand["shear_modulus"]
    assert stiff["critical_state_slope"] == 1.2
    assert plain["bodies"][0]["shape"]["extrude"] == [0.0, 0.1]
    rings = benchmark.scene(2.0, 42_000, rings=True)
    assert rings["bodies"][0]["shape"]["upper"] == [0.05, 0.1] and rings["spacing"] == plain["spacing"]
    rows = 0.05 / plain["spacing"]
    assert 40_000 < 2.0 * rows**3 * 3.1416 / 4.0 < 44_000
