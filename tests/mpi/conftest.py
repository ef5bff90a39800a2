"""What tests of several ranks share: programs of this folder, results bit by bit, and what runs in folders say."""

import contextlib
import importlib
import io
import re
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def launch(mpirun):
    """The function that runs a program of this folder on a number of ranks; one is this process: it has its kernels."""

    def run(ranks, name, *words, folder, timeout=300):
        if ranks > 1:
            return mpirun(ranks, HERE / f"{name}.py", *words, folder=folder, timeout=timeout)
        if str(HERE) not in sys.path:  # programs import each other
            sys.path.append(str(HERE))
        out, error = io.StringIO(), io.StringIO()
        with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
            status = importlib.import_module(name).main([str(word) for word in words])
        return subprocess.CompletedProcess(name, status, out.getvalue(), error.getvalue())

    return run


def _datasets(path):
    """All datasets of an HDF5 file by name."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
        for name in file.get("VTKHDF/PointData", ()):  # behind a link where results are in parts
            found[f"VTKHDF/PointData/{name}"] = file["VTKHDF/PointData"][name][()]
        found |= {"VTKHDF/Points": file["VTKHDF/Points"][()]} if "VTKHDF" in file else {}
        return found


def _assert_same_bits(one, other):
    """The same datasets, of the same types, to the last bit."""
    assert one.keys() == other.keys()
    for name, a in one.items():
        b = other[name]
        assert a.dtype == b.dtype and a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f"), name


def _by_folder(text):
    """What the runs of folders.py have said, by the name of their folder."""
    parts = re.split(r"^== (.*)\n", text, flags=re.M)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


@pytest.fixture(scope="session")
def datasets():
    """The function that reads all datasets of an HDF5 file."""
    return _datasets


@pytest.fixture(scope="session")
def assert_same_bits():
    """The function that compares datasets."""
    return _assert_same_bits


@pytest.fixture(scope="session")
def by_folder():
    """The function that divides what folders.py has printed."""
    return _by_folder
