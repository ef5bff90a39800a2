"""What tests of several ranks share: results bit by bit, and what runs in several folders have said."""

import re

import h5py
import numpy as np
import pytest


def _datasets(path):
    """All datasets of an HDF5 file by name."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
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
