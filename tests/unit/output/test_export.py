"""Export to VTU and CSV, comparison and summary."""

import argparse
import csv

import h5py
import numpy as np
import pytest

from periporo.io.output import compare, export, info
from periporo.io.output.results import ResultError, open_results


def call(module, *words):
    parser = argparse.ArgumentParser()
    module.add_arguments(parser)
    return module.run(parser.parse_args([str(word) for word in words]))


def test_vtk_reads_the_vtu_files(tmp_path, heap):
    vtk_xml = pytest.importorskip("vtkmodules.vtkIOXML")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    with open_results(heap(tmp_path / "run.h5", dimension=3)) as results:
        table = export.export_vtu(results, tmp_path / "vtu")
        assert table == tmp_path / "vtu" / "run.pvd"
        assert table.read_text().count('timestep="2.0" part="0" file="run_0002.vtu"') == 1
        for k in range(3):
            reader = vtk_xml.vtkXMLUnstructuredGridReader()
            reader.SetFileName(str(tmp_path / "vtu" / f"run_{k:04d}.vtu"))
            reader.Update()
            grid = reader.GetOutput()
            assert grid.GetNumberOfCells() == grid.GetNumberOfPoints() == 200
            assert grid.GetCellType(199) == 1 and grid.GetCell(199).GetPointId(0) == 199
            assert np.array_equal(vtk_to_numpy(grid.GetPoints().GetData()), results.positions(k))
            assert np.array_equal(vtk_to_numpy(grid.GetPointData().GetArray("id")), results.ids(k))
            for name in results.fields:
                array = vtk_to_numpy(grid.GetPointData().GetArray(name))
                assert np.array_equal(array, results.field(name, k)), name


def test_histories_keep_all_digits(tmp_path, heap):
    with open_results(heap(tmp_path / "run.h5")) as results:
        export.export_histories_csv(results, tmp_path / "h.csv")
        with open(tmp_path / "h.csv", newline="") as file:
            head, *rows = csv.reader(file)
        assert head[:2] == ["step", "time [s]"] and "height [m]" in head
        for column, name in enumerate(head):
            values = [float(row[column]) for row in rows]
            assert values == list(results.history(name.split(" [")[0]))
    with open_results(heap(tmp_path / "bare.h5", histories=False)) as results, \
            pytest.raises(ResultError, match="no histories"):
        export.export_histories_csv(results, tmp_path / "none.csv")


def test_export_command(tmp_path, heap, capsys):
    heap(tmp_path / "run.h5")
    assert call(export, tmp_path / "run.h5") == 0
    written = {file.name for file in (tmp_path / "run_export").iterdir()}
    assert written == {"run.pvd", "run_0000.vtu", "run_0001.vtu", "run_0002.vtu", "run_histories.csv"}
    assert "run.pvd" in capsys.readouterr().out


def test_compare_equal_files(tmp_path, heap, capsys):
    a, b = heap(tmp_path / "a.h5"), heap(tmp_path / "b.h5")
    assert call(compare, a, b) == 0
    assert "EQUAL" in capsys.readouterr().out


def test_compare_finds_one_changed_number(tmp_path, heap, capsys):
    a, b = heap(tmp_path / "a.h5"), heap(tmp_path / "b.h5")
    with h5py.File(b, "r+") as file:
        file["VTKHDF/PointData/stress"][60, 3] = 4.5  # output 1, point 10, was 4
    assert call(compare, a, b) == 1
    assert "DIFFERENT: stress\n" in capsys.readouterr().out
    with open_results(a) as first, open_results(b) as second:
        found = {d.name: d for d in compare.compare_results(first, second)}
    stress = found.pop("stress")
    assert (stress.absolute, stress.output) == (0.5, 1)
    assert stress.relative == pytest.approx(0.5 / 4.5, rel=1e-15)
    assert all(d.equal for d in found.values()) and "history height" in found and "positions" in found


def test_compare_takes_nan_for_equal_only_to_nan(tmp_path, heap):
    a, b, c = (heap(tmp_path / name) for name in ("a.h5", "b.h5", "c.h5"))
    for path in (a, b):
        with h5py.File(path, "r+") as file:
            file["VTKHDF/PointData/velocity"][3, 0] = np.nan
    for other, equal in ((b, True), (c, False)):
        with open_results(a) as first, open_results(other) as second:
            found = {d.name: d for d in compare.compare_results(first, second)}
        assert found["velocity"].equal is equal
    assert found["velocity"].absolute == np.inf


def test_compare_tells_of_other_shapes_and_names(tmp_path, heap):
    a = heap(tmp_path / "a.h5")
    b = heap(tmp_path / "b.h5", outputs=2, histories=False, strain=False)
    with open_results(a) as first, open_results(b) as second:
        found = {d.name: d for d in compare.compare_results(first, second)}
    assert found["times"].problem == "3 rows and 2 rows"
    assert found["field equivalent_shear_strain"].problem == f"only in {a}"
    assert found["history height"].problem == f"only in {a}"
    assert found["positions"].equal
    assert "DIFFERENT" in compare.describe(found.values())


def test_info_fits_a_screen_and_tells_the_figures(tmp_path, heap, capsys):
    heap(tmp_path / "run.h5")
    assert call(info, tmp_path / "run.h5") == 0
    text = capsys.readouterr().out
    assert len(text.splitlines()) < 45 and max(map(len, text.splitlines())) < 120
    assert "outputs: 3, time 0 ... 2 s, step 0 ... 20, points 50" in text
    assert "extent: x 0.1 ... 1.4, y 0.05 ... 0.45 m" in text
    lines = {tuple(line.split()) for line in text.splitlines()}
    assert ("stress", "xy", "4", "4", "Pa") in lines
    assert ("height", "0.5", "0.3", "m") in lines
    assert ("version", "1.2") in lines
    with open_results(tmp_path / "run.h5") as results:
        assert info.short_attributes(results) == {"version": "1.2"}
        assert info.describe_results(results) == text.rstrip("\n")
