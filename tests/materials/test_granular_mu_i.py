"""Grains of mu(I): friction at each rate, Bagnold's profile down a slope, the steady angle."""

import numpy as np
import pytest
from pydantic import ValidationError

from benchmarks import soil_laws
from periporo.core.numerics.tensors import equivalent_shear
from periporo.materials import check_material
from periporo.materials.granular_mu_i import GranularMuI

GRAINS = GranularMuI.example()
MOST, LEAST, I_0 = GRAINS.largest_friction, GRAINS.static_friction, GRAINS.inertial_number


def friction(inertial):
    return LEAST + (MOST - LEAST) / (1 + I_0 / inertial)


@pytest.mark.parametrize("components, shear", [(4, 3), (6, 3), (6, 4), (6, 5)])
@pytest.mark.parametrize("inertial", [1e-4, 0.1, 3.0])
def test_friction_in_steady_shear(components, shear, inertial):
    """sqrt(J2) = P mu(gamma' d/sqrt(P/rho_s)), and the pressure stays."""
    pressure, dt = 2e3, 1e-5
    rate = inertial * np.sqrt(pressure / GRAINS.grain_density) / GRAINS.grain_diameter
    stress, state = np.zeros((1, components)), np.zeros((1, 1))
    stress[0, :3] = -pressure
    increment = np.zeros_like(stress)
    increment[0, shear] = 0.5 * rate * dt
    for _ in range(int(3e-3 / (rate * dt)) + 2000):
        GRAINS.compute_stress(stress, increment, state, dt)
    assert stress[0, shear] == pytest.approx(pressure * friction(inertial), rel=1e-6)
    np.testing.assert_allclose(stress[0, :3], -pressure, rtol=1e-9)


def test_at_rest_friction_is_static_and_tension_is_none():
    stress = np.array([[-1e3, -1e3, -1e3, 2e3], [1.0, 2.0, 3.0, 4.0], [-1e3, -1e3, -1e3, 100.0]])
    new, still = stress.copy(), np.zeros_like(stress)
    GRAINS.compute_stress(new, still, np.zeros((3, 1)), np.inf)
    assert new[0, 3] == pytest.approx(LEAST * 1e3, rel=1e-12)
    np.testing.assert_array_equal(new[1], 0.0)
    np.testing.assert_array_equal(new[2], stress[2])
    GRAINS.compute_stress(stress, still, np.zeros((3, 1)), 0.0)
    assert stress[0, 3] == pytest.approx(MOST * 1e3, rel=1e-12)  # no time to flow, but never more than the largest


def test_bagnolds_profile_down_a_slope():
    """u = 2/3 I sqrt(rho g cos/rho_s)/d (H^1.5 - (H - y)^1.5) with mu(I) = tan of the slope, within 2 %."""
    assert soil_laws.bagnold() < 0.02


def test_grains_stand_below_the_static_angle_and_flow_above():
    slow, fast = (soil_laws.chute(np.arctan(LEAST) + turn, duration=0.5)[1][-1] for turn in (-0.01, 0.03))
    assert abs(slow) < 1e-3 and fast > 0.02


@pytest.mark.parametrize("dimension", [2, 3])
def test_conforms_and_loses_energy(dimension):
    law = GRAINS.model_copy(update={"report_dissipation": True})
    assert check_material(law, dimension).cycle_energy > 0.0


def test_reported_dissipation_is_the_work_of_the_plastic_strain():
    law = GRAINS.model_copy(update={"report_dissipation": True})
    rng = np.random.default_rng(0)
    trial = rng.normal(size=(500, 6)) * 1e3 - [1e3, 1e3, 1e3, 0, 0, 0]
    new, state = trial.copy(), np.zeros((500, 2))
    law.compute_stress(new, np.zeros_like(new), state, 1e-4)
    pressed = trial[:, :3].mean(axis=1) < 0
    plastic = (trial - new)[pressed] / (2 * law.shear_modulus)
    work = (new[pressed] * plastic * [1, 1, 1, 2, 2, 2]).sum(axis=1)
    np.testing.assert_allclose(state[pressed, 0], work, rtol=1e-9, atol=1e-9)
    assert (state[:, 0] > 0).mean() > 0.3


def test_weaker_grains_have_less_friction():
    weaker = GRAINS.weakened(1.25)
    stress = np.array([[-1e3, -1e3, -1e3, 2e3]])
    weaker.compute_stress(stress, np.zeros_like(stress), np.zeros((1, 1)), np.inf)
    assert equivalent_shear(stress)[0] / np.sqrt(3) == pytest.approx(LEAST / 1.25 * 1e3, rel=1e-12)


@pytest.mark.parametrize("change, message", [
    ({"largest_friction": 0.1}, "must be at least static_friction"),
    ({"density": 3000.0}, "must not exceed grain_density"),
    ({"inertial_number": 0.0}, "greater than 0"),
])  # fmt: skip
def test_impossible_parameters_are_refused(change, message):
    with pytest.raises(ValidationError, match=message):
        GranularMuI(**(GRAINS.model_dump() | change))
