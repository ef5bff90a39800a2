"""Hypoplastic sand: Bauer's line, published peaks, critical state, small strains, error control."""

import numpy as np
import pytest
from pydantic import ValidationError

from periporo.materials import StepRefused, built_in_path, check_material, drive
from periporo.materials.hypoplastic_sand import HypoplasticSand

SAND = HypoplasticSand.example()


def sand(**changes):
    return HypoplasticSand(**(SAND.model_dump() | changes))


def triaxial(void, strain, rows=100):
    path = built_in_path("triaxial", f"confining=1e5,strain={strain},rows={rows}")
    result = drive(sand(initial_void_ratio=void), path)
    ratio = result["stress_yy"] / result["stress_xx"]
    return np.degrees(np.arcsin((ratio - 1) / (ratio + 1))), result


@pytest.mark.parametrize("void, peak", [(0.6, 46.2), (0.75, 36.4)])
def test_peaks_of_hochstetten_sand(void, peak):
    """Drained triaxial tests at 100 kPa (von Wolffersdorff 1996)."""
    angle, result = triaxial(void, 0.25)
    assert angle.max() == pytest.approx(peak, abs=0.3)
    assert angle[-1] < angle.max() - 0.2 and result["void_ratio"][-1] > void


def test_the_critical_state_has_its_angle_and_void_ratio():
    """Sheared far, dense and loose sand come to 33 degrees and e_c of the pressure."""
    for void in (0.8, 0.9):
        angle, result = triaxial(void, 3.0, 150)
        pressure = -(result["stress_xx"] + result["stress_yy"] + result["stress_zz"])[-1] / 3
        assert angle[-1] == pytest.approx(33.0, abs=0.4)
        assert result["void_ratio"][-1] == pytest.approx(SAND.limits_of_void_ratio(pressure)[1], rel=0.01)


def test_isotropic_compression_of_the_loosest_sand_follows_bauers_line():
    """e = e_i0 exp(-(3p/h_s)^n), monotonic strain."""
    loose = sand(initial_void_ratio=1.05 * float(np.exp(-((3 * 1e4 / 1e9) ** 0.25))), turn_stiffness=1.0,
                 reversal_stiffness=1.0)  # fmt: skip
    result = drive(loose, built_in_path("isotropic", "confining=1e4,strain=0.05,rows=50"))
    pressure = -(result["stress_xx"] + result["stress_yy"] + result["stress_zz"]) / 3
    assert pressure[-1] > 1e5
    swept = result["time_s"] > 0.02 * result["time_s"][-1]
    expected = 1.05 * np.exp(-((3 * pressure[swept] / 1e9) ** 0.25))
    np.testing.assert_allclose(result["void_ratio"][swept], expected, rtol=2e-3)


def test_small_strains_after_a_reversal_are_stiffer_by_their_factor():
    """m_R L there and back; sheared on in one direction, L with N."""
    stress = np.array([[-1e5, -1e5, -1e5, 0, 0, 0.0]])
    state = SAND.initial_state(stress, None, None)
    bulk, shear = SAND.elastic_moduli(stress, state)
    start, step = stress.copy(), np.zeros((1, 6))
    step[0, 3] = 1e-7
    SAND.compute_stress(stress, step, state, 1.0)
    assert (stress - start)[0, 3] == pytest.approx(2 * shear[0] * 1e-7, rel=1e-3)
    for _ in range(200):
        SAND.compute_stress(stress, 100 * step, state, 1.0)
    assert np.sqrt((state[0, 1:7] ** 2 * [1, 1, 1, 2, 2, 2]).sum()) == pytest.approx(SAND.elastic_range, rel=0.02)
    before = stress.copy()
    SAND.compute_stress(stress, -step, state.copy(), 1.0)
    stiff = (before - stress)[0, 3] / 1e-7
    after = before.copy()
    SAND.compute_stress(after, step, state.copy(), 1.0)
    assert stiff > 4 * (after - before)[0, 3] / 1e-7
    assert bulk[0] > shear[0] > 0


def test_long_steps_are_divided_until_the_error_is_small():
    stress = np.tile([-1e5, -1e5, -1e5, 0, 0, 0.0], (2, 1))
    state = SAND.initial_state(stress, None, None)
    step = np.array([[3e-3, -8e-3, 2e-3, 4e-3, 1e-3, -2e-3]])
    SAND.compute_stress(stress[:1], step, state[:1], 1.0)
    for _ in range(2000):
        SAND.compute_stress(stress[1:], step / 2000, state[1:], 1.0)
    np.testing.assert_allclose(stress[0], stress[1], rtol=5e-3, atol=5e-3 * np.abs(stress).max())
    np.testing.assert_allclose(state[0, 0], state[1, 0], rtol=1e-4)


def test_the_work_of_a_step_is_bounded():
    stress = np.array([[-1e5, -1e5, -1e5, 0.0]])
    with pytest.raises(StepRefused, match="more than 5 substeps"):
        step, state = np.array([[0.0, -0.05, 0.0, 0.0]]), SAND.initial_state(stress, None, None)
        sand(substeps=5).compute_stress(stress, step, state, 1.0)


def test_sand_that_expands_opens():
    stress = np.full((1, 4), -1e3) * [1, 1, 1, 0]
    state = SAND.initial_state(stress, None, None)
    SAND.compute_stress(stress, np.array([[3e-3, 3e-3, 3e-3, 0.0]]), state, 1.0)
    np.testing.assert_allclose(stress[0], [-10, -10, -10, 0])
    assert 0.003 < state[0, 5] < 0.009


@pytest.mark.parametrize("dimension", [2, 3])
def test_conforms(dimension):
    assert np.isfinite(check_material(sand(report_dissipation=True), dimension).cycle_energy)


def test_dissipation_is_positive_and_at_most_the_work_in_monotonic_shear():
    law = sand(report_dissipation=True, initial_void_ratio=0.8)
    result = drive(law, built_in_path("triaxial", "confining=1e5,strain=0.1,rows=100"))
    assert (result["dissipation"][5:] > 0).all()


@pytest.mark.parametrize("change, message", [
    ({"initial_void_ratio": 0.5}, "must lie between"),
    ({"critical_void_ratio": 1.1}, "must ascend"),
    ({"turn_stiffness": 6.0}, "must not exceed reversal_stiffness"),
])  # fmt: skip
def test_impossible_parameters_are_refused(change, message):
    with pytest.raises(ValidationError, match=message):
        sand(**change)


def test_a_void_ratio_beyond_its_limits_at_the_pressure_is_doubted():
    stress = np.full((1, 6), -5e6) * [1, 1, 1, 0, 0, 0]
    loose = sand(initial_void_ratio=1.0)
    assert "beyond its limits" in loose.doubts(stress, loose.initial_state(stress, None, None))["void ratio"]
    assert SAND.doubts(np.full((1, 6), -1e4) * [1, 1, 1, 0, 0, 0], np.array([[0.6]])) == {}
