"""The result file: order, steps, truncation, VTK's own reader, and what happens when things go wrong."""

import io
import shutil
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.numerics.cells import QUAD, joined
from periporo.errors import OutputError
from periporo.io.output import vtkhdf_layout
from periporo.io.output.lock import Lock
from periporo.io.output.mend import mend
from periporo.io.output.results import open_results
from periporo.io.output.vtkhdf import ResultFile
from periporo.io.output.vtkhdf_layout import Index
from periporo.io.output.writer import ResultWriter

FIELDS = {"stress": (4, "Pa"), "velocity": (2, "m/s"), "speed": (1, "m/s")}
COUNTS = (300, 500, 250)  # points of the outputs
HEAD = """
import sys
import numpy as np
from mpi4py import MPI
from periporo.errors import OutputError
from periporo.io.output.writer import ResultWriter
world = MPI.COMM_WORLD
"""
MPIRUN = Path(sys.executable).with_name("mpirun")


def values_at(ids, k):
    """Positions and fields of output k: simple functions of the global id, so that any mix-up shows."""
    ids = np.asarray(ids, dtype=float)
    return (np.stack([ids, -ids - k], axis=1),
            {"stress": np.arange(4.0) + 10 * ids[:, None] + k, "velocity": np.stack([ids, 2 * ids], axis=1),
             "speed": ids / 7 + k})


def write_outputs(path, comm, outputs=range(3), **options):
    with ResultWriter(path, comm, dimension=2, fields=FIELDS, history_units={"time": "s"},
                      block_rows=90, **options) as writer:
        for k in outputs:
            ids = 3 * np.random.default_rng(k).permutation(COUNTS[k])[comm.rank :: comm.size]
            for step in range(10 * k, 10 * k + 10):
                writer.append_history({"step": step, "time": 0.01 * step})
            writer.write(0.1 * k + 0.09, 10 * k + 9, ids, *values_at(ids, k))


def script(body, *arguments, ranks=1, timeout=60, **options):
    """Run Python text in a process of its own, or under mpirun."""
    command = [sys.executable, "-c", HEAD + body, *map(str, arguments)]
    if ranks > 1:
        if not MPIRUN.exists():
            pytest.skip("no mpirun beside this Python")
        command = [str(MPIRUN), "-n", str(ranks), *command]
    return subprocess.run(command, timeout=timeout, capture_output=True, text=True, **options)


def test_rows_are_in_global_id_order_and_padded(tmp_path):
    write_outputs(tmp_path / "run.h5", MPI.COMM_SELF)
    with open_results(tmp_path / "run.h5") as results:
        assert len(results) == 3
        for k, count in enumerate(COUNTS):
            ids = 3 * np.arange(count)
            position, fields = values_at(ids, k)
            assert np.array_equal(results.ids(k), ids)
            assert np.array_equal(results.positions(k), np.pad(position, ((0, 0), (0, 1))))
            assert np.array_equal(results.field("stress", k), np.pad(fields["stress"], ((0, 0), (0, 2))))
            assert np.array_equal(results.field("velocity", k), np.pad(fields["velocity"], ((0, 0), (0, 1))))
            assert np.array_equal(results.field("speed", k), fields["speed"])


def test_vtk_reads_every_step(tmp_path):
    vtk_hdf = pytest.importorskip("vtkmodules.vtkIOHDF")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    write_outputs(tmp_path / "run.h5", MPI.COMM_SELF)
    reader = vtk_hdf.vtkHDFReader()
    reader.SetFileName(str(tmp_path / "run.h5"))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == 3
    for k, count in enumerate(COUNTS):
        reader.SetStep(k)
        reader.Update()
        grid = reader.GetOutput()
        ids = 3 * np.arange(count)
        position, fields = values_at(ids, k)
        assert reader.GetTimeValue() == pytest.approx(0.1 * k + 0.09)
        assert grid.GetNumberOfPoints() == grid.GetNumberOfCells() == count
        assert grid.GetCellType(count - 1) == 1 and grid.GetCell(count - 1).GetPointId(0) == count - 1
        assert np.array_equal(vtk_to_numpy(grid.GetPoints().GetData())[:, :2], position)
        assert np.array_equal(vtk_to_numpy(grid.GetPointData().GetArray("id")), ids)
        assert np.array_equal(vtk_to_numpy(grid.GetPointData().GetArray("stress"))[:, :4], fields["stress"])
        assert np.array_equal(vtk_to_numpy(grid.GetPointData().GetArray("speed")), fields["speed"])


@pytest.mark.parametrize("ranks", [2, 3])
def test_files_are_the_same_to_the_byte_on_any_number_of_ranks(tmp_path, ranks):
    write_outputs(tmp_path / "one.h5", MPI.COMM_SELF, attributes={"version": "1"})
    (tmp_path / "alone").mkdir()
    write_outputs(tmp_path / "alone" / "run.h5", MPI.COMM_SELF, parts=5)
    body = ("import importlib.util\nspec = importlib.util.spec_from_file_location('cases', sys.argv[1])\n"
            "cases = importlib.util.module_from_spec(spec)\nspec.loader.exec_module(cases)\n"
            "cases.write_outputs(sys.argv[2], world, attributes={'version': '1'})\n"
            "cases.write_outputs(sys.argv[3], world, parts=5)\n")
    done = script(body, __file__, tmp_path / "many.h5", tmp_path / "run.h5", ranks=ranks)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "many.h5").read_bytes()
    for name in ("run.h5", *(f"run.h5.parts/000{part}.h5" for part in range(5))):
        assert (tmp_path / "alone" / name).read_bytes() == (tmp_path / name).read_bytes(), name


def test_units_components_and_attributes(tmp_path):
    text = "name: soil\n" * 20_000  # more than an HDF5 attribute holds by itself
    with ResultWriter(tmp_path / "run.h5", MPI.COMM_SELF, dimension=3, fields={"strain": (6, "-")},
                      attributes={"configuration": text, "ranks": 2}) as writer:
        writer.set_attributes({"wall_time": 1.5})
    with h5py.File(tmp_path / "run.h5") as file:
        strain = file["VTKHDF/PointData/strain"]
        assert strain.attrs["unit"] == "-"
        assert list(strain.attrs["components"]) == ["xx", "yy", "zz", "xy", "yz", "xz"]
        run = dict(file["Run"].attrs)
        assert run == {"configuration": text, "ranks": 2, "wall_time": 1.5, "dimension": 3}


def test_file_is_complete_after_each_output_while_open(tmp_path):
    path = tmp_path / "run.h5"
    with ResultWriter(path, MPI.COMM_SELF, dimension=2, fields=FIELDS) as writer:
        for k in range(3):
            ids = np.arange(COUNTS[k])
            writer.append_history({"step": k})
            writer.write(float(k), k, ids, *values_at(ids, k))
            writer.flush()
            with open_results(path) as results:
                assert len(results) == k + 1 and len(results.history("step")) == k + 1
        writer.append_history({"step": 3})
        with open_results(path) as results:
            assert list(results.history("step")) == [0, 1, 2]
        writer.flush()
        with open_results(path) as results:
            assert list(results.history("step")) == [0, 1, 2, 3]


def test_resume_drops_what_came_after_and_goes_on_alike(tmp_path):
    whole, cut = tmp_path / "whole.h5", tmp_path / "cut.h5"
    write_outputs(whole, MPI.COMM_SELF)
    write_outputs(cut, MPI.COMM_SELF)
    with ResultWriter(cut, MPI.COMM_SELF, dimension=2, fields=FIELDS, resume_step=14) as writer:
        writer.flush()
        with open_results(cut) as results:
            assert list(results.steps) == [9] and results.history("step")[-1] == 14
            assert np.array_equal(results.ids(0), 3 * np.arange(COUNTS[0]))
    write_outputs(cut, MPI.COMM_SELF, outputs=(1, 2), resume_step=9)
    with h5py.File(whole) as a, h5py.File(cut) as b:
        names = []
        a.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        assert len(names) > 20
        for name in names:
            assert np.array_equal(a[name][()], b[name][()]), name


def test_resume_refuses_other_fields_and_foreign_files(tmp_path):
    write_outputs(tmp_path / "run.h5", MPI.COMM_SELF)
    with pytest.raises(OutputError, match="holds the fields"):
        ResultWriter(tmp_path / "run.h5", MPI.COMM_SELF, dimension=2, fields={}, resume_step=9)
    with pytest.raises(OutputError, match="does not exist"):
        ResultWriter(tmp_path / "none.h5", MPI.COMM_SELF, dimension=2, fields=FIELDS, resume_step=9)
    h5py.File(tmp_path / "foreign.h5", "w").close()
    with pytest.raises(OutputError, match="not a result file"):
        ResultWriter(tmp_path / "foreign.h5", MPI.COMM_SELF, dimension=2, fields=FIELDS, resume_step=9)
    with open_results(tmp_path / "run.h5") as results:
        assert len(results) == 3  # untouched


def test_existing_file_is_kept_without_overwrite(tmp_path):
    path = tmp_path / "run.h5"
    path.write_text("mine")
    with pytest.raises(OutputError, match="--overwrite"):
        ResultWriter(path, MPI.COMM_SELF, dimension=2, fields=FIELDS)
    assert path.read_text() == "mine"
    write_outputs(path, MPI.COMM_SELF, overwrite=True)
    with open_results(path) as results:
        assert len(results) == 3


def test_wrong_use_is_refused(tmp_path):
    with pytest.raises(ValueError, match="1, 2, 3, 4, 6 or 9"):
        ResultWriter(tmp_path / "a.h5", MPI.COMM_SELF, dimension=2, fields={"odd": (5, "")})
    with pytest.raises(OutputError, match="folder .* does not exist"):
        ResultWriter(tmp_path / "no" / "a.h5", MPI.COMM_SELF, dimension=2, fields={})
    with ResultWriter(tmp_path / "a.h5", MPI.COMM_SELF, dimension=2, fields={}) as writer:
        with pytest.raises(ValueError, match="declared"):
            writer.write(0.0, 0, [0], [[0.0, 0.0]], {"velocity": [[1.0, 1.0]]})
        with pytest.raises(ValueError, match="'step'"):
            writer.append_history({"time": 0.0})
        writer.append_history({"step": 0, "time": 0.0})
        with pytest.raises(ValueError, match="same names"):
            writer.append_history({"step": 1})
    with pytest.raises(OutputError, match="id 7 occurs twice"), \
            ResultWriter(tmp_path / "b.h5", MPI.COMM_SELF, dimension=2, fields={}) as writer:
        writer.write(0.0, 0, [7, 1, 7], np.zeros((3, 2)), {})


@pytest.mark.parametrize("parts", [None, 3])
def test_an_output_without_points(tmp_path, parts):
    with ResultWriter(tmp_path / "run.h5", MPI.COMM_SELF, dimension=2, fields=FIELDS, parts=parts) as writer:
        writer.write(0.0, 0, [], *values_at([], 0))
        writer.write(1.0, 1, [4], *values_at([4], 1))
    with open_results(tmp_path / "run.h5") as results:
        assert results.field("stress", 0).shape == (0, 6) and list(results.ids(1)) == [4]


ENDLESS = """
n = 3000
ids, position = np.arange(n), np.random.default_rng(0).random((n, 2))
parts = int(sys.argv[2]) if sys.argv[2] else None
options = {"overwrite": True, "parts": parts}
with ResultWriter(sys.argv[1], world, dimension=2, fields={"stress": (4, "Pa")}, **options) as writer:
    for k in range(10**6):
        writer.append_history({"step": k, "time": 0.1 * k})
        writer.write(0.1 * k, k, ids, position + k, {"stress": np.full((n, 4), k)})
        writer.flush()
        print(k, flush=True)
"""


@pytest.mark.parametrize(("outputs", "delay", "parts"), [
    (1, 0.0, None), (3, 0.001, 2), (10, 0.002, None), (11, 0.003, 3), (30, 0.004, None),
])  # fmt: skip
def test_killed_process_leaves_a_readable_file(tmp_path, outputs, delay, parts):
    path = tmp_path / "run.h5"
    command = [sys.executable, "-c", HEAD + ENDLESS, path, str(parts or "")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        for k in range(outputs):
            assert int(process.stdout.readline()) == k
        time.sleep(delay)
    finally:
        process.kill()
        process.communicate()
    with open_results(path) as results:
        assert len(results) >= outputs
        assert len(results.history("time")) >= len(results)
        for k in range(len(results)):
            assert np.array_equal(results.ids(k), np.arange(3000))
            assert np.all(results.field("stress", k)[:, :4] == k)
            assert results.steps[k] == results.history("step")[k] == k
        last = int(results.steps[-1])
    with ResultWriter(path, MPI.COMM_SELF, dimension=2, fields={"stress": (4, "Pa")},
                      resume_step=last, parts=parts) as writer:
        writer.write(0.1, last + 1, [8], [[1.0, 2.0]], {"stress": [[1.0, 2.0, 3.0, 4.0]]})
    with open_results(path) as results:
        assert len(results) == last + 2 and np.all(results.field("stress", last)[:, :4] == last)
        assert list(results.field("stress")[0]) == [1.0, 2.0, 3.0, 4.0, 0.0, 0.0]


SQUARE = joined({0: (np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]), [(QUAD, (0, 1, 2, 3))])})
OUTPUTS = ((300, None), (300, SQUARE), (300, SQUARE), (299, SQUARE), (299, None))  # points, obstacles


def write_with_obstacles(path, **options):
    with ResultWriter(path, MPI.COMM_SELF, dimension=2, fields=FIELDS, obstacles=True, **options) as writer:
        for k, (count, cells) in enumerate(OUTPUTS):
            writer.append_history({"step": k})
            writer.write(float(k), k, np.arange(count), *values_at(np.arange(count), k), cells)


def seen_by_vtk(path, outputs=OUTPUTS):
    """Check what VTK's reader makes of the file; the number of outputs."""
    vtk_hdf = pytest.importorskip("vtkmodules.vtkIOHDF")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline

    reader = vtk_hdf.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    times = times or [0.0] * reader.GetNumberOfSteps()  # a single output comes without a time
    for k, (time_, (count, cells)) in enumerate(zip(times, outputs, strict=False)):
        reader.UpdateTimeStep(time_)
        parts = reader.GetOutputDataObject(0)
        soil, obstacles = (parts.GetPartition(0), parts.GetPartition(1)) if hasattr(parts, "GetPartition") else (
            parts, parts)  # up to VTK 9.4 the parts are merged
        extra = 0 if cells is None else 4
        assert soil.GetNumberOfPoints() == count + (extra if soil is obstacles else 0)
        position, fields = values_at(np.arange(count), k)
        assert np.array_equal(vtk_to_numpy(soil.GetPoints().GetData())[:count, :2], position)
        assert np.array_equal(vtk_to_numpy(soil.GetPointData().GetArray("speed"))[:count], fields["speed"])
        if cells is not None:
            last = obstacles.GetCell(obstacles.GetNumberOfCells() - 1)
            assert last.GetCellType() == 9 and obstacles.GetPoint(last.GetPointId(2)) == (1.0, 1.0, 0.0)
            assert np.isnan(vtk_to_numpy(obstacles.GetPointData().GetArray("stress"))[-4:]).all()
            assert list(vtk_to_numpy(obstacles.GetPointData().GetArray("id"))[-4:]) == [-1] * 4
    return len(times)


@pytest.mark.parametrize("parts", [None, 2])
def test_obstacles_follow_the_points(tmp_path, parts):
    write_with_obstacles(tmp_path / "run.vtkhdf", parts=parts)
    assert seen_by_vtk(tmp_path / "run.vtkhdf") == len(OUTPUTS)
    with open_results(tmp_path / "run.vtkhdf") as results:
        for k, (count, _) in enumerate(OUTPUTS):
            position, fields = values_at(np.arange(count), k)
            assert np.array_equal(results.ids(k), np.arange(count))
            assert np.array_equal(results.positions(k)[:, :2], position)
            assert np.array_equal(results.field("speed", k), fields["speed"])
            assert [len(corners) for _, _, corners in results.obstacles(k)] == ([] if OUTPUTS[k][1] is None else [4])
    cut = tmp_path / "cut" / "run.vtkhdf"
    shutil.copytree(tmp_path, cut.parent)
    options = {"obstacles": True, "resume_step": 1, "parts": parts}
    with ResultWriter(cut, MPI.COMM_SELF, dimension=2, fields=FIELDS, **options) as writer:
        for k, (count, cells) in enumerate(OUTPUTS[2:], 2):
            writer.append_history({"step": k})
            writer.write(float(k), k, np.arange(count), *values_at(np.arange(count), k), cells)
    assert same_datasets(tmp_path / "run.vtkhdf", cut) > 20


def test_obstacles_that_outputs_share_outlast_a_resume(tmp_path):
    path, ids = tmp_path / "run.vtkhdf", np.arange(5)
    options = {"dimension": 2, "fields": FIELDS, "obstacles": True}
    for first, last, resume in ((0, 3, None), (2, 4, 1)):
        with ResultWriter(path, MPI.COMM_SELF, resume_step=resume, **options) as writer:
            for k in range(first, last):
                writer.write(float(k), k, ids, *values_at(ids, k), SQUARE)
    assert seen_by_vtk(path, [(5, SQUARE)] * 4) == 4
    with h5py.File(path) as file:
        assert len(file["VTKHDF/Types"]) == 5 + 1 and not file["VTKHDF/Steps/PartOffsets"][:].any()


def same_datasets(first, second):
    """Check that two files hold the same; the number of datasets."""
    with h5py.File(first) as a, h5py.File(second) as b:
        names = ["VTKHDF/Points", *(f"VTKHDF/PointData/{name}" for name in a["VTKHDF/PointData"])]  # may be linked
        a.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        for name in names:
            assert np.array_equal(a[name][()], b[name][()], equal_nan=a[name].dtype.kind == "f"), name
    return len(names)


def test_file_is_whole_at_every_flush(tmp_path, monkeypatch):
    """Also for VTK's reader, which looks at a copy of each state that was flushed."""
    path, flush = tmp_path / "run.vtkhdf", h5py.File.flush
    copies = []

    def flush_and_copy(file):
        flush(file)
        copies.append(tmp_path / f"copy_{len(copies)}.vtkhdf")
        shutil.copy(path, copies[-1])

    monkeypatch.setattr(h5py.File, "flush", flush_and_copy)
    write_with_obstacles(path)
    monkeypatch.undo()
    seen = []
    for copy in copies:
        with h5py.File(copy, "r") as file:
            count = file["VTKHDF/Steps"].attrs["NSteps"]
            assert all(len(dataset) == count for dataset in Index(file).datasets) or count == 0
        seen.append(seen_by_vtk(copy) if count else 0)
    assert seen == sorted(seen) and set(seen) == set(range(len(OUTPUTS) + 1))


class Recorder(io.FileIO):
    """A file that remembers what is written to it."""

    def __init__(self, path, writes):
        super().__init__(path, "r+")
        self.writes = writes

    def write(self, piece):
        self.writes.append((self.tell(), bytes(piece)))
        return super().write(piece)


def test_file_is_readable_wherever_the_process_is_killed(tmp_path, monkeypatch):
    """After any number of the writes to the disk; `mend` then leaves nothing of an output that was cut off."""
    writes, done = [], []
    path, prefix, opened = tmp_path / "run.vtkhdf", tmp_path / "prefix.vtkhdf", h5py.File

    def recorded(name, mode, libver, locking):
        assert mode == "x"
        Path(name).touch()
        return opened(Recorder(name, writes), "w", libver=libver)

    monkeypatch.setattr(vtkhdf_layout, "INDEX_ROWS", 2)
    with ResultWriter(tmp_path / "other.vtkhdf", MPI.COMM_SELF, dimension=2, fields={}) as writer:
        monkeypatch.setattr(vtkhdf_layout.h5py, "File", recorded)
        writer = ResultWriter(path, MPI.COMM_SELF, dimension=2, fields={"speed": (1, "m/s")})
        for k in range(3):
            writer.append_history({"step": k})
            writer.write(float(k), k, [0, 1], [[k, 0.0], [k, 1.0]], {"speed": [k, k]})
            writer.flush()
            done.append(len(writes))
        writer.close()
        monkeypatch.undo()

    def check(name, number):
        with open_results(name) as results:
            assert len(results) >= sum(number >= end for end in done)
            for k in range(len(results)):
                assert list(results.field("speed", k)) == [k, k] and results.positions(k)[1, 0] == k

    image = bytearray(path.stat().st_size + 1_000_000)  # behind it is what was reserved
    mended = 0
    for number, (start, piece) in enumerate(writes, 1):
        image[start : start + len(piece)] = piece
        if number < done[0]:
            continue
        prefix.write_bytes(image)
        check(prefix, number)
        if number % 6 == 0 and mend(prefix) is not None:
            check(prefix, number)
            assert mend(prefix) is None
            mended += 1
    assert mended > 3


def test_info_mends(tmp_path, heap, call):
    path = heap(tmp_path / "run.vtkhdf")
    whole = path.read_bytes()
    status, out, _ = call("info", path)
    assert status == 0 and "cut off" not in out and path.read_bytes() == whole
    with h5py.File(path, "r+") as file:
        file["VTKHDF/Steps/Values"].resize(4, axis=0)
        file["VTKHDF/Points"].resize(170, axis=0)
    with Lock(path):
        assert "an output is being written (process" in call("info", path)[1]
    status, out, _ = call("info", path)
    assert status == 0 and "outputs: 3" in out and "cut off while it was written; what there was of it has been" in out
    assert "cut off" not in call("info", path)[1]
    assert same_datasets(path, heap(tmp_path / "again.vtkhdf")) > 10


def test_an_output_of_many_blocks(tmp_path):
    """More rows than the writer gathers, or makes of the topology, at once."""
    n, path = 600_001, tmp_path / "run.h5"
    ids = np.arange(n)[::-1]
    with ResultWriter(path, MPI.COMM_SELF, dimension=2, fields={}) as writer:
        for k in range(2):
            writer.write(float(k), k, ids, np.stack([ids, -ids], axis=1), {})
    with h5py.File(path) as file:
        grid = file["VTKHDF"]
        assert np.array_equal(grid["Connectivity"], np.arange(n))
        assert np.array_equal(grid["Offsets"], np.arange(n + 1))  # both outputs have the same cells
        assert np.array_equal(grid["Types"], np.ones(n))
        assert np.array_equal(grid["PointData/id"], np.tile(np.arange(n), 2))
        assert np.array_equal(grid["Points"][:, 1], np.tile(-np.arange(n), 2))


FULL_DISK = """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))
n = 3000
ids = np.arange(n)[world.rank :: world.size]
try:
    parts = int(sys.argv[2]) if sys.argv[2] else None
    with ResultWriter(sys.argv[1], world, dimension=2, fields={"stress": (4, "Pa")}, parts=parts) as writer:
        for k in range(1000):
            writer.append_history({"step": k})
            writer.write(0.1 * k, k, ids, np.zeros((len(ids), 2)), {"stress": np.full((len(ids), 4), k)})
except OutputError as error:
    print(f"rank {world.rank} output {k}: {error}\\n", end="", flush=True)
"""


@pytest.mark.parametrize(("ranks", "parts"), [(1, None), (2, None), (2, 3)])
def test_full_disk_is_an_error_on_all_ranks_and_the_file_stays_whole(tmp_path, ranks, parts):
    path = tmp_path / "run.h5"
    done = script(FULL_DISK, path, parts or "", ranks=ranks)
    assert done.returncode == 0, done.stderr
    for rank in range(ranks):
        assert f"rank {rank} output" in done.stdout
    assert done.stdout.count(f"cannot write {path}") == ranks and "File too large" in done.stdout
    with open_results(path) as results:
        assert len(results) > 1
        for k in range(len(results)):
            assert np.all(results.field("stress", k)[:, :4] == k)


def test_reserved_space_is_given_back(tmp_path):
    path = tmp_path / "run.h5"
    write_outputs(path, MPI.COMM_SELF)
    with h5py.File(path) as file:
        stored = []
        file.visititems(lambda _, item: stored.append(item.id.get_storage_size())
                        if isinstance(item, h5py.Dataset) else None)
    assert path.stat().st_size < sum(stored) + 150_000


def test_unwritable_folder_is_a_clear_error():
    if not Path("/proc").is_dir():
        pytest.skip("no folder here in which not even root may write")
    with pytest.raises(OutputError, match="cannot write /proc/run.h5"):
        ResultWriter("/proc/run.h5", MPI.COMM_SELF, dimension=2, fields={})


def test_failure_on_opening_reaches_all_ranks(tmp_path):
    (tmp_path / "run.h5").write_text("mine")
    body = ("try:\n    ResultWriter(sys.argv[1], world, dimension=2, fields={})\n"
            "except OutputError as error:\n    print(f'rank {world.rank}: {error}\\n', end='', flush=True)\n")
    done = script(body, tmp_path / "run.h5", ranks=2)
    assert done.returncode == 0, done.stderr
    assert "rank 0: " in done.stdout and "rank 1: " in done.stdout
    assert done.stdout.count("exists; use --overwrite") == 2


def test_result_file_by_itself(tmp_path):
    """What the writer does on rank 0, without MPI."""
    file = ResultFile(tmp_path / "run.h5", 2, {}, history_units={}, overwrite=False, resume_step=None)
    file.begin_output(2)
    file.put_rows("PointData/id", 0, np.array([[3], [5]]))
    file.put_rows("Points", 0, np.array([[1.0, 2.0], [3.0, 4.0]]))
    file.finish_output(0.5, 7)
    file.put_history([{"step": 7, "height": 2.0}])
    file.put_attributes({"ranks": 1})
    file.flush()
    with pytest.raises(OutputError, match="history row"):
        file.put_history([{"step": 8}])
    file.close()
    with open_results(tmp_path / "run.h5") as results:
        assert list(results.ids()) == [3, 5] and results.history("height") == [2.0]
        assert np.array_equal(results.positions(), [[1, 2, 0], [3, 4, 0]])
