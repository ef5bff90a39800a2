"""Sections through results in space, and profiles, from the command line."""

import csv
import json

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.cli import main
from periporo.core.numerics import cells
from periporo.io.output.results import ResultError, open_results
from periporo.io.output.writer import ResultWriter
from periporo.io.pictures.section import cut, plot_section


def test_a_plane_cuts_faces_where_they_are():
    """A ridge z = 2 - |x|, cut askew: both lines lie in the plane and on the faces, and run from edge to edge."""
    faces = [np.array([[s * 2, -3, 0], [0, -3, 2], [0, 3, 2], [s * 2, 3, 0]], float) for s in (-1, 1)]
    normal = np.array([0.6, -0.8, 0.0])
    lines = cut(faces, np.zeros(3), normal)
    places = lines.reshape(-1, 3)
    assert np.abs(places @ normal).max() < 1e-12
    assert places[:, 2] == pytest.approx(2.0 - np.abs(places[:, 0]))
    length = np.linalg.norm(lines[:, 1, :2] - lines[:, 0, :2], axis=1).sum()
    assert length == pytest.approx(2 * 2 / 0.8)
    assert len(cut(faces, np.array([0.0, 9.0, 0.0]), np.array([0.0, 1.0, 0.0]))) == 0


@pytest.fixture
def result(tmp_path):
    """A block of 5 x 4 x 3 points whose velocity is linear, over a square of ground."""
    x = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in (5, 4, 3)), indexing="ij"), axis=-1).reshape(-1, 3)
    speed = np.column_stack([x[:, 2], np.zeros(len(x)), 0.1 * x[:, 0]])
    ground = np.array([[0, 0, 0], [5, 0, 0], [5, 4, 0], [0, 4, 0]], float), [(cells.QUAD, range(4))]
    scene = {"spacing": 1.0, "gravity": [0, 0, -9.81], "contacts": [{"type": "terrain"}]}
    path = tmp_path / "run.vtkhdf"
    with ResultWriter(path, MPI.COMM_SELF, dimension=3, fields={"velocity": (3, "m/s")},
                      attributes={"configuration": json.dumps(scene)}, obstacles=True) as writer:  # fmt: skip
        writer.write(0.5, 3, np.arange(len(x)), x, {"velocity": speed}, cells.joined({0: ground}))
    return path


def test_a_section_shows_the_layer_that_it_runs_through(result, capsys):
    assert main(["section", str(result), "--from", "0", "1.6", "--to", "5", "1.6", "--field", "velocity.x"]) == 0
    assert "run_section.png: 15 points" in capsys.readouterr().out
    assert result.with_name("run_section.png").stat().st_size > 1000
    with open_results(result) as results:
        for start, end, says in (([0, 9], [5, 9], "no point of output 0"), ([1, 1], [1, 1], "at the same place")):
            with pytest.raises(ResultError, match=says):
                plot_section(results, result.with_name("none.png"), start, end)
    assert not result.with_name("none.png").exists()


def test_a_profile_is_a_table(result):
    line = ["velocity", "--from", "2", "2", "1", "--to", "2", "2", "9", "--count", "9"]
    assert main(["profile", str(result), *line]) == 0
    with open(result.with_name("run_velocity_profile.csv"), newline="") as file:
        head, *rows = csv.reader(file)
    assert head == ["distance [m]", "velocity x [m/s]", "velocity y [m/s]", "velocity z [m/s]"]
    rows = np.array(rows, float)  # the first is in the middle of eight points
    assert rows[:2] == pytest.approx(np.array([[0, 1, 0, 0.2], [1, 2, 0, 0.2]])) and np.isnan(rows[3:, 1:]).all()


@pytest.mark.parametrize(
    "words",
    ["velocity --from 0 0 --to 1 0", "speed --from 0 0 0 --to 1 0 0", "velocity --from 0 0 0 --to 1 0 0 --count 1"],
)
def test_profiles_that_cannot_be(result, words):
    assert main(["profile", str(result), *words.split()]) == 2
    assert len(list(result.parent.iterdir())) == 1
