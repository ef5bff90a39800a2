"""NorSand: peak dilatancy, critical state, liquefaction, the rate equations, tip, opening, dissipation."""

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from periporo.core.numerics.tensors import equivalent_shear, mean
from periporo.materials import built_in_path, drive
from periporo.materials.norsand import NorSand

SAND = NorSand.example()
M, GAMMA, LAMBDA, CHI = 1.25, 0.9, 0.03, 4.0
IDS, VOLUME = np.zeros((1, 2), np.int64), np.ones(1)
COMPRESSION, EXTENSION = np.array([0.5, -1.0, 0.5, 0, 0, 0]), np.array([-0.5, 1.0, -0.5, 0, 0, 0])


def sand(**changes):
    return NorSand(**(SAND.model_dump(exclude_none=True) | changes))


def at(pressure, law, components=6):
    stress = np.zeros((1, components))
    stress[:, :3] = -pressure
    return stress, law.initial_state(stress, IDS, VOLUME)


def sheared(law, direction, strain, steps, pressure=1e5):
    """p and q after each step of a strain at constant volume, and the state."""
    stress, state = at(pressure, law, len(direction))
    path = []
    for _ in range(steps):
        law.compute_stress(stress, strain / steps * direction[None], state, np.inf)
        path.append((-mean(stress)[0], equivalent_shear(stress)[0]))
    return np.array(path).T, stress, state


@pytest.mark.parametrize("state", [-0.05, -0.15])
def test_at_the_peak_the_dilatancy_is_chi_psi(state):
    """Drained triaxial compression without coupling: D = chi psi and q/p = M - chi psi (Jefferies & Been 2015)."""
    law = sand(coupling=0.0, initial_state_parameter=state)
    result = drive(law, built_in_path("triaxial", "confining=1e5,strain=0.12,rows=1200"))
    ratio = result["q_over_p"]
    k = int(np.argmax(ratio))
    psi = result["state_parameter"][k]
    assert 10 < k < 1100 and ratio[k] == pytest.approx(M - CHI * psi, rel=2e-3)
    around = slice(k - 5, k + 6)
    volume, axial = np.log1p(result["void_ratio"][around]), result["strain_yy"][around]
    expansion = -np.polyfit(axial, volume, 1)[0]  # d eps_v/d eps_a
    assert -expansion / (1 + expansion / 3) == pytest.approx(CHI * psi, rel=0.02)


@pytest.mark.parametrize("direction, slope", [(COMPRESSION, M), (EXTENSION, 3 * M / (3 + M))])
def test_sheared_far_at_constant_volume_it_comes_to_the_critical_state(direction, slope):
    """p = exp((Gamma - e)/lambda) kPa; one angle of friction in compression and extension."""
    law = sand(initial_state_parameter=0.02)
    (p, q), _, state = sheared(law, direction, 0.8, 2000)
    assert p[-1] == pytest.approx(1e3 * np.exp((GAMMA - state[0, 1]) / LAMBDA), rel=2e-3)
    assert q[-1] / p[-1] == pytest.approx(slope, rel=1e-3)


def test_in_plane_strain_the_critical_angle_is_that_which_it_tells():
    law = sand(initial_state_parameter=0.0)
    _, stress, _ = sheared(law, np.array([0.5, -0.5, 0.0, 0.3]), 0.8, 2000)
    mid, radius = 0.5 * (stress[0, 0] + stress[0, 1]), np.hypot(0.5 * (stress[0, 0] - stress[0, 1]), stress[0, 3])
    assert np.degrees(np.arcsin(-radius / mid)) == pytest.approx(law.friction_angles(2).plane_strain, rel=1e-3)
    assert stress[0, 2] == pytest.approx(mid, rel=1e-3)


def test_very_loose_sand_liquefies():
    """Undrained strength has a peak, and falls to that of the critical state."""
    (p, q), _, _ = sheared(sand(initial_state_parameter=0.1), COMPRESSION, 0.3, 3000)
    peak = int(np.argmax(q))
    assert q[-1] < 0.2 * q[peak] and q[peak] / p[peak] < 0.9 * M
    assert q[-1] / p[-1] == pytest.approx(M, rel=0.02)


@pytest.mark.parametrize("state", [-0.08, 0.06])
def test_steps_follow_the_rate_equations(state):
    """Compression with some change of volume; the error falls with the step."""
    law = sand(initial_state_parameter=state, overconsolidation_ratio=1.0)
    ratio = 2 / 3 * 1.2 / 0.6  # K/G at nu = 0.2
    chi = CHI / (1 - CHI * LAMBDA / M)
    volume, shear = 0.002, 0.02
    _, start = at(1e5, law)

    def share(image, void):
        psi = void - GAMMA + LAMBDA * np.log(image / 1e3)
        return 1 - 0.35 * chi * abs(psi) / M, psi

    def surface(p, q, image, void):
        return q - M * share(image, void)[0] * p * (1 + np.log(image / p))

    def rates(_, y):
        p, q, image, void = y
        g_mod = 40e6 * (p / 1e5) ** 0.5
        own, psi = share(image, void)
        flow = M * own - q / p
        growth = 100 * (p / image) ** 2 * (np.exp(-chi * psi / (M * own)) - image / p) * image
        f, steps = surface(*y), y * 1e-7
        slope = [(surface(*(y + steps * (np.arange(4) == k))) - f) / steps[k] for k in range(4)]
        elastic = np.array([ratio * g_mod * volume, 3 * g_mod * shear, 0.0, -(1 + void) * volume])
        plastic = np.array([-ratio * g_mod * flow, -3 * g_mod, growth, 0.0])
        return elastic + max(-(slope @ elastic) / (slope @ plastic), 0.0) * plastic

    solved = solve_ivp(rates, (0, 1), [1e5, 1.0, start[0, 0], start[0, 1]], rtol=1e-9, atol=1e-6, max_step=1e-3)
    wanted = solved.y[:, -1]
    errors = []
    for steps in (100, 400):
        stress, its = at(1e5, law)
        for _ in range(steps):
            law.compute_stress(stress, (shear * COMPRESSION - volume / 3 * (np.arange(6) < 3))[None] / steps, its, 1.0)
        found = np.array([-mean(stress)[0], equivalent_shear(stress)[0], *its[0, :2]])
        errors.append(np.abs(found / wanted - 1).max())
    assert errors[1] < 4e-3 and errors[1] < 0.35 * errors[0]


@pytest.mark.parametrize("exponent", [0.0, 0.5, 1.0])
def test_pressure_alone_is_elastic_and_takes_the_surface_along(exponent):
    """dP/de = K (P/P_ref)^n, exact in one step; the image pressure is 1/e of the pressure."""
    law = sand(pressure_exponent=exponent, overconsolidation_ratio=1.0)
    stress, state = at(1e5, law)
    law.compute_stress(stress, np.full((1, 6), -0.001) * [1, 1, 1, 0, 0, 0], state, 1.0)
    x = 40e6 * 4 / 3 * 0.003 / 1e5
    grown = np.exp(x) if exponent == 1.0 else (1 + (1 - exponent) * x) ** (1 / (1 - exponent))
    np.testing.assert_allclose(-stress[0, :3], 1e5 * grown, rtol=1e-12)
    assert state[0, 0] == pytest.approx(1e5 * grown / np.e, rel=1e-12)


def test_what_expands_beyond_the_smallest_pressure_opens():
    stress, state = at(1e4, SAND, 4)
    void = state[0, 1]
    law_strain = 2 * (np.sqrt(1e4) - np.sqrt(10.0)) * np.sqrt(1e5) / (40e6 * 4 / 3)
    SAND.compute_stress(stress, np.array([[0.002, 0.002, 0.002, 0.001]]), state, 1.0)
    np.testing.assert_allclose(stress[0], [-10, -10, -10, 0])
    assert state[0, 2] == pytest.approx(0.006 - law_strain, rel=1e-10)
    assert state[0, 1] == pytest.approx((1 + void) * np.exp(law_strain) - 1, rel=1e-12)


def test_dissipation_is_the_plastic_work():
    """sigma : d eps_p, with the elastic strain of the step's moduli; it is positive."""
    law = sand(report_dissipation=True)
    rng = np.random.default_rng(0)
    stress, state = at(1e5, law)
    for _ in range(30):
        law.compute_stress(stress, 1e-3 * COMPRESSION[None], state, 1.0)
    weight = np.array([1, 1, 1, 2, 2, 2.0])
    for _ in range(20):
        strain = 2e-6 * (COMPRESSION + 0.3 * rng.normal(size=6))[None]
        before = stress.copy()
        law.compute_stress(stress, strain, state, 1.0)
        bulk, shear = law.elastic_moduli(stress, state)
        change, volume = stress - before, (stress - before)[:, :3].mean()
        elastic = (change - volume * (np.arange(6) < 3)) / (2 * shear) + volume / (3 * bulk) * (np.arange(6) < 3)
        work = np.sum(weight * stress * (strain - elastic))
        assert state[0, 3] > 0 and state[0, 3] == pytest.approx(work, rel=5e-3)


def test_strength_reduction_divides_the_tangent_of_the_critical_angle():
    angle = np.tan(np.radians(SAND.friction_angles(3).compression))
    assert np.tan(np.radians(SAND.weakened(1.4).friction_angles(3).compression)) == pytest.approx(angle / 1.4)


@pytest.mark.parametrize("change, message", [
    ({"initial_void_ratio": 0.7}, "one of them"),
    ({"poisson_ratio": 0.45}, "poisson_ratio .0.45. is too large"),
    ({"dilatancy": 10.0, "compression_index": 0.2}, "must be below critical_state_slope"),
])  # fmt: skip
def test_parameters_that_contradict_each_other_are_refused(change, message):
    with pytest.raises(ValidationError, match=message):
        sand(**change)


def test_a_state_that_no_soil_has_is_doubted():
    law = sand(initial_state_parameter=0.5)
    assert "0.5" in law.doubts(*at(1e5, law))["state parameter"]
    assert SAND.doubts(*at(1e5, SAND)) == {}
