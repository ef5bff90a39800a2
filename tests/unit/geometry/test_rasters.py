"""Rasters: what files mean is read as they say, or asked for; what cannot be meant is refused with the place."""

import numpy as np
import pytest
from pydantic import ValidationError

from periporo.io.geometry.rasters import GroundFileError, read_raster
from periporo.io.schema.ground import GroundFile, HeightFile

LEVEL = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])  # rows from the south
ASCII = "ncols 3\nnrows 2\n{}\nNODATA_value -99\n4 5 6\n1 2 {}\n"


def written(path, header, last="3"):
    path.write_text(ASCII.format(header, last))
    return path


def read(path, **keys):
    return read_raster(HeightFile(file=str(path), **keys))


@pytest.mark.parametrize("name, corner", [("xllcorner 100\nYLLCORNER 200", (105.0, 204.0)),
                                          ("xllcenter 100\nyllcenter 200", (100.0, 200.0))])
def test_esri_grids_tell_where_their_values_stand(tmp_path, name, corner):
    raster = read(written(tmp_path / "a.asc", f"{name}\ndx 10\ndy 8"))
    assert raster.corner == pytest.approx(corner) and raster.cell == pytest.approx([10.0, 8.0])
    assert np.array_equal(raster.level, LEVEL) and raster.north_first
    at = raster.corner + [12.0, 4.0]
    assert raster.at(np.array([at])) == pytest.approx([2.0 + 0.2 + 0.5 * 3.0])  # a plane: x + 3 y per cell
    assert raster.row_and_column(raster.corner) == "row 2, column 1"


def test_what_stands_for_no_value_is_none(tmp_path):
    raster = read(written(tmp_path / "a.asc", "xllcorner 0\nyllcorner 0\ncellsize 10", "-99"))
    assert np.isnan(raster.level[0, 2]) and np.isfinite(raster.level).sum() == 5
    assert np.isnan(raster.at(np.array([[24.0, 6.0]]))) and np.isfinite(raster.at(np.array([[6.0, 9.0]])))
    assert "1 without value" in raster.describe()


@pytest.mark.parametrize("first_row", ["north", "south"])
@pytest.mark.parametrize("registration, corner", [("centre", (6.0, 9.0)), ("corner", (1.0, 5.0))])
def test_arrays_mean_what_the_scene_says(tmp_path, first_row, registration, corner):
    np.save(tmp_path / "a.npy", LEVEL if first_row == "south" else LEVEL[::-1])
    raster = read(tmp_path / "a.npy", corner=(1.0, 5.0), cell=(10.0, 8.0), first_row=first_row,
                  registration=registration, nodata=6.0)
    assert raster.corner == pytest.approx(corner)
    assert np.array_equal(raster.level[:, :2], LEVEL[:, :2]) and np.isnan(raster.level[1, 2])


def test_geotiff_means_the_same_as_the_esri_grid(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    transform = rasterio.transform.from_origin(100.0, 216.0, 10.0, 8.0)
    options = {"driver": "GTiff", "width": 3, "height": 2, "count": 1, "dtype": "float64", "transform": transform}
    for name, crs in (("a.tif", "EPSG:32616"), ("b.tif", "EPSG:4326"), ("c.tif", "EPSG:2274")):
        with rasterio.open(tmp_path / name, "w", crs=crs, nodata=6.0, **options) as file:
            file.write(LEVEL[::-1], 1)
    raster = read(tmp_path / "a.tif")
    assert raster.corner == pytest.approx([105.0, 204.0]) and raster.cell == pytest.approx([10.0, 8.0])
    assert np.array_equal(raster.level[0], LEVEL[0]) and np.isnan(raster.level[1, 2])
    with pytest.raises(GroundFileError, match="degrees"):
        read(tmp_path / "b.tif")
    with pytest.raises(GroundFileError, match="foot"):
        read(tmp_path / "c.tif")
    with rasterio.open(tmp_path / "d.tif", "w", **options | {"count": 3}):
        pass
    with pytest.raises(GroundFileError, match="it has 3 bands"):
        read(tmp_path / "d.tif")


def test_degrees_are_known_by_their_slopes_or_by_what_lies_beside(tmp_path):
    header = "xllcorner -84.4\nyllcorner 36.4\ncellsize 0.000833"
    with pytest.raises(GroundFileError, match=r"mean slope would be 1.2e\+03.*at 36.5 north .807"):
        read(written(tmp_path / "a.asc", header))
    small = written(tmp_path / "small.asc", "xllcorner 0\nyllcorner 0\ncellsize 1")
    assert read(small).level.max() == 6.0
    small.with_suffix(".prj").write_text('GEOGCS["WGS 84",DATUM[')
    small.touch()
    with pytest.raises(GroundFileError, match="project it"):
        read(written(tmp_path / "small.asc", "xllcorner 0\nyllcorner 1\ncellsize 1"))


@pytest.mark.parametrize("text, reason", [
    ("ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3 4 5", "promises 3 x 2 values, it has 5"),
    ("ncols 3\nnrows two\n", "not a number"),
    ("1 2 3\n", "no valid ncols"),
    ("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\n1 2 3 4", "no cellsize"),
    ("ncols 2\nnrows 2\ncellsize 1\n1 2 3 4", "neither xllcorner nor xllcenter"),
    ("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 x 4", "row 2, column 1 is 'x', not a number"),
    ("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2,5 3 4", "row 1, column 2 is '2,5'"),
    ("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1 2\n1 2 3 4", "says 'cellsize 1 2'; a name and one"),
    ("ncols 2\nnrows 2\nxllcenter 0\nyllcorner 0\ncellsize 1\n1 2 3 4", "which of them holds for both axes"),
    ("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\nnodata_value 0\n1 2 3 -32768",
     "row 2, column 2 is that of no"),
    ("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 inf 3 4", "row 1, column 2 is infinite"),
    ("ncols 1\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 3", "needs 2 x 2"),
])
def test_files_that_are_no_grids_are_refused(tmp_path, text, reason):
    (tmp_path / "bad.asc").write_text(text)
    with pytest.raises(GroundFileError, match=reason):
        read(tmp_path / "bad.asc")


def test_the_meaning_of_an_array_is_asked_for_and_of_a_grid_not_taken(tmp_path):
    np.save(tmp_path / "a.npy", LEVEL)
    written(tmp_path / "a.asc", "xllcorner 0\nyllcorner 0\ncellsize 1")
    with pytest.raises(ValidationError, match="say what they mean: corner, first_row, registration missing"):
        HeightFile(file=str(tmp_path / "a.npy"), cell=(1.0, 1.0))
    with pytest.raises(ValidationError, match="tells this itself; leave out first_row"):
        HeightFile(file=str(tmp_path / "a.asc"), first_row="south")
    (tmp_path / "a.stl").write_text("solid")
    with pytest.raises(ValidationError, match="unknown kind of file '.stl'"):
        HeightFile(file=str(tmp_path / "a.stl"))
    assert GroundFile(file=str(tmp_path / "a.stl")).is_mesh
