"""Mud: its flow curve, its rest, opening, dissipation."""

import numpy as np
import pytest
from pydantic import ValidationError

from periporo.materials.herschel_bulkley import HerschelBulkley

MUD = HerschelBulkley.example()


def mud(**changes):
    return HerschelBulkley(**(MUD.model_dump() | changes))


@pytest.mark.parametrize("exponent", [0.3, 0.5, 1.0, 1.7])
@pytest.mark.parametrize("rate", [1e-3, 0.1, 10.0])
def test_steady_shear_follows_the_flow_curve(exponent, rate):
    """tau = tau_y + k gamma'^n in plane shear, after much more than the time of relaxation; its work is dissipated."""
    law, dt = mud(exponent=exponent, report_dissipation=True), 1e-2
    stress, state = np.array([[-1e3, -1e3, -1e3, 0.0]]), np.zeros((1, 2))
    for _ in range(60):
        strain = np.array([[0.0, 0.0, 0.0, 0.5 * max(rate * dt, 1e-4)]])
        law.compute_stress(stress, strain, state, 2 * strain[0, 3] / rate)
    tau = 200.0 + 20.0 * rate**exponent
    np.testing.assert_allclose(stress[0], [-1e3, -1e3, -1e3, tau], rtol=1e-9)
    assert state[0, 0] == pytest.approx(tau * 2 * strain[0, 3], rel=1e-9)


def test_overstress_relaxes_to_the_yield_stress():
    """d tau/dt = -G (tau - tau_y)/k of Bingham's fluid, first order; at once without an end of time."""
    law = mud(exponent=1.0, consistency=2e3)
    stress = np.array([[0.0, 0.0, 0.0, 500.0]])
    for _ in range(200):
        law.compute_stress(stress, np.zeros((1, 4)), np.zeros((1, 1)), 1e-5)
    assert stress[0, 3] == pytest.approx(200.0 + 300.0 * np.exp(-1e6 / 2e3 * 2e-3), rel=2e-3)
    law.compute_stress(stress, np.zeros((1, 4)), np.zeros((1, 1)), np.inf)
    assert stress[0, 3] == 200.0


def test_mud_bears_no_tension_beyond_its_limit():
    stress, step = np.zeros((1, 6)), np.array([[1e-3, 1e-3, 1e-3, 0, 0, 0]])
    mud(tension_cutoff=50.0).compute_stress(stress, step, np.zeros((1, 1)), 1.0)
    np.testing.assert_allclose(stress[0], [50, 50, 50, 0, 0, 0])


def test_what_has_no_strength_is_refused_and_strength_can_be_reduced():
    with pytest.raises(ValidationError, match="both 0"):
        mud(yield_stress=0.0, consistency=0.0)
    assert MUD.weakened(2.0).yield_stress == 100.0 and MUD.weakened(2.0).consistency == MUD.consistency
