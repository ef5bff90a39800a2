"""Reading of result files."""

import importlib.util
import os
import subprocess
import sys

import h5py
import numpy as np
import pytest
from mpi4py import MPI

from periporo.io.output.results import ResultError, open_results
from periporo.io.output.writer import ResultWriter


def test_reads_what_was_written(tmp_path, heap):
    with open_results(heap(tmp_path / "run.h5")) as results:
        assert list(results.times) == [0, 1, 2] and list(results.steps) == [0, 10, 20]
        assert results.dimension == 2 and list(results.point_counts) == [50, 50, 50]
        assert results.fields == ("equivalent_shear_strain", "stress", "velocity")
        assert list(results.history("height")) == [0.5, 0.4, 0.3] and "time" in results.history_names
        assert results.unit("stress") == "Pa" and results.unit("height") == "m"
        assert results.components("velocity") == ("x", "y", "z")
        assert results.components("equivalent_shear_strain") == ()
        assert results.attributes["version"] == "1.2"
        assert results.configuration["gravity"] == [0.0, -9.81]
        start, end = results.positions(0), results.positions()
        assert np.allclose(end[:, 0] - start[:, 0], start[:, 1], rtol=0, atol=1e-15)
        assert np.array_equal(results.field("velocity")[:, 0], 0.5 * start[:, 1])


def test_output_by_index_and_time(tmp_path, heap):
    with open_results(heap(tmp_path / "run.h5")) as results:
        strain = [results.field("equivalent_shear_strain", k)[0] for k in (0, 1, 2, -1, -3)]
        assert strain == [0.0, 0.5, 1.0, 1.0, 0.0]
        assert results.field("equivalent_shear_strain", time=1.4)[0] == 0.5
        assert results.output(time=1.6) == 2
        assert np.array_equal(results.positions(time=0.9), results.positions(1))
        assert np.array_equal(results.ids(time=0.9), np.arange(50))
        with pytest.raises(ResultError, match=r"time 5 s is outside 0.0 ... 2.0 s"):
            results.field("stress", time=5)
        with pytest.raises(ResultError, match=r"output 3 of 3; allowed are -3 ... 2"):
            results.positions(3)


def test_profiles_are_exact_for_linear_fields_and_end_with_the_soil(tmp_path, heap):
    """At the end the block is sheared to x + y; its velocity grows with the height, its stress is the same anywhere."""
    with open_results(heap(tmp_path / "run.h5")) as results:
        distance, velocity = results.profile("velocity", [0.52, 0.03], [0.92, 0.43], count=9)
        assert distance == pytest.approx(np.linspace(0.0, 0.4 * 2**0.5, 9))
        assert velocity[:, 0] == pytest.approx(0.5 * np.linspace(0.03, 0.43, 9), rel=1e-9)
        _, stress = results.profile("stress", [0.5, 0.25], [3.0, 0.25], 0, count=26)
        soil = np.isfinite(stress[:, 0])
        assert soil.tolist() == [True] * 6 + [False] * 20
        assert stress[soil] == pytest.approx(np.tile([-3.0, 0, 0, 4.0, 0, 0], (6, 1)), abs=1e-12)
        with pytest.raises(ResultError, match="2 coordinates each, not 3"):
            results.profile("stress", [0, 0, 0], [1, 0, 0])


def test_unknown_names_are_told(tmp_path, heap):
    with open_results(heap(tmp_path / "run.h5")) as results:
        with pytest.raises(ResultError, match="no field 'pressure'.*stress, velocity"):
            results.field("pressure")
        with pytest.raises(ResultError, match="no history 'depth'.*height"):
            results.history("depth")
        with pytest.raises(ResultError, match="neither a field nor a history 'depth'"):
            results.unit("depth")


def test_wrong_files_are_told(tmp_path, heap):
    whole = heap(tmp_path / "run.h5").read_bytes()
    (tmp_path / "cut.h5").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.h5").write_text("not a result")
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["numbers"] = [1, 2, 3]
    for name, message in (("none.h5", "does not exist"), ("cut.h5", "truncated or damaged"),
                          ("text.h5", "not an HDF5 file"), ("foreign.h5", "not a result file of periporo"),
                          (".", "is not a file")):
        with pytest.raises(ResultError, match=message):
            open_results(tmp_path / name)


def test_missing_group_is_told(tmp_path, heap):
    path = heap(tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        del file["VTKHDF/Steps/PointOffsets"]
    with pytest.raises(ResultError, match="damaged"):
        open_results(path)


def test_file_without_output(tmp_path):
    with ResultWriter(tmp_path / "run.h5", MPI.COMM_SELF, dimension=3, fields={}) as writer:
        writer.flush()
        with open_results(tmp_path / "run.h5") as results:
            assert len(results) == 0 and results.configuration == {}
            with pytest.raises(ResultError, match="no output yet"):
                results.positions()


def test_a_reader_sees_the_run_as_it_was_when_opened(tmp_path):
    with ResultWriter(tmp_path / "run.h5", MPI.COMM_SELF, dimension=2, fields={}) as writer:
        writer.write(0.0, 0, [0], [[1.0, 2.0]], {})
        writer.flush()
        with open_results(tmp_path / "run.h5") as early:
            writer.write(1.0, 1, [0, 1], [[1.0, 2.0], [3.0, 4.0]], {})
            writer.flush()
            assert len(early) == 1 and np.array_equal(early.positions(), [[1.0, 2.0, 0.0]])
        with open_results(tmp_path / "run.h5") as late:
            assert len(late) == 2 and len(late.ids()) == 2


def test_xarray(tmp_path):
    with ResultWriter(tmp_path / "run.h5", MPI.COMM_SELF, dimension=2,
                      fields={"stress": (4, "Pa"), "speed": (1, "m/s")}) as writer:
        for k, ids in enumerate(([4, 2], [2, 9])):
            ids = np.array(ids)
            writer.write(0.5 * k, k, ids, np.stack([ids, -ids], 1),
                         {"stress": np.stack([ids] * 4, 1) * 10, "speed": ids + k})
    with open_results(tmp_path / "run.h5") as results:
        if importlib.util.find_spec("xarray") is None:
            with pytest.raises(ImportError, match="pip install xarray"):
                results.to_xarray()
            return
        data = results.to_xarray()
    assert list(data.id) == [2, 4, 9] and list(data.time) == [0.0, 0.5] and data.stress.attrs["units"] == "Pa"
    assert float(data.stress.sel(id=9, time=0.5, component="zz")) == 90
    assert float(data.speed.sel(id=2, time=0.5)) == 3 and np.isnan(data.speed.sel(id=9, time=0.0))
    assert float(data.position.sel(id=4, time=0.0, axis="y")) == -4


@pytest.mark.parametrize("locking", ["TRUE", "BEST_EFFORT", ""])
def test_a_running_file_is_read_as_it_is_now_whatever_the_environment_says_of_locks(tmp_path, locking):
    """A second look in the same process sees what the first could not, and HDF5's own locks keep nobody out."""
    script = (
        "import sys, subprocess\nimport numpy as np\nfrom mpi4py import MPI\n"
        "from periporo.io.output.results import open_results\nfrom periporo.io.output.writer import ResultWriter\n"
        "path = sys.argv[1]\n"
        "with ResultWriter(path, MPI.COMM_SELF, dimension=2, fields={}) as writer:\n"
        "    writer.write(0.0, 0, [0, 1], np.zeros((2, 2)), {})\n"
        "    writer.flush()\n"
        "    early = open_results(path)\n"
        "    writer.write(1.0, 1, [0, 1], np.ones((2, 2)), {})\n"
        "    writer.flush()\n"
        "    late = open_results(path)\n"
        "    print(len(early), len(late), late.positions()[1, 0])\n"
        "    look = 'import sys; from periporo import open_results; print(len(open_results(sys.argv[1])))'\n"
        "    subprocess.run([sys.executable, '-c', look, path], check=True)\n"
    )
    environment = os.environ | {"HDF5_USE_FILE_LOCKING": locking} if locking else os.environ
    done = subprocess.run([sys.executable, "-u", "-c", script, tmp_path / "run.vtkhdf"], env=environment, timeout=100,
                          capture_output=True, text=True)  # fmt: skip
    assert done.returncode == 0 and done.stdout.split() == ["1", "2", "1.0", "2"], done.stderr
