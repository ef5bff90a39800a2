"""The water table in a result: levels, columns, gaps, and how it is read from a file."""

import json

import numpy as np
import pytest
from mpi4py import MPI

from periporo.io.output.results import ResultError, open_results
from periporo.io.output.water_table import water_table
from periporo.io.output.writer import ResultWriter

SPACING, WEIGHT = 0.1, 9810.0


def block(*counts):
    axes = np.meshgrid(*((np.arange(n) + 0.5) * SPACING for n in counts), indexing="ij")
    place = np.stack([a.ravel() for a in axes], axis=1)
    return np.pad(place, ((0, 0), (0, 3 - len(counts))))


@pytest.mark.parametrize("counts, axis, sense", [((6, 8), 1, 1.0), ((5, 6, 8), 2, 1.0), ((8, 6), 0, -1.0)])
def test_water_at_rest_is_exact(counts, axis, sense):
    """One place in each column, at the level, in any order of the points; also above the uppermost of them."""
    place = block(*counts)
    place = place[np.random.default_rng(1).permutation(len(place))]
    columns = len(place) // counts[axis]
    for level in (0.33, 0.78) if sense > 0 else (-0.33, -0.02):
        found = water_table(place, WEIGHT * (level - sense * place[:, axis]), SPACING, axis, sense, WEIGHT)
        assert len(found) == columns and found[:, axis] == pytest.approx(sense * level, abs=1e-12)
        across = np.delete(found, axis, axis=1)
        assert np.array_equal(np.unique(across.round(9), axis=0), across.round(9))


def test_sloping_table_with_a_gap():
    """A plane of pressure sinks below the soil to one side: there is no table there; ponds end at the surface."""
    place = block(10, 5)
    found = water_table(place, WEIGHT * (0.72 - place[:, 0] - place[:, 1]), SPACING, 1, 1.0, WEIGHT)
    assert found[:, 0] == pytest.approx((np.arange(7) + 0.5) * SPACING)
    assert found[:, 1] == pytest.approx(np.minimum(0.72 - found[:, 0], 0.5))


def test_lowest_of_two_tables_counts():
    """Wet below, dry, and wet again under rain: the water table is the lower one."""
    place = block(1, 10)
    pressure = np.array([3.0, 1.0, -1.0, -2.0, -2.0, -2.0, -1.0, 1.0, 1.0, -1.0])
    assert water_table(place, pressure, SPACING, 1, 1.0, WEIGHT)[:, 1] == pytest.approx([0.2])


def test_from_a_file(tmp_path):
    """In the coordinates of the scene, by its gravity; a file without pressure says what it lacks."""
    place = block(4, 4)[:, :2]
    scene = {"dimension": 2, "spacing": SPACING, "gravity": [0.0, -9.81], "pore_water": {"water_density": 1000.0}}
    for name in ("pore_pressure", "porosity"):
        with ResultWriter(tmp_path / f"{name}.vtkhdf", MPI.COMM_SELF, dimension=2, fields={name: (1, "Pa")},
                          attributes={"configuration": json.dumps(scene)}, history_units={}) as writer:  # fmt: skip
            writer.write(0.0, 0, np.arange(16), place, {name: WEIGHT * (0.18 - place[:, 1])})
    with open_results(tmp_path / "pore_pressure.vtkhdf") as results:
        assert results.water_table()[:, 1] == pytest.approx(0.18)
    with open_results(tmp_path / "porosity.vtkhdf") as results, pytest.raises(ResultError, match="pore_pressure"):
        results.water_table()
