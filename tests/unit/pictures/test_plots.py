"""Pictures and movies: what is drawn where, and that the files hold it."""

import argparse
import json

import h5py
import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.numerics import cells
from periporo.io.output.results import ResultError, open_results
from periporo.io.output.writer import ResultWriter
from periporo.io.pictures import drawing, plots
from periporo.io.pictures.animation import animate_run

pytest.importorskip("matplotlib")


def pixels(path):
    from matplotlib.image import imread

    return imread(path)[:, :, :3]


def coloured(image):
    """Share of pixels that are neither white nor grey."""
    return np.mean(np.ptp(image, axis=2) > 0.1)


@pytest.mark.parametrize("dimension", [2, 3])
def test_spacing_is_configured_or_measured(tmp_path, heap, dimension):
    for configuration in (True, False):
        path = heap(tmp_path / f"{configuration}.h5", dimension=dimension, configuration=configuration)
        with open_results(path) as results:
            assert drawing.point_spacing(results) == pytest.approx(0.1, rel=1e-12)


def test_outline_of_cells():
    x, y = np.meshgrid(np.arange(4) + 0.5, np.arange(3) + 0.5)
    points = 0.2 * np.stack([x.ravel(), y.ravel()], axis=1) + [5.0, -1.0]
    segments = drawing.outline_segments(points, 0.2)
    assert len(segments) == 2 * (4 + 3)
    assert np.allclose(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1), 0.2)
    assert np.allclose(segments.min(axis=(0, 1)), [5.0, -1.0])
    assert np.allclose(segments.max(axis=(0, 1)), [5.8, -0.4])
    hollow = np.delete(points, 5, axis=0)  # one inner cell less: four edges more
    assert len(drawing.outline_segments(hollow, 0.2)) == 18


def test_colour_values(tmp_path, heap):
    with open_results(heap(tmp_path / "run.h5")) as results:
        height = results.positions(0)[:, 1]
        speed, label = drawing.colour_values(results, "velocity")
        assert np.allclose(speed, 0.5 * height, rtol=1e-15) and label == "velocity magnitude [m/s]"
        # xx = -3 and xy = 4 alone: q^2 = 3^2 + 3 * 4^2
        shear, label = drawing.colour_values(results, "stress")
        assert np.allclose(shear, np.sqrt(57), rtol=1e-14) and label == "equivalent shear stress [Pa]"
        normal, label = drawing.colour_values(results, "stress.xx")
        assert np.all(normal == -3) and label == "stress xx [Pa]"
        moved, label = drawing.colour_values(results, "displacement", 1)
        assert np.allclose(moved, 0.5 * height, rtol=1e-12) and label == "displacement magnitude [m]"
        with pytest.raises(ResultError, match="no component 'rr'.*xx, yy"):
            drawing.colour_values(results, "stress.rr")
        with pytest.raises(ResultError, match="no field 'pressure'"):
            drawing.colour_values(results, "pressure")


def test_strain_tensor_gives_its_equivalent_strain(tmp_path, heap):
    path = heap(tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        file.move("VTKHDF/PointData/stress", "VTKHDF/PointData/strain")
        file["VTKHDF/PointData/strain"][:] = [0.2, -0.1, -0.1, 0, 0, 0]  # axial, no change of volume
    with open_results(path) as results:
        assert np.allclose(drawing.colour_values(results, "strain")[0], 0.2, rtol=1e-15)


def test_default_field_and_fallback(tmp_path, heap):
    with open_results(heap(tmp_path / "a.h5")) as results:
        assert drawing.choose_field(results) == "equivalent_shear_strain"
        assert drawing.choose_field(results, "velocity") == "velocity"
    with open_results(heap(tmp_path / "b.h5", strain=False)) as results:
        assert drawing.choose_field(results) == "displacement"


def test_colour_limits_ignore_outliers():
    values = np.append(np.linspace(0, 1, 1000), [500.0, np.nan])
    low, high = drawing.colour_limits(values)
    assert low == 0 and 0.98 < high < 1.01
    assert drawing.colour_limits(np.array([-2.0, -2.0])) == (-2.5, -1.5)
    for nothing in ([np.nan], [0.0, 0.0], []):
        assert drawing.colour_limits(np.array(nothing)) == (0.0, 1.0)


def test_extent_leaves_out_points_that_flew_off(tmp_path, heap):
    path = heap(tmp_path / "run.h5", dimension=3)
    with open_results(path) as results:
        extent = drawing.extent_of(results, (0, -1))
        assert np.allclose(extent, [[0.05, 0.05, 0.05], [1.4, 0.35, 0.45]])
    with h5py.File(path, "r+") as file:
        file["VTKHDF/Points"][-1, 0] = 1e6
    with open_results(path) as results:
        far = drawing.extent_of(results, (0, -1))[1, 0]
        assert 1.4 < far < 3.0
        picture = drawing.PointPicture(results)
        picture.show(-1)
        assert picture.axes[0].get_title(loc="right") == "200 points, 1 outside the picture"


def test_picture_draws_points_at_their_place_and_size(tmp_path, heap):
    with open_results(heap(tmp_path / "run.h5")) as results:
        picture = drawing.PointPicture(results)
        picture.show(-1)
        (points,), (axes,) = picture.points, picture.axes
        assert np.array_equal(points.get_offsets(), results.positions()[:, :2])
        assert np.all(points.get_array() == 1.0)
        # a disc as large as the area of a point
        assert np.pi / 4 * points.get_widths() ** 2 == pytest.approx(0.01)
        corners = np.array([path.vertices[:4] for path in picture.squares[0].get_paths()])  # of the squares below
        assert np.allclose(corners.mean(axis=1), results.positions()[:, :2])
        assert np.ptp(corners[0], axis=0) == pytest.approx([0.104, 0.104])  # a little more, so that no seams show
        assert np.array_equal(picture.squares[0].get_array(), points.get_array())
        box = axes.get_window_extent()
        across, up = np.diff(axes.get_xlim()), np.diff(axes.get_ylim())
        assert box.width / across == pytest.approx(box.height / up, rel=1e-9)
        assert axes.get_title(loc="left") == "t = 2 s" and axes.get_xlabel() == "x [m]"
        assert picture.colour_bar.ax.get_xlabel() == "equivalent shear strain"


def test_views_of_three_dimensions_hide_what_is_behind(tmp_path, heap):
    with open_results(heap(tmp_path / "run.h5", dimension=3)) as results:
        front, top = drawing.views(results)
        assert (front.across, front.up, top.across, top.up) == (0, 2, 0, 1)
        position = results.positions()
        assert position[front.nearest_last(position)[-1], 1] == position[:, 1].min()
        assert position[top.nearest_last(position)[-1], 2] == position[:, 2].max()
        picture = drawing.PointPicture(results, "displacement")
        picture.show(-1)
        assert np.pi / 6 * picture.points[0].get_widths() ** 3 == pytest.approx(1e-3)
        assert picture.squares == (None, None)  # balls hide what is behind them
        values = drawing.colour_values(results, "displacement")[0]
        assert np.array_equal(picture.points[0].get_array(), values[front.nearest_last(position)])


@pytest.mark.parametrize("size, beside", [((1.0, 1.0, 0.5), True), ((3.0, 1.0, 1.0), False)])
def test_two_views_stand_so_that_the_picture_is_not_tall(tmp_path, heap, size, beside):
    with open_results(heap(tmp_path / "run.h5", dimension=3)) as results:
        picture = drawing.PointPicture(results, extent=np.array([np.zeros(3), size]))
        front, top = (axes.get_position() for axes in picture.axes)
        assert (front.x1 < top.x0 and front.y0 == top.y0) if beside else (front.y0 > top.y1 and front.x0 == top.x0)
        width, height = picture.figure.get_size_inches()
        assert height < 1.3 * width
        scales = [axes.get_window_extent().width / np.diff(axes.get_xlim()) for axes in picture.axes]
        assert scales[0] == pytest.approx(scales[1])


def test_run_makes_all_pictures(tmp_path, heap):
    path = heap(tmp_path / "run.h5")
    files = plots.plot_run(path)
    assert [file.name for file in files] == ["run_deposit.png", "run_histories.png", "run_energy.png"]
    for file in files:
        assert coloured(pixels(file)) > 0.002
    assert coloured(pixels(files[0])) > 0.1
    parser = argparse.ArgumentParser()
    plots.add_arguments(parser)
    words = [str(path), "--out", str(tmp_path / "out"), "--field", "velocity", "--step", "1"]
    assert plots.run(parser.parse_args(words)) == 0
    assert not np.array_equal(pixels(tmp_path / "out" / "run_velocity_0001.png"), pixels(files[0]))


def test_wet_soil_is_drawn_with_its_water(tmp_path):
    """A picture by saturation, or by pressure where pores are full, with the water table and free water."""
    x, y = np.meshgrid(0.1 * np.arange(8) + 0.05, 0.1 * np.arange(5) + 0.05)
    place = np.stack([x.ravel(), y.ravel()], axis=1)
    scene = {"dimension": 2, "spacing": 0.1, "gravity": [0.0, -9.81],
             "pore_water": {"free_water": {"level": {"times": [0.0, 2.0], "values": [0.4, 0.2]}}}}  # fmt: skip
    for name, dry, drawn in (("run", 0.8, "saturation"), ("full", 1.0, "pore_pressure")):
        path = tmp_path / f"{name}.h5"
        with ResultWriter(path, MPI.COMM_SELF, dimension=2, fields={"pore_pressure": (1, "Pa"), "saturation": (1, "1")},
                          attributes={"configuration": json.dumps(scene)}, history_units={}) as writer:  # fmt: skip
            pressure = 9810.0 * (0.27 - place[:, 1])
            values = {"pore_pressure": pressure, "saturation": np.where(pressure < 0.0, dry, 1.0)}
            writer.write(1.0, 1, np.arange(40), place, values)
        assert [file.name for file in plots.plot_run(path)] == [f"{name}_deposit.png", f"{name}_{drawn}.png"]
        with open_results(path) as results:
            picture = drawing.PointPicture(results, drawn)
            picture.show(0)
        table = np.array(picture.water["water table"].get_segments())
        assert len(table) == 7 and table[:, :, 1] == pytest.approx(0.27, abs=1e-9)
        assert np.array(picture.water["free water"].get_segments())[:, :, 1] == pytest.approx(0.3)


def test_pictures_that_the_file_has_no_data_for(tmp_path, heap):
    path = heap(tmp_path / "run.h5", histories=False, dimension=3)
    assert [file.name for file in plots.plot_run(path)] == ["run_deposit.png"]
    with open_results(path) as results:
        with pytest.raises(ResultError, match="no histories"):
            plots.plot_histories(results, tmp_path / "a.png")
        with pytest.raises(ResultError, match="no energies.*kinetic_energy"):
            plots.plot_energy(results, tmp_path / "a.png")
        with pytest.raises(ResultError, match="output 9 of 3"):
            plots.plot_run(path, tmp_path / "never", step=9)
    assert not (tmp_path / "never").exists()


def test_movie_has_a_frame_for_each_output(tmp_path, heap, monkeypatch):
    from PIL import Image

    monkeypatch.setattr("shutil.which", lambda program: None)  # as on a machine without ffmpeg
    with open_results(heap(tmp_path / "run.h5")) as results:
        file = animate_run(results, tmp_path / "movie")
    assert file == tmp_path / "movie.gif"
    with Image.open(file) as movie:
        frames = []
        for k in range(movie.n_frames):
            movie.seek(k)
            frames.append(np.asarray(movie.convert("RGB"), dtype=float))
    assert len(frames) == 3
    assert np.abs(frames[0] - frames[1]).max() > 100 and np.abs(frames[1] - frames[2]).max() > 100


def test_missing_matplotlib_is_told(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match=r"pip install 'periporo\[plot\]'"):
        drawing.require_matplotlib()


def test_obstacles_are_drawn_and_materials_have_names(tmp_path):
    """A wall, a step and a floor beside two points, of which the lower is clay."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    outlines = {0: (square[:2], [(cells.LINE, (0, 1))]), 1: (square, [(cells.QUAD, range(4))]),
                2: (square[:3], [(cells.POLY_LINE, range(3))])}  # fmt: skip
    scene = {"spacing": 0.5, "gravity": [0, -9.81], "materials": {"clay": {}, "sand": {}}, "bodies": [{"name": "all"}]}
    with ResultWriter(tmp_path / "run.vtkhdf", MPI.COMM_SELF, dimension=2, fields={"material": (1, "")},
                      attributes={"configuration": json.dumps(scene)}, obstacles=True) as writer:  # fmt: skip
        for k in range(2):
            shifted = cells.joined({n: (points + [0.25 * k, 0.0], parts) for n, (points, parts) in outlines.items()})
            writer.write(float(k), k, [0, 1], [[2.0, 0.25], [2.0, 0.75]], {"material": [0.0, 1.0]}, shifted)
    with open_results(tmp_path / "run.vtkhdf") as results:
        numbers, kinds, corners = zip(*results.obstacles(1), strict=True)
        assert numbers == (0, 1, 2) and kinds == (cells.LINE, cells.QUAD, cells.POLY_LINE)
        assert corners[1][:, :2] == pytest.approx(square + [0.25, 0.0])
        picture = drawing.PointPicture(results, "material")
        for step, shift in ((0, 0.0), (1, 0.25)):
            picture.show(step)
            areas, edges = picture.obstacles[0]
            assert [len(line) for line in edges.get_segments()] == [4, 5] and len(areas.get_paths()) == 1
            assert areas.get_paths()[0].vertices[:4] == pytest.approx(square + [shift, 0.0])
        assert [label.get_text() for label in picture.colour_bar.ax.get_xticklabels()] == ["clay", "sand"]
        assert drawing.names_of(results, "body") == ["all"] and drawing.names_of(results, "stress") == []


def test_lines_without_end_cross_the_picture_and_closed_ones_are_filled_where_they_are_solid():
    """A floor is drawn on far beyond its ends; a pile goes round clockwise, a basin the other way."""
    square = np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0], [0, 0, 0]], float)
    floor = square[[0, 3]]
    outlines = [(0, cells.LINE, floor), (1, cells.POLY_LINE, square), (2, cells.POLY_LINE, square[::-1])]
    (pile,), (line, basin) = drawing.faces_and_lines(outlines)
    assert (pile == square).all() and (basin == square[::-1]).all()
    assert line[0, 0] < -10.0 and line[-1, 0] > 10.0 and not line[:, 1:].any()


def test_soil_lies_between_points_that_are_near_each_other():
    rows = np.stack(np.meshgrid(np.arange(3.0), np.arange(3.0), indexing="ij"), axis=-1).reshape(-1, 2)
    stretched = rows * [1.4, 1.0]
    apart = np.concatenate([stretched, stretched + [5.0, 0.0]])
    corners = apart[drawing.between(apart, 1.75)]
    (ax, ay), (bx, by) = ((corners[:, k] - corners[:, 0]).T for k in (1, 2))
    assert 0.5 * np.abs(ax * by - ay * bx).sum() == pytest.approx(2 * 2.8 * 2.0)  # nothing between the two blocks
    for few in (rows[:1], rows[:2], rows[:3]):
        assert len(drawing.between(few, 1.75)) == 0


@pytest.mark.parametrize("gravity, words", [([0, -9.81], []), ([4.1, -8.9], ["gravity ", "\u279c"])])
def test_inclined_gravity_is_told(tmp_path, heap, monkeypatch, gravity, words):
    with open_results(heap(tmp_path / "run.h5")) as results:
        monkeypatch.setattr(type(results), "configuration", {"spacing": 0.1, "gravity": gravity})
        texts = drawing.PointPicture(results).axes[0].texts
        assert [text.get_text() for text in texts] == words
        assert not words or texts[1].get_rotation() == pytest.approx(np.degrees(np.arctan2(-8.9, 4.1)) % 360.0)


def test_faces_of_a_hexahedron_enclose_it():
    corners = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
    faces, lines = drawing.faces_and_lines([(0, cells.HEXAHEDRON, corners)])
    assert len(faces) == 6 and not lines
    assert sum(np.linalg.norm(np.cross(f[2] - f[0], f[3] - f[1])) / 2 for f in faces) == pytest.approx(6.0)
