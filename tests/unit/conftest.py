"""What several test files share: a small result file, and the command line in process."""

import json

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core import cli
from periporo.io.output.writer import ResultWriter

ENERGIES = ("kinetic_energy", "internal_energy", "external_work", "contact_energy", "friction_dissipation",
            "damping_dissipation", "prescribed_work", "energy_residual")


def write_heap(path, *, dimension=2, outputs=3, histories=True, strain=True, configuration=True, **options):
    """A block of 10 x 5 (x 4) points, 0.1 m apart, that is sheared to x + t z/2; t = 0, 1, 2, ... s."""
    spacing = 0.1
    counts = (10, 5) if dimension == 2 else (10, 4, 5)
    grid = np.meshgrid(*((np.arange(n) + 0.5) * spacing for n in counts), indexing="ij")
    start = np.stack([axis.ravel() for axis in grid], axis=1)
    fields = {"velocity": (dimension, "m/s"), "stress": (4 if dimension == 2 else 6, "Pa")}
    fields |= {"equivalent_shear_strain": (1, "-")} if strain else {}
    scene = {"dimension": dimension, "spacing": spacing, "gravity": [0.0] * (dimension - 1) + [-9.81]}
    attributes = {"version": "1.2", "timing": "{bonds: 3.0, output: 1.0}\n"}
    attributes |= {"configuration": json.dumps(scene)} if configuration else {}
    units = {name: "J" for name in ENERGIES} | {"time": "s", "height": "m"}
    with ResultWriter(path, MPI.COMM_SELF, dimension=dimension, fields=fields, attributes=attributes,
                      history_units=units, **options) as writer:
        for k in range(outputs):
            if histories:
                energies = {name: float(10 * k + e) for e, name in enumerate(ENERGIES)}
                writer.append_history({"step": 10 * k, "time": float(k), "height": 0.5 - 0.1 * k} | energies)
            position = start.copy()
            position[:, 0] += 0.5 * k * start[:, -1]
            velocity = np.zeros_like(start)
            velocity[:, 0] = 0.5 * start[:, -1]
            stress = np.zeros((len(start), fields["stress"][0]))
            stress[:, 0], stress[:, 3] = -3.0, 4.0
            values = {"velocity": velocity, "stress": stress}
            values |= {"equivalent_shear_strain": np.full(len(start), 0.5 * k)} if strain else {}
            writer.write(float(k), 10 * k, np.arange(len(start)), position, values)
    return path


@pytest.fixture
def heap():
    """The function that writes a small result file, see `write_heap`."""
    return write_heap


@pytest.fixture
def call(tmp_path, monkeypatch, capsys):
    """The function that runs a command line in an empty folder: exit status, standard output and error."""
    monkeypatch.chdir(tmp_path)

    def run(*words):
        try:
            status = cli.main([str(w) for w in words])
        except SystemExit as stop:
            status = stop.code
        return (status, *capsys.readouterr())

    return run
