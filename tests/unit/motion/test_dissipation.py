"""Plastic dissipation in the ledger."""

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene

MISES = {"model": "drucker_prager", "density": 1000.0, "bulk_modulus": 3e6, "shear_modulus": 1e6, "cohesion": 1e3,
         "friction_angle": 0.0, "dilation_angle": 0.0, "report_dissipation": True}  # fmt: skip


def sheared(scheme, material):
    """A block after simple shear to 1 %, far beyond yield at c / mu = 0.1 %."""
    scene = {
        "dimension": 2, "spacing": 0.1, "correspondence": scheme, "materials": {"soil": material},
        "bodies": [{"name": "block", "material": "soil", "shape": {"type": "box", "lower": [0, 0], "upper": [1, 1]}}],
        "time_step": {"fixed": 1e-4}, "stages": [{"name": "shear", "type": "dynamics", "duration": 1.0}],
    }  # fmt: skip
    sim = build(parse_scene(scene), MPI.COMM_SELF)
    sim.start()
    p = sim.particles
    for _ in range(100):
        p.velocity[:, 0], p.velocity[:, 1] = p.position[:, 1], 0.0
        p.previous_velocity[:] = p.velocity
        for force in sim.forces.arrays():
            force[:] = 0.0
        sim.step()
    return sim


@pytest.mark.parametrize("scheme", ["bond_projected", "sub_horizon", "standard"])
def test_work_of_ideal_plasticity_is_stored_or_dissipated(scheme):
    """Von Mises in shear: stress c, stored c^2 / 2 mu, dissipated c (gamma - c / mu), per volume of 1 m^3."""
    sim = sheared(scheme, MISES)
    plastic = sim.ledger.entries()["plastic_dissipation"]
    assert plastic == pytest.approx(1e3 * (0.01 - 1e-3), rel=2e-3)
    assert sim.particles.plastic_dissipation.min() > 0.0


def test_a_scene_whose_laws_do_not_report_has_no_such_entry():
    sim = sheared("bond_projected", MISES | {"report_dissipation": False})
    assert "plastic_dissipation" not in sim.ledger.entries()
    assert not any("plastic_dissipation" in process.output for process in sim.point_processes)
    assert np.isfinite(sim.ledger.kinetic())
