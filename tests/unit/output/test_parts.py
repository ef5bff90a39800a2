"""Results in part files: what is missing or damaged is told by name, and they can be made one file."""

import h5py
import numpy as np
import pytest
from mpi4py import MPI

from periporo.errors import OutputError
from periporo.io.output.compare import compare_results
from periporo.io.output.parts import part_of
from periporo.io.output.results import ResultError, open_results
from periporo.io.output.writer import ResultWriter

PARTS = 4
FIELDS = {"velocity": (2, "m/s"), "stress": (4, "Pa"), "equivalent_shear_strain": (1, "-")}


@pytest.fixture
def divided(heap, tmp_path):
    """A small result file in parts."""
    return heap(tmp_path / "run.vtkhdf", parts=PARTS)


def truncated(part):
    part.write_bytes(part.read_bytes()[:5000])


def shortened(part):
    with h5py.File(part, "r+") as file:
        file["PointData/stress"].resize(1, axis=0)


def test_parts_read_as_the_file_they_are_joined_to(divided, heap, tmp_path):
    whole = heap(tmp_path / "whole.vtkhdf")
    with open_results(whole) as a, open_results(divided) as b:
        assert all(difference.equal for difference in compare_results(a, b))
        assert b.unit("stress") == "Pa" and b.components("velocity") == ("x", "y", "z") and a.fields == b.fields
    with h5py.File(whole) as a, h5py.File(divided) as b:  # other programs
        for name in ("Points", "PointData/id", "PointData/stress"):
            assert np.array_equal(a["VTKHDF"][name][()], b["VTKHDF"][name][()])
        joined = b["VTKHDF/PointData/stress"]
        assert len(joined.virtual_sources()) == PARTS  # outputs of one division are one block of each part
        assert joined.attrs["unit"] == "Pa"
    rows = [len(h5py.File(part_of(divided, part))["Points"]) for part in range(PARTS)]
    assert sum(rows) == 3 * 50 and max(rows) <= 3 * 13


def test_vtk_reads_the_outputs_of_parts_as_those_of_one_file(divided):
    hdf = pytest.importorskip("vtkmodules.vtkIOHDF")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    reader = hdf.vtkHDFReader()
    reader.SetFileName(str(divided))
    reader.UpdateInformation()
    with open_results(divided) as results:
        assert reader.GetNumberOfSteps() == len(results) == 3
        for k in range(3):
            reader.SetStep(k)
            reader.Update()
            grid = reader.GetOutput()
            assert np.array_equal(vtk_to_numpy(grid.GetPoints().GetData()), results.positions(k))
            assert np.array_equal(vtk_to_numpy(grid.GetPointData().GetArray("stress")), results.field("stress", step=k))


@pytest.mark.parametrize(("spoil", "said"), [
    (lambda part: part.unlink(), "0002.h5 is missing"), (truncated, "0002.h5 is damaged"),
    (shortened, "0002.h5 is damaged"),
])  # fmt: skip
def test_a_missing_or_damaged_part_is_told_by_name(divided, call, spoil, said):
    spoil(part_of(divided, 2))
    with pytest.raises(ResultError, match=rf"of the parts in .*run.vtkhdf.parts {said}$"):
        open_results(divided)
    for word in ("info", "plot", "export"):
        status, _, error = call(word, divided)
        assert status == 2 and said in error and "Traceback" not in error
    with pytest.raises(OutputError, match=f"cannot resume .*{said}"):
        ResultWriter(divided, MPI.COMM_SELF, dimension=2, fields=FIELDS, resume_step=20, parts=PARTS)


def test_a_lost_index_is_told(divided):
    (divided.with_name("run.vtkhdf.parts") / "index.h5").unlink()
    with pytest.raises(ResultError, match=r"index.h5 is missing"):
        open_results(divided)


def test_merge_makes_the_file_that_a_run_without_parts_writes(divided, heap, tmp_path, call):
    whole = heap(tmp_path / "whole.vtkhdf")
    assert call("merge", divided, tmp_path / "merged.vtkhdf")[0] == 0
    with open_results(whole) as a, open_results(tmp_path / "merged.vtkhdf") as b:
        assert all(difference.equal for difference in compare_results(a, b))
        assert a.attributes == b.attributes
    with h5py.File(whole) as a, h5py.File(tmp_path / "merged.vtkhdf") as b:
        for name in a["VTKHDF/Steps"]:
            if isinstance(a["VTKHDF/Steps"][name], h5py.Dataset):
                assert np.array_equal(a["VTKHDF/Steps"][name][()], b["VTKHDF/Steps"][name][()]), name
    status, _, error = call("merge", divided, tmp_path / "merged.vtkhdf")
    assert status == 2 and "exists; use --overwrite" in error
    assert call("merge", divided, divided)[0] == 2


def test_info_tells_of_parts_and_mends_them(divided, call):
    with h5py.File(part_of(divided, 1), "r+") as file:
        rows = len(file["Points"])
        file["Points"].resize(rows + 7, axis=0)
    status, out, _ = call("info", divided)
    assert status == 0 and "in 4 parts" in out and "what there was of it has been removed" in out
    assert len(h5py.File(part_of(divided, 1))["Points"]) == rows and "removed" not in call("info", divided)[1]


def test_parts_go_with_the_file_that_is_replaced(divided, heap):
    heap(divided, overwrite=True, parts=2)
    assert sorted(p.name for p in divided.with_name("run.vtkhdf.parts").iterdir()) == ["0000.h5", "0001.h5", "index.h5"]
    heap(divided, overwrite=True)
    assert not divided.with_name("run.vtkhdf.parts").exists()


def test_a_run_goes_on_in_as_many_parts(divided):
    for parts in (None, 3):
        with pytest.raises(OutputError, match="it is in 4 parts, and the scene asks for another number"):
            ResultWriter(divided, MPI.COMM_SELF, dimension=2, fields=FIELDS, resume_step=10, parts=parts)
    with ResultWriter(divided, MPI.COMM_SELF, dimension=2, fields=FIELDS, resume_step=10, parts=PARTS) as writer:
        writer.rewind(0)
        values = {name: np.full((8, columns), 1.0) for name, (columns, _) in FIELDS.items()}
        writer.write(1.0, 10, np.arange(8) * 5, np.zeros((8, 2)), values)  # the others have left
    with open_results(divided) as results:
        assert list(results.steps) == [0, 10] and list(results.ids(1)) == list(range(0, 40, 5))
        assert len(results.ids(0)) == 50 and (results.field("stress", 1)[:, :4] == 1.0).all()
