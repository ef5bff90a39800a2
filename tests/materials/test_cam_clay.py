"""Cam-Clay: closed forms, the return mapping's equations, rate effects, bonding, robustness."""

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from periporo.core.numerics.tensors import equivalent_shear, mean
from periporo.core.points.opening import advance_rows
from periporo.materials import check_material
from periporo.materials.cam_clay import CamClay, bonding_exponents

K, MU, M, PLASTIC_INDEX = 25e6, 15e6, 1.1, 0.08
IDS, VOLUME = np.zeros((1, 2), dtype=np.int64), np.ones(1)
NEVER = np.inf  # the rate-independent limit


def soil(**changes):
    parameters = {
        "grain_density": 2200.0,
        "porosity": 0.2,
        "bulk_modulus": K,
        "shear_modulus": MU,
        "critical_state_slope": M,
        "compression_index": 0.12,
        "swelling_index": 0.04,
    }
    return CamClay(**(parameters | changes))


def isotropic(p, columns=6):
    row = np.zeros((1, columns))
    row[:, :3] = p
    return row


def triaxial_increment(volumetric, shear):
    """One row with the given volumetric strain and equivalent shear strain, axis yy."""
    row = np.zeros((1, 6))
    row[0, :3] = volumetric / 3.0 + shear * np.array([0.5, -1.0, 0.5])
    return row


def advanced(material, stress, state, increment, dt=NEVER):
    """Stress and state after one call, the arguments left alone."""
    stress, state = stress.copy(), state.copy()
    material.compute_stress(stress, increment, state, dt)
    return stress, state


def elastic_trial(stress, increment):
    trial = stress + 2 * MU * increment
    trial[:, :3] += ((K - 2 * MU / 3) * increment[:, :3].sum(axis=1))[:, None]
    return trial


def follow(material, stress, state, increment, steps, dt=NEVER):
    for _ in range(steps):
        material.compute_stress(stress, increment, state, dt)
    return stress, state


@pytest.mark.parametrize("steps", [1, 50])
def test_isotropic_compaction_hardens(steps):
    """V11: (l - k) ln(p/p0) + (p - p0)/K = 0.05 from 1 kPa; the sign printed in eq. 72 would give 535 Pa."""
    material = soil()
    stress = isotropic(-1e3)
    state = material.initial_state(stress, IDS, VOLUME)
    follow(material, stress, state, triaxial_increment(-0.05 / steps, 0.0), steps)
    assert -mean(stress)[0] == pytest.approx(1867.43584, rel=1e-8)
    assert -state[0, 0] == pytest.approx(1867.43584, rel=1e-8)


def constant_pressure_shear(steps, strain):
    material = soil()
    stress = isotropic(-1e3)
    state = material.initial_state(stress, IDS, VOLUME)
    volumetric = 0.0
    for _ in range(steps):

        def pressure_error(volume_strain, stress=stress, state=state):
            increment = triaxial_increment(volume_strain, strain / steps)
            return mean(advanced(material, stress, state, increment)[0])[0] + 1e3

        for _ in range(20):
            error = pressure_error(volumetric)
            if abs(error) < 1e-9 * 1e3:
                break
            volumetric -= error * 1e-9 / (pressure_error(volumetric + 1e-9) - error)
        stress, state = advanced(material, stress, state, triaxial_increment(volumetric, strain / steps))
    return equivalent_shear(stress)[0]


def test_constant_pressure_shear():
    """V12: the integral of the flow rule at constant p; first order in the number of steps."""
    p, strain = 1e3, 0.2

    def shear_strain(q):
        ratio = q / p
        flow = np.log((M + ratio) / (M - ratio)) / M - 2.0 / M * np.arctan(ratio / M)
        return PLASTIC_INDEX * flow + q / (3.0 * MU)

    exact = brentq(lambda q: shear_strain(q) - strain, 0.0, M * p * (1 - 1e-9))
    errors = [abs(constant_pressure_shear(n, strain) - exact) / exact for n in (750, 1500, 3000)]
    assert errors[2] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize("steps", [40, 400])
def test_undrained_critical_state(steps):
    """V13: at constant volume the critical state does not depend on the steps; p0 = -1, p_c0 = -1.25 kPa."""
    material = soil(overconsolidation_ratio=1.25)
    stress = isotropic(-1e3)
    state = material.initial_state(stress, IDS, VOLUME)
    follow(material, stress, state, triaxial_increment(0.0, 20.0 / steps), steps)
    assert mean(stress)[0] == pytest.approx(-625.11716, rel=1e-7)
    assert equivalent_shear(stress)[0] == pytest.approx(687.62888, rel=1e-7)


def test_weaker_clay_has_less_strength_at_the_pressure_that_it_had():
    """Undrained, q of the critical state is divided, and p is not: that follows from p_c."""
    material = soil(overconsolidation_ratio=1.25).weakened(1.25)
    stress = isotropic(-1e3)
    state = material.initial_state(stress, IDS, VOLUME)
    follow(material, stress, state, triaxial_increment(0.0, 0.5), 40)
    assert mean(stress)[0] == pytest.approx(-625.11716, rel=1e-7)
    assert equivalent_shear(stress)[0] == pytest.approx(687.62888 / 1.25, rel=1e-7)


def test_oedometer_stress_ratio():
    """V14: K0 of virgin compression, from eta^2 + 3 eta = M^2 (elastic strain is negligible at 1 kPa)."""
    material = soil()
    stress = isotropic(-10.0)
    state = material.initial_state(stress, IDS, VOLUME)
    increment = np.zeros((1, 6))
    increment[0, 1] = -2e-4
    while stress[0, 1] > -1.2e3:
        material.compute_stress(stress, increment, state, NEVER)
    assert stress[0, 0] / stress[0, 1] == pytest.approx(0.7096, abs=1e-3)


def random_rows(n=20_000, seed=3):
    """Stress, increments and state over many decades, from deep inside to far outside of the ellipse."""
    rng = np.random.default_rng(seed)
    stress = rng.normal(size=(n, 6)) * 10 ** rng.uniform(0, 6, n)[:, None]
    stress[:, :3] += (rng.normal(size=n) * 10 ** rng.uniform(0, 6, n))[:, None]
    increment = rng.normal(size=(n, 6)) * 10 ** rng.uniform(-9, -0.3, n)[:, None]
    state = -(10 ** rng.uniform(0, 6, n))[:, None]
    return stress, increment, state


@pytest.mark.parametrize("viscosity", [0.0, 1e3, 1e6, 1e9, 1e12, 1e20])
def test_backward_euler_equations_hold_in_random_states(viscosity):
    """p, q, p_c of the result satisfy flow, hardening and (overstressed) yield condition; none fails."""
    dt = 3e-6
    material = soil(viscosity=viscosity)
    stress, increment, state = random_rows()
    new, new_state = advanced(material, stress, state, increment, dt)
    assert np.isfinite(new).all()
    trial = elastic_trial(stress, increment)
    p_trial, q_trial, size = mean(trial), equivalent_shear(trial), -state[:, 0]
    flows = (q_trial / M) ** 2 + p_trial * (p_trial + size) > 1e-9 * size**2
    assert 0.5 < flows.mean() < 0.99
    np.testing.assert_allclose(new[~flows], trial[~flows], rtol=0, atol=1e-3 * size.max())
    np.testing.assert_array_less(-1 + 1e-12, -new_state[:, 0])

    p, q, new_size = mean(new)[flows], equivalent_shear(new)[flows], -new_state[flows, 0]
    p_trial, q_trial, size = p_trial[flows], q_trial[flows], size[flows]
    volumetric = (p_trial - p) / K
    hardened = np.maximum(size * np.exp(-volumetric / PLASTIC_INDEX), 1.0)
    np.testing.assert_allclose(new_size, hardened, rtol=1e-6)
    multiplier = M**2 / (6 * MU) * (q_trial - q) / q
    scale = np.abs(p_trial) + q_trial + size
    assert np.max(np.abs(volumetric - multiplier * (2 * p + new_size)) * K / scale) < 1e-7
    overstress = viscosity / dt * multiplier
    residual = (q / M) ** 2 + p * (p + new_size) - overstress
    rounding = 1e-15 * viscosity / dt * M**2 / (6 * MU) * scale / q  # of the multiplier, a difference of q
    assert np.all(np.abs(residual) < 1e-8 * (scale**2 + overstress) + rounding)


def test_flow_is_coaxial_and_elastic_rows_are_hooke():
    material = soil()
    stress, increment, state = random_rows(200)
    new, _ = advanced(material, stress, state, increment)
    trial = elastic_trial(stress, increment)

    def direction(rows):
        deviator = rows.copy()
        deviator[:, :3] -= mean(rows)[:, None]
        return deviator / np.linalg.norm(deviator, axis=1)[:, None]

    firm = equivalent_shear(new) > 1e-6 * np.abs(mean(new))
    np.testing.assert_allclose(direction(new)[firm], direction(trial)[firm], atol=1e-8)
    inside, small = isotropic(-500.0), triaxial_increment(-1e-6, 1e-6)
    result, _ = advanced(material, inside, np.array([[-1e3]]), small)
    assert mean(result)[0] == pytest.approx(-500.0 - K * 1e-6, rel=1e-14)
    assert equivalent_shear(result)[0] == pytest.approx(3 * MU * 1e-6, rel=1e-12)


def test_plane_strain_rows_equal_three_dimensional_rows():
    stress, increment, state = random_rows(500)
    stress[:, 4:] = increment[:, 4:] = 0.0
    full, full_state = advanced(soil(viscosity=1e6), stress, state, increment, 1e-5)
    plane = np.ascontiguousarray(stress[:, :4])
    plane, plane_state = advanced(
        soil(viscosity=1e6), plane, state, np.ascontiguousarray(increment[:, :4]), 1e-5
    )
    np.testing.assert_allclose(plane, full[:, :4], rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(plane_state, full_state, rtol=1e-12)


@pytest.mark.parametrize(("kilopascal", "viscosity", "end"), [(1e3, 1e8, 4e-6), (1e5, 2.5e20, 1e3)])
def test_viscous_relaxation_follows_the_rate_equations(kilopascal, viscosity, end):
    """At fixed strain, p, q, p_c follow Perzyna's flow; backward Euler is first order in the step.

    A viscosity is in Pa^3 s: creep over 1000 s at 100 kPa takes 2.5e20.
    """
    p0, q0, size0 = -1.5 * kilopascal, 1.2 * kilopascal, 1.5 * kilopascal

    def rate(_, y):
        p, q, size = y
        flow = max((q / M) ** 2 + p * (p + size), 0.0) / viscosity
        volumetric = flow * (2 * p + size)
        return [-K * volumetric, -6 * MU / M**2 * flow * q, -size * volumetric / PLASTIC_INDEX]

    exact = solve_ivp(rate, (0, end), [p0, q0, size0], rtol=1e-11, atol=1e-8, method="LSODA").y[:, -1]
    elastic_loss = np.array([p0, q0]) - exact[:2]
    assert np.all(np.abs(elastic_loss) > 0.03 * kilopascal)
    errors = []
    for steps in (50, 100, 200):
        stress = isotropic(p0)
        stress[0, :3] += q0 * np.array([1, -2, 1]) / 3
        state = np.array([[-size0]])
        follow(soil(viscosity=viscosity), stress, state, np.zeros((1, 6)), steps, end / steps)
        errors.append(np.array([mean(stress)[0], equivalent_shear(stress)[0], -state[0, 0]]) - exact)
    sizes = [np.linalg.norm(e) for e in errors]
    assert sizes[0] / sizes[1] == pytest.approx(2.0, rel=0.05)
    assert sizes[1] / sizes[2] == pytest.approx(2.0, rel=0.05)
    assert np.linalg.norm(2 * errors[2] - errors[1]) < 1e-4 * np.linalg.norm(elastic_loss)


def test_slow_loading_and_infinite_time_give_the_rate_independent_result():
    stress, increment, state = random_rows(500)
    inviscid, _ = advanced(soil(), stress, state, increment, 1e-6)
    np.testing.assert_array_equal(advanced(soil(viscosity=1e9), stress, state, increment)[0], inviscid)
    slow, _ = advanced(soil(viscosity=1.0), stress, state, increment, 1e6)
    np.testing.assert_allclose(slow, inviscid, rtol=1e-6, atol=1e-3)
    stiff, _ = advanced(soil(viscosity=1e12), stress, state, increment, 1e-20)
    np.testing.assert_allclose(stiff, elastic_trial(stress, increment), rtol=1e-6, atol=1e-3)


@pytest.mark.parametrize("dt", [0.0, -1.0, np.nan])
def test_time_step_must_be_positive(dt):
    with pytest.raises(ValueError, match="time step must be positive"):
        soil().compute_stress(isotropic(-1e3), np.zeros((1, 6)), np.array([[-1e3]]), dt)


@pytest.mark.parametrize("ratio", [1.0, 1.25])
def test_overconsolidation_ratio_is_measured_from_the_yield_surface(ratio):
    """A K0 state may lie above the critical state line: it still starts inside of its ellipse."""
    stress = np.array([[-400.0, -1e3, -400.0, 100.0, 0.0, 0.0], [3.0, 3.0, 3.0, 0.0, 0.0, 0.0]])
    state = soil(overconsolidation_ratio=ratio).initial_state(stress, np.zeros((2, 2), int), np.ones(2))
    p, q = mean(stress)[0], equivalent_shear(stress)[0]
    through = -(p + (q / M) ** 2 / p)
    assert -state[0, 0] == pytest.approx(ratio * through, rel=1e-14)
    assert (q / M) ** 2 + p * (p + through) == pytest.approx(0.0, abs=1e-6)
    assert state[1, 0] == -1.0
    assert soil(preconsolidation=5e3).initial_state(stress, None, None)[0, 0] == -5e3
    assert soil(preconsolidation=0.5).initial_state(stress, None, None)[0, 0] == -1.0


def test_tension_softens_to_the_floor_and_no_further():
    material = soil(minimum_preconsolidation=20.0)
    stress = isotropic(-1e3)
    state = material.initial_state(stress, IDS, VOLUME)
    follow(material, stress, state, triaxial_increment(0.01, 0.001), 100)
    assert state[0, 0] == -20.0
    assert -20.0 <= mean(stress)[0] <= 1e-6
    assert equivalent_shear(stress)[0] <= 0.5 * M * 20.0 * (1 + 1e-9)


def test_nan_stays_visible():
    stress, state = isotropic(-1e3), np.array([[np.nan]])
    soil().compute_stress(stress, triaxial_increment(-0.01, 0.01), state, NEVER)
    assert np.isnan(state[0, 0])
    stress, state = isotropic(np.nan), np.array([[-1e3]])
    soil().compute_stress(stress, triaxial_increment(-0.01, 0.01), state, NEVER)
    assert np.isnan(stress[0, 0])


@pytest.mark.parametrize("viscosity", [0.0, 1e9])
def test_reported_dissipation_is_the_work_of_the_plastic_strain(viscosity):
    """sigma : (de - C^-1 dsigma), whatever the step; zero in elastic rows."""
    material = soil(report_dissipation=True, viscosity=viscosity)
    assert [f.name for f in material.state_fields] == ["preconsolidation", "dissipation", "opened"]
    stress, increment, size = random_rows(2000)
    state = np.hstack([size, np.full_like(size, 123.0)])
    new, new_state = advanced(material, stress, state, increment, 1e-5)
    change = new - stress
    elastic = change / (2 * MU)
    elastic[:, :3] += (mean(change) * (1 / (3 * K) - 1 / (2 * MU)))[:, None]
    plastic = increment - elastic
    work = np.sum(new[:, :3] * plastic[:, :3], axis=1) + 2 * np.sum(new[:, 3:] * plastic[:, 3:], axis=1)
    scale = np.sum(np.abs(new), axis=1) * np.sum(np.abs(stress) / MU + np.abs(increment), axis=1)
    assert np.max(np.abs(new_state[:, 1] - work) / scale) < 1e-11
    assert np.any(new_state[:, 1] == 0.0)
    assert np.all(new_state[:, 1] >= -1e-12 * scale)


def test_bonding_exponents_follow_from_the_two_virgin_lines():
    """Both preconsolidation pressures lie on one swelling line (pressures in kPa)."""
    specific_volume, compression, swelling = 2.76, 0.12, 0.04
    assert bonding_exponents(0.0, 0.185, 1.42, specific_volume, compression, swelling) == (0.0, 1.0)
    for bonding, size in ((0.3, 0.5), (0.1, 20.0)):
        b1, b2 = bonding_exponents(bonding, 0.185, 1.42, specific_volume, compression, swelling)
        bonded = np.exp(b1) * size**b2
        ratio = 1 - 0.185 * (1 - np.exp(1.42 * bonding))
        on_bonded_line = ratio * (specific_volume - compression * np.log(bonded))
        on_saturated_line = specific_volume - compression * np.log(size)
        swelling_step = swelling * np.log(bonded / size)
        assert on_bonded_line + swelling_step == pytest.approx(on_saturated_line, rel=1e-13)
        assert bonded > size


def test_bonding_enlarges_the_yield_surface():
    """Isotropic compaction of bonded soil ends at p = -exp(b1) |p_c|^b2 with p_c hardened by eq. 46."""
    bonding = 0.05
    material = soil().for_unsaturated()
    assert [f.name for f in material.state_fields] == ["preconsolidation", "bonding", "opened"]
    assert material.density == soil().density
    stress = isotropic(-1e3)
    state = material.initial_state(stress, IDS, VOLUME)
    assert state.tolist() == [[-1e3, 0.0, 0.0]]
    state[0, 1] = bonding
    follow(material, stress, state, triaxial_increment(-0.002, 0.0), 20)
    p = -mean(stress)[0]
    b1, b2 = bonding_exponents(bonding, 0.185, 1.42, 2.76, 0.12, 0.04)
    bonded = 1e3 * np.exp(b1) * (-state[0, 0] / 1e3) ** b2
    assert p == pytest.approx(bonded, rel=1e-9)
    plastic = 0.04 - (p - 1e3) / K
    assert -state[0, 0] == pytest.approx(1e3 * np.exp(plastic / PLASTIC_INDEX), rel=1e-9)
    p_drawn, q_drawn = material.yield_surface(stress[0], state[0])
    assert p_drawn.min() == pytest.approx(-bonded, rel=1e-12)
    assert q_drawn.max() == pytest.approx(0.5 * M * bonded, rel=1e-12)
    assert soil().yield_surface(stress[0], state[0])[0].min() == pytest.approx(state[0, 0], rel=1e-12)


def test_unbonded_unsaturated_soil_equals_dry_soil():
    stress, increment, state = random_rows(300)
    dry, dry_state = advanced(soil(), stress, state, increment)
    wet, wet_state = advanced(
        soil().for_unsaturated(), stress, np.hstack([state, np.zeros_like(state)]), increment
    )
    np.testing.assert_array_equal(wet, dry)
    np.testing.assert_array_equal(wet_state[:, 0], dry_state[:, 0])


@pytest.mark.parametrize(
    "change, message",
    [
        ({"swelling_index": 0.12}, "must exceed swelling_index"),
        ({"porosity": 1.0}, "less than 1"),
        ({"overconsolidation_ratio": 0.5}, "greater than or equal to 1"),
        ({"preconsolidation": -1e3}, "greater than 0"),
        ({"viscosity": float("nan")}, "finite"),
        ({"viscocity": 1.0}, "Extra inputs"),
    ],
)
def test_impossible_parameters_are_refused(change, message):
    with pytest.raises(ValidationError, match=message):
        soil(**change)


def test_moduli_and_density():
    bulk, shear = soil().elastic_moduli(np.zeros((3, 4)), np.zeros((3, 1)))
    assert bulk.tolist() == [K] * 3 and shear.tolist() == [MU] * 3
    assert soil().density == pytest.approx(1760.0)


def swelling(**changes):
    """Soil whose bulk modulus is the pressure over kappa."""
    return soil(**({"bulk_modulus": None, "shear_modulus": None, "poisson_ratio": 0.25} | changes))


@pytest.mark.parametrize("columns", [4, 6])
@pytest.mark.parametrize("steps", [1, 40])
def test_swelling_follows_the_line_of_kappa_and_virgin_compression_that_of_lambda(columns, steps):
    """p = p0 exp(-e_v/kappa) however long the steps; beyond p_c, p = p_c exp(-(e_v - e_c)/lambda), first order."""
    material = swelling(overconsolidation_ratio=4.0)
    stress = isotropic(-1e4, columns)
    state = material.initial_state(stress, IDS, VOLUME)
    increment = np.zeros((1, columns))
    increment[0, :3] = 0.02 / 3 / steps
    follow(material, stress, state, increment, steps)
    assert -mean(stress)[0] == pytest.approx(1e4 * np.exp(-0.5), rel=1e-12)
    follow(material, stress, state, -increment, steps)
    assert -mean(stress)[0] == pytest.approx(1e4, rel=1e-12)
    yielding = 0.04 * np.log(4.0)
    increment[0, :3] = -(yielding + 0.06) / 3 / 1000
    follow(material, stress, state, increment, 1000)
    assert -mean(stress)[0] == pytest.approx(4e4 * np.exp(0.06 / 0.12), rel=2e-3)
    bulk, shear = material.elastic_moduli(stress, state)
    assert bulk[0] == pytest.approx(-mean(stress)[0] / 0.04) and shear[0] == pytest.approx(0.6 * bulk[0], rel=1e-12)


def test_undrained_shear_with_kappa_ends_at_the_critical_state():
    """At constant volume ln(p_c/p) falls from ln(OCR) to ln 2 along kappa and lambda - kappa: closed form of p."""
    material = swelling(overconsolidation_ratio=1.5)
    stress = isotropic(-1e5)
    state = material.initial_state(stress, IDS, VOLUME)
    follow(material, stress, state, triaxial_increment(0.0, 0.3 / 3000), 3000)
    part = 1 - 0.04 / 0.12
    assert -mean(stress)[0] == pytest.approx(1e5 * (1.5 / 2) ** part, rel=2e-3)
    assert equivalent_shear(stress)[0] == pytest.approx(M * -mean(stress)[0], rel=1e-4)


def test_overconsolidation_that_fades_with_depth():
    stress = np.concatenate([isotropic(-1e4), isotropic(-1e5)])
    state = soil(preoverburden=2e4).initial_state(stress, np.zeros((2, 2), int), np.ones(2))
    np.testing.assert_allclose(-state[:, 0], [3e4, 1.2e5], rtol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("viscosity", [0.0, 1e8])
def test_swelling_soil_conforms(dimension, viscosity):
    law = swelling(viscosity=viscosity, overconsolidation_ratio=1.5, report_dissipation=True)
    assert np.isfinite(check_material(law, dimension).cycle_energy)


@pytest.mark.parametrize("change, message", [
    ({"bulk_modulus": None}, "or poisson_ratio alone"), ({"poisson_ratio": 0.3}, "or poisson_ratio alone"),
    ({"bulk_modulus": None, "shear_modulus": None, "poisson_ratio": 0.3, "swelling_index": 0.0}, "is 0"),
    ({"preoverburden": 1e3, "preconsolidation": 1e4}, "not both"),
])  # fmt: skip
def test_elasticity_is_of_one_kind(change, message):
    with pytest.raises(ValidationError, match=message):
        soil(**change)


def test_a_copy_has_numbers_of_its_own():
    law = CamClay.example()
    stress, state = -1e4 * np.ones((2, 4)), np.zeros((2, len(law.state_fields)))
    before, _ = law.elastic_moduli(stress, state)
    after, _ = law.model_copy(update={"bulk_modulus": 2.0 * law.bulk_modulus}).elastic_moduli(stress, state)
    assert after.tolist() == (2.0 * before).tolist() == [2.0 * law.bulk_modulus] * 2


def test_open_soil_that_is_sheared_and_expands_gives_no_work():
    """Its dilation goes into the gap, which is smaller then; it bears nothing before that has closed."""
    law, stress = soil(), isotropic(-5e3, 4)
    state = law.initial_state(stress, IDS, VOLUME)
    stress[:], state[0, -1] = 0.0, 0.02
    strain, work = np.zeros((1, 4)), 0.0
    for k in range(200):
        strain[0, :2], strain[0, 3] = 1e-4, 1e-5 * (-1.0) ** (k // 10)
        work += strain[0] @ (stress[0] * [1.0, 1.0, 1.0, 2.0])
        advance_rows(law, stress, strain.copy(), state, 1e-4)
        work += strain[0] @ (stress[0] * [1.0, 1.0, 1.0, 2.0])
    assert abs(stress).max() < 1e-9 and abs(work) < 1e-9
    assert 0.0 < 0.06 - state[0, -1] < 0.02  # of the gap
    closing = isotropic(-1.0 / 3.0, 4)
    advance_rows(law, stress, 0.5 * state[0, -1] * closing, state, 1e-4)
    assert abs(stress).max() < 1e-9
    advance_rows(law, stress, (state[0, -1] + 2e-5) * closing, state, 1e-4)
    assert mean(stress)[0] == pytest.approx(-2e-5 * K, rel=1e-6)
