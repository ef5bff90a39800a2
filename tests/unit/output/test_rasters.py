"""Rasters of a result: what points hand to cells is all of their volume, and is seen where and when it was."""

import argparse

import numpy as np
import pytest

from periporo.io.geometry.rasters import read_raster
from periporo.io.output import rasters
from periporo.io.output.rasters import Grid, rasters_of, write_raster
from periporo.io.output.results import ResultError, open_results
from periporo.io.schema.ground import HeightFile


def grid(cell, counts=(40, 40)):
    return Grid(np.array([-1.0, -1.0]), np.array(cell), counts)


@pytest.mark.parametrize("cell", [(0.1, 0.1), (0.07, 0.3), (0.033, 0.41)])
def test_a_point_hands_all_of_its_volume_to_the_cells_it_covers(cell):
    rng = np.random.default_rng(2)
    place, amount = rng.uniform(-0.4, 0.2, (50, 2)), rng.uniform(1.0, 2.0, 50)
    total = grid(cell).spread(place, amount, 0.1)
    assert total.sum() == pytest.approx(amount.sum(), rel=1e-12)
    row, column = np.indices(total.shape)
    for axis, index in ((0, column), (1, row)):
        middle = -1.0 + (index + 0.5) * cell[axis]
        off = (total * middle).sum() / total.sum() - np.average(place[:, axis], weights=amount)
        assert abs(off) < 0.5 * cell[axis]


def test_depth_is_volume_over_area_and_arrival_the_first_output(tmp_path, heap):
    """The block of `heap`: 10 x 4 columns of 5 points .1 m apart, sheared to x + t z / 2, at 0, 1 and 2 s."""
    with open_results(heap(tmp_path / "run.h5", dimension=3)) as results:
        over = Grid.around(results, 0.1)
        made = rasters_of(results, over)
        assert (over.corner <= results.positions(0)[:, :2].min(axis=0)).all()
    first = int(round(-over.corner[0] / 0.1))
    arrival = made["arrival"][over.shape[0] // 2, first : first + 14]
    assert arrival[:10] == pytest.approx(0.0) and arrival[10] == 1.0 and arrival[13] == 2.0
    still = made["largest_depth"][over.shape[0] // 2, first : first + 10]
    assert still[3:7] == pytest.approx(0.5)
    assert np.nansum(made["depth"]) * 0.1**2 == pytest.approx(0.2, rel=0.02)  # the volume, but for thin rims
    assert np.nanmax(made["largest_speed"]) == pytest.approx(0.5 * 0.45)


@pytest.mark.parametrize("cell", [(0.25, 0.25), (0.25, 0.5)])
def test_what_is_written_is_read_as_it_was(tmp_path, cell):
    values = np.arange(12.0).reshape(3, 4)
    values[1, 2] = np.nan
    over = Grid(np.array([500_000.125, 4_000_000.5]), np.array(cell), (3, 4))
    for name in ("a.asc", "a.tif"):
        if name == "a.tif":
            pytest.importorskip("rasterio")
        write_raster(tmp_path / name, over, values)
        back = read_raster(HeightFile(file=str(tmp_path / name)))
        assert np.array_equal(back.level, values, equal_nan=True)
        again = Grid.of_raster(back)
        assert again.corner == pytest.approx(over.corner, abs=1e-9) and again.cell == pytest.approx(over.cell)


def test_the_word_raster(tmp_path, heap, capsys):
    heap(tmp_path / "run.h5", dimension=3)
    parser = argparse.ArgumentParser()
    rasters.add_arguments(parser)
    assert rasters.run(parser.parse_args([str(tmp_path / "run.h5"), "--cell", "0.2", "-o", str(tmp_path / "out")])) == 0
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["run_arrival.asc", "run_depth.asc", "run_largest_depth.asc", "run_largest_speed.asc"]
    assert "largest speed over all outputs" in capsys.readouterr().out
    with open_results(heap(tmp_path / "flat.h5")) as results, pytest.raises(ResultError, match="2 dimensions"):
        rasters_of(results, grid((0.1, 0.1)))
