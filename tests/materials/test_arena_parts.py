"""The parts of Arena one by one: closed forms, limits, options, rules and failures."""

import math

import numpy as np
import pytest
from mpi4py import MPI
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from periporo.core.numerics import tensors
from periporo.core.points import fields
from periporo.core.points.material import UpdatesFailed, state_column
from periporo.core.points.opening import advance_rows
from periporo.core.scene.build import build, output_names
from periporo.errors import InputError
from periporo.io.input.load import parse_scene
from periporo.materials.arena import Arena
from periporo.materials.arena.variability import strength_factors
from periporo.materials.friction import angles_of_cone

QUASISTATIC = {"T1": 0.0, "T2": 0.0}
ISOTROPIC = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) / 3.0


def start(material, rows=1, components=6):
    stress = np.zeros((rows, components))
    ids = np.repeat(np.arange(rows)[:, None], 2, axis=1)
    return stress, material.initial_state(stress, ids, np.full(rows, 1e-3))


def strained(material, *increments, steps=1, dt=1.0):
    """Stress and state of one row after volumetric (a number) or full increments."""
    stress, state = start(material)
    for increment in increments:
        full = increment * ISOTROPIC if np.isscalar(increment) else np.asarray(increment, float)
        for _ in range(steps):
            material.compute_stress(stress, full[None] / steps, state, dt / steps)
    return stress, state


def column(material, state, name):
    """A scalar of the state, (n,)."""
    return state[:, state_column(material, name, 6)]


def quasistatic(material, state):
    """The quasi-static stress in the state, (n, 6) Pa."""
    first = state_column(material, "quasistatic_stress", 6)
    return state[:, first : first + 6]


def random_strains(rows, size, seed=1):
    return np.random.default_rng(seed).normal(size=(rows, 6)) * size


@pytest.mark.parametrize("saturation", [0.0, 0.3, 0.9, 0.999, 1.0])
@pytest.mark.parametrize("pressure", [0.0, 3e5])
@pytest.mark.parametrize("water", ["logarithmic", "secant"])
@pytest.mark.parametrize("fluids", [(2.21e9, 6.029, 1e-4, 1.4, 101325.0), (1.5e9, 5.0, 1e3, 1.2, 9e4)])
def test_pore_volume_balance(saturation, pressure, water, fluids):
    """Air and water fill the pores that compaction leaves, whatever the path to it, by the constants of the input."""
    bulk, slope, reference, exponent, outside = fluids
    material = Arena(
        **QUASISTATIC, initial_saturation=saturation, initial_fluid_pressure=pressure, water_strain=water,
        water_bulk_modulus=bulk, water_slope=slope, water_reference_pressure=reference, air_exponent=exponent,
        atmospheric_pressure=outside,
    )  # fmt: skip
    stress, state = strained(material, -0.05, 0.002, [-0.05, 0, 0.01, 0.02, 0, 0])
    evp, p = state[0, :2]
    stiffness = bulk + slope * (p - reference)
    start_stiffness = bulk + slope * (pressure - reference)
    liquid = (stiffness / start_stiffness) ** (-1 / slope)
    if water == "secant":
        liquid = math.exp(-(p - pressure) / stiffness)
    air = ((p + outside) / (pressure + outside)) ** (-1 / exponent)
    fluid = 0.4 * ((1 - saturation) * air + saturation * liquid)
    assert fluid == pytest.approx(math.exp(-evp) - 0.6, rel=1e-9)
    derived = material.derived_state(stress, state)
    assert derived["porosity"][0] == pytest.approx(1 - 0.6 * math.exp(evp), rel=1e-12)
    assert derived["saturation"][0] == pytest.approx(saturation * liquid * 0.4 / fluid, rel=1e-9)


def test_the_grains_are_those_of_the_input():
    """Loose dry soil has b0 of their bulk modulus K_s0 + n_s (p - p_s0) at little pressure (eqs 86, 88)."""
    dry = {"initial_saturation": 0.0, "initial_porosity": 0.42} | QUASISTATIC
    found = []
    for grains in ((40e9, 4.0, 101325.0), (70e9, 0.0, 0.0), (70e9, 1e3, 1e7)):
        keys = dict(zip(("grain_bulk_modulus", "grain_slope", "grain_reference_pressure"), grains, strict=True))
        material, stress = Arena(**dry, **keys), np.array([[-1e-9, -1e-9, -1e-9, 0, 0, 0]])
        state = material.initial_state(stress, np.zeros((1, 2), np.int64), np.ones(1))
        found.append(material.elastic_moduli(stress, state)[0][0] / (grains[0] - grains[1] * grains[2]))
    np.testing.assert_allclose(found, material.b0, rtol=1e-4)


@pytest.mark.parametrize("p1_sat", [1.0, 0.4])
def test_crush_curve(p1_sat):
    """X_eff follows the printed crush curve at the plastic strain reached, scaled by density and water."""
    material = Arena(**QUASISTATIC, initial_saturation=0.6, p1_sat=p1_sat)
    stress, state = strained(material, -0.1)
    evp, p, x = state[0, :3]
    factor = math.exp(-0.4 / 0.6 + 0.42 / 0.58)
    p1 = 482.68e6 * math.exp(5 * factor * (factor - 1))
    assert (factor, p1) == pytest.approx((1.05915, 660.25e6), rel=1e-5)
    crush = p1 * ((1 - 0.6) / (1 - 0.6 * math.exp(evp)) - 1) ** (1 / 0.719)
    water = material.derived_state(stress, state)["saturation"][0]
    assert -(x + 3 * p) == pytest.approx(1e3 + (1 - water + p1_sat * water) * crush, rel=1e-9)
    assert tensors.mean(stress)[0] * 3 == pytest.approx(x, rel=1e-9)  # isotropic: at the nose of the cap


def test_tension_stops_at_the_vertex():
    """Dry: elastic with b0 K_s0 K_fac to I1 = PEAKI1, then all further strain opens the soil; its pores stay."""
    material = Arena(**QUASISTATIC, initial_saturation=0.0)
    bulk = 0.0029 * 40e9 * material.density_factor
    stress, _ = strained(material, 1e-6)
    assert tensors.mean(stress)[0] == pytest.approx(bulk * 1e-6, rel=1e-12)
    stress, state = strained(material, 0.01)
    assert tensors.mean(stress)[0] == pytest.approx(1000 / 3, rel=1e-9)
    assert column(material, state, "opened")[0] == pytest.approx(0.01 - 1000 / 3 / bulk, rel=1e-9)
    assert state[0, :2].tolist() == [0.0, 0.0]
    assert material.derived_state(stress, state)["porosity"][0] == pytest.approx(0.4, rel=1e-14)


@pytest.mark.parametrize("parameters", [{}, {"p0": 1e6}, {"initial_saturation": 1.0, "initial_fluid_pressure": 2e5}])
def test_soil_that_has_come_apart_bears_nothing_until_it_has_closed(parameters):
    """Loose, firm, and saturated under pressure: water is let free first, and takes the pressure again at last."""
    material = Arena(**QUASISTATIC, **parameters)
    stress, state = start(material)
    pulled = []
    for change in (4e-3, 8e-3, -6e-3, -6e-3):
        advance_rows(material, stress, change * ISOTROPIC[None], state, 1.0)
        pulled.append((tensors.mean(stress)[0], state[0, 1], column(material, state, "opened")[0]))
    means, pressures, opened = np.array(pulled).T
    np.testing.assert_allclose(means[:3], 1000 / 3, rtol=1e-9)
    np.testing.assert_array_equal(pressures[:3], 0.0)
    assert 0 < 4e-3 - opened[0] < 1e-4 and opened[1:3] - opened[0] == pytest.approx([8e-3, 2e-3], rel=1e-9)
    fluid = material.initial_fluid_pressure
    assert opened[3] == 0.0 and means[3] + pressures[3] == pytest.approx(0.0, abs=340.0)  # effective
    assert pressures[3] == pytest.approx(fluid, rel=0.05)  # less what the grains took elastically


def test_open_soil_that_dilates_in_shear_fills_its_gap():
    material = Arena(initial_saturation=0.0)
    stress, state = start(material)
    advance_rows(material, stress, 0.01 * ISOTROPIC[None], state, 1e-3)
    opened = [column(material, state, "opened")[0]]
    for _ in range(20):
        advance_rows(material, stress, np.array([[0, 0, 0, 1e-4, 0, 0]]), state, 1e-3)
        opened.append(column(material, state, "opened")[0])
        assert tensors.mean(stress)[0] == pytest.approx(1000 / 3, rel=1e-6)
    assert np.abs(stress[0, 3:]).max() < 1e-3 and (np.diff(opened) <= 1e-12).all()


def test_saturated_cycle():
    """Default: the pore pressure falls with the stress; the manual's rule locks it in."""
    means = {}
    for rule in ("fluid", "drained"):
        material = Arena(**QUASISTATIC, initial_saturation=1.0, undrained_unloading=rule)
        stress, state = start(material)
        means[rule] = []
        for change in (-0.02, 0.03, -0.03):
            for _ in range(100):
                material.compute_stress(stress, change * ISOTROPIC[None] / 100, state, 1.0)
            means[rule].append(tensors.mean(stress)[0] / 1e6)
    assert means["fluid"] == pytest.approx([-58, 0, -59], abs=1.0)
    assert means["drained"] == pytest.approx([-58, -54, -160], abs=4.0)


def test_shear_modulus_in_tension():
    """By Poisson's ratio continuous at zero pressure, or the constant G0 (13 times larger)."""
    values = {}
    for rule in ("poisson", "constant"):
        material = Arena(**QUASISTATIC, initial_saturation=0.0, shear_modulus_in_tension=rule)
        stress, state = start(material)
        for i1 in (1e-9, -1e-9):
            stress[0, :3] = i1 / 3
            values[rule, i1 > 0] = material.elastic_moduli(stress, state)[1][0]
    assert values["poisson", True] == pytest.approx(values["poisson", False], rel=1e-4)
    assert values["constant", True] == pytest.approx(7e8 * material.density_factor, rel=1e-12)


def test_density_scaling_of_the_total_modulus():
    """Scaling the drained part changes the saturated K little; scaling the total one by K_fac."""
    k = {}
    for rule, reference in (("drained", 0.40), ("total", 0.42)):
        material = Arena(
            **QUASISTATIC, initial_saturation=1.0, density_scaling=rule, reference_porosity=reference
        )
        stress, state = start(material)
        stress[0, :3] = -100.0
        k[rule] = material.elastic_moduli(stress, state)[0][0]
    assert k["total"] / k["drained"] == pytest.approx(1.0591548, rel=1e-6)


def test_disaggregation():
    """Moduli times exp(evp - p3): 1 - initial_porosity at the start."""
    stress = np.full((1, 6), -1e5) * (ISOTROPIC > 0)
    bulk = []
    for on in (False, True):
        material = Arena(**QUASISTATIC, p0=1e6, initial_saturation=0.0, use_disaggregation_algorithm=on)
        bulk.append(material.elastic_moduli(stress, start(material)[1])[0][0])
    assert bulk[1] / bulk[0] == pytest.approx(0.6, rel=1e-12)


@pytest.mark.parametrize("saturation", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(("steps", "accuracy"), [(1, 2e-4), (200, 5e-5)])
def test_elastic_compression_integrates_the_moduli(saturation, steps, accuracy):
    """Large steps (substeps) and small ones (one call each) both follow dp = K dv, ds = 2 G de."""
    material = Arena(**QUASISTATIC, initial_saturation=saturation, p0=1e9)

    def rates(_, y):
        stress = np.zeros((1, 6))
        stress[0, :3] = -y[0]
        bulk, shear = material.elastic_moduli(stress, start(material)[1])
        return [bulk[0] * 8e-3, 2 * shear[0] * 2e-3]

    p, s12 = solve_ivp(rates, (0, 1), [1e-9, 0.0], "DOP853", rtol=1e-11, atol=1e-3).y[:, -1]
    increment = -8e-3 * ISOTROPIC + np.array([0, 0, 0, 2e-3, 0, 0])
    stress, state = strained(material, increment, steps=steps)
    assert state[0, 0] == 0.0
    assert -tensors.mean(stress)[0] == pytest.approx(p, rel=accuracy)
    assert stress[0, 3] == pytest.approx(s12, rel=accuracy)


def test_non_associativity():
    """Simple shear on the shear limit: -dev|p|/dgamma^p = 3 BETA^2 FSLOPE, normality in (z, r')."""
    for beta in (0.4, 1.0):
        material = Arena(
            **QUASISTATIC, initial_saturation=0.0, BETA=beta, p0=1e9, STREN=0.0, YSLOPE=0.0, FSLOPE=0.3
        )
        increment = np.array([0, 0, 0, 0.5, 0, 0])
        stress, state = start(material)
        material.compute_stress(stress, -1e-3 * ISOTROPIC[None], state, 1.0)
        for _ in range(100):
            material.compute_stress(stress, increment[None] * 1e-4, state, 1.0)
        before, volume = stress.copy(), state[0, 0]
        _, shear = material.elastic_moduli(stress, state)
        material.compute_stress(stress, increment[None] * 1e-7, state, 1.0)
        elastic = (stress - before)[0, 3] / shear[0] / 2
        plastic = 2 * (0.5e-7 - elastic)  # engineering shear
        assert material.yield_excess(stress, state)[0] == pytest.approx(0.0, abs=1e-9)
        assert -(state[0, 0] - volume) / plastic == pytest.approx(3 * beta**2 * 0.3, rel=2e-3)


@pytest.mark.parametrize(("beta", "acting"), [(0.8, 0.8), (1.0, 1.0), (1.2, 1.2), (2.0, 1.0)])
def test_plastic_work_on_the_shear_limit(beta, acting):
    """FSLOPE (PEAKI1 + 3 |p| (1 - BETA^2)) per shear: negative for BETA > 1, unless that acts on the cap alone."""
    options = {"BETA_acts_on": "cap"} if acting != beta else {"BETA_above_1": "allow"}
    material = Arena(
        **QUASISTATIC, initial_saturation=0.0, BETA=beta, **options, p0=1e9, STREN=0.0, YSLOPE=0.0, FSLOPE=0.3
    )
    stress, state = start(material)
    material.compute_stress(stress, -1e-3 * ISOTROPIC[None], state, 1.0)
    shear = np.array([[0, 0, 0, 0.5, 0, 0]])
    for _ in range(100):
        material.compute_stress(stress, shear * 1e-4, state, 1.0)
    before, volume = stress.copy(), state[0, 0]
    material.compute_stress(stress, shear * 1e-7, state, 1.0)
    middle, modulus = 0.5 * (before + stress), material.elastic_moduli(before, state)[1][0]
    plastic = 1e-7 - (stress - before)[0, 3] / modulus  # engineering shear
    pressure = -tensors.mean(middle)[0]
    work = middle[0, 3] * plastic + pressure * (state[0, 0] - volume)
    assert work == pytest.approx(0.3 * (1e3 + 3 * pressure * (1 - acting**2)) * plastic, rel=5e-3, abs=1e-3)
    assert (work < 0.0) == (acting > 1.0)


def test_overstress_decays_in_elastic_steps():
    """Unloading at rate r: the old overstress falls by exp(-dt/tau), tau = T1 r^-T2."""
    material = Arena(initial_saturation=0.0)
    stress, state = strained(material, [-0.05, 0, 0, 0, 0, 0], steps=50, dt=5e-5)
    over = stress - quasistatic(material, state)
    assert np.abs(over).max() > 1e5
    increment = np.array([[1e-6, 0, 0, 0, 0, 0]])
    dt, volume = 1e-5, state[0, 0]
    material.compute_stress(stress, increment, state, dt)
    assert state[0, 0] == volume
    decay = math.exp(-dt / (5e-5 * (1e-6 / dt) ** -0.5))
    assert decay < 0.95
    np.testing.assert_allclose(stress - quasistatic(material, state), decay * over, rtol=1e-9, atol=1e-3)


ELASTIC_PAIR = {  # K = K_s (b0 + b1/b3) and G = G0, both constant, and next to no air
    "initial_saturation": 0.0, "b1": 0.01, "b2": 1e-9, "b3": 2.0, "b4": 1.0, "nu1": 0.0, "nu2": 0.0, "G0": 2e8,
    "grain_slope": 0.0, "atmospheric_pressure": 1e-3, "reference_porosity": 0.4,
}  # fmt: skip


def elastic_energy(material, stress):
    """J/m^3 of the pair."""
    bulk = 40e9 * (0.0029 + 0.005)
    return tensors.mean(stress)[0] ** 2 / (2 * bulk) + tensors.deviator_norm(stress)[0] ** 2 / (4 * material.G0)


@pytest.mark.parametrize("viscous", [False, True])
@pytest.mark.parametrize("components", [4, 6])
def test_reported_dissipation_is_work_that_is_not_stored(viscous, components):
    """On the shear limit, on the cap, at the vertex, there and back, with and without overstress."""
    rate = {} if viscous else QUASISTATIC
    material = Arena(**ELASTIC_PAIR, **rate, p0=3e6, report_dissipation=True, tolerance=1e-5)
    stress, state = start(material, components=components)
    place = state_column(material, "dissipation", components)
    weight, work, lost = np.where(np.arange(components) < 3, 1.0, 2.0), 0.0, []
    legs = [[-4e-3] * 3 + [0, 0, 0], [0, 0, 0, 5e-3, 0, 0], [-0.01, 0, 0, 2e-3, 0, 0], [6e-3, 2e-3, 0, -4e-3, 0, 0],
            [8e-3] * 3 + [0, 0, 0]]  # fmt: skip
    for leg in legs:
        spent = 0.0
        for _ in range(200):
            before, increment = stress.copy(), np.array([leg[:components]]) / 200
            advance_rows(material, stress, increment.copy(), state, 1e-6)
            work += float(weight @ (0.5 * (before + stress) * increment)[0])
            spent += state[0, place]
        lost.append(spent)
        assert sum(lost) == pytest.approx(work - elastic_energy(material, stress), rel=2e-3, abs=1.0)
    assert min(lost) > 1.0 and state[0, state_column(material, "opened", components)] > 1e-3


def test_plastic_strain_is_the_strain_that_is_not_elastic():
    """Its deviator is e - s/2G with a constant G, its trace -evp; the length of isotropic compaction is evp/sqrt(3)."""
    material = Arena(**ELASTIC_PAIR, **QUASISTATIC, report_plastic_strain=True)
    stress, state = strained(material, -0.03, steps=20)
    first, last = (state_column(material, name, 6) for name in ("plastic_strain", "plastic_strain_length"))
    assert state[0, last] == pytest.approx(state[0, 0] / math.sqrt(3), rel=1e-9)
    strain = -0.03 * ISOTROPIC
    for increment in ([0, 0, 0, 0.01, -0.005, 0.003], [-0.01, 0.004, 0, -0.015, 0, 0]):
        length = state[0, last]
        before = state[:, first : first + 6].copy()
        for _ in range(50):
            material.compute_stress(stress, np.array([increment]) / 50, state, 1.0)
        strain = strain + increment
        plastic = state[:, first : first + 6]
        assert 3 * tensors.mean(plastic)[0] == pytest.approx(-state[0, 0], rel=1e-9)
        expected = strain - stress[0] / (2 * material.G0)
        np.testing.assert_allclose((plastic - expected)[0, 3:], 0.0, atol=1e-9)
        np.testing.assert_allclose(np.diff((plastic - expected)[0, :3]), 0.0, atol=1e-9)
        change = (plastic - before)[0]
        assert state[0, last] - length >= math.sqrt(change[:3] @ change[:3] + 2 * change[3:] @ change[3:]) > 1e-3


@pytest.mark.parametrize("pair", [{}, {"nu1": 0.0, "nu2": 0.0, "G0": 7e7}])
def test_what_a_closed_elastic_cycle_loses(pair):
    """G that follows the pressure has no potential: shear by b, compress, unshear, decompress takes 2 (G_2 - G_1) b^2.

    With Poisson's ratio 0 the shear modulus is G0, which has one with any K(p): nothing is lost.
    """
    material = Arena(**QUASISTATIC, **pair, initial_saturation=0.0, p0=1e9, tolerance=1e-6)
    size, shear = 1e-4, np.array([0, 0, 0, 1e-4, 0, 0])
    stress, state = strained(material, -3e-3, steps=10)
    pressed, same = strained(material, -4e-3, steps=10)
    moduli = [material.elastic_moduli(*rows)[1][0] for rows in ((stress, state), (pressed, same))]
    work = 0.0
    for leg in (shear, -1e-3 * ISOTROPIC, -shear, 1e-3 * ISOTROPIC):
        for _ in range(50):
            before, increment = stress.copy(), leg[None] / 50
            material.compute_stress(stress, increment, state, 1.0)
            middle = 0.5 * (before + stress)
            work += float(middle[0, :3] @ increment[0, :3] + 2 * middle[0, 3:] @ increment[0, 3:])
    assert state[0, 0] == 0.0
    share = work / (2 * moduli[0] * size**2)
    assert share == pytest.approx(moduli[1] / moduli[0] - 1.0, rel=0.02, abs=1e-5) and (share > 0.1) == (not pair)


def test_infinite_time_step_is_inviscid():
    viscous = strained(Arena(), [-0.02, 0, 0, 0.01, 0, 0], dt=math.inf)[0]
    inviscid = strained(Arena(**QUASISTATIC), [-0.02, 0, 0, 0.01, 0, 0], dt=1.0)[0]
    np.testing.assert_allclose(viscous, inviscid, rtol=1e-12)


def test_damage_lowers_the_vertex():
    """Pulled at constant rate all strain is plastic: t_grow is the time, PEAKI1 falls with coherence."""
    material = Arena(**QUASISTATIC, initial_saturation=0.0, do_damage=True, time_at_failure=1.0)
    for time in (0.5, 1.0, 1.5):
        stress, state = strained(material, 0.5 * time, steps=50, dt=time)
        assert column(material, state, "damage_time")[0] == pytest.approx(time, rel=2e-5)
        coherence = 1 / (1 + math.exp(-7 * (1 - column(material, state, "damage_time")[0])))
        assert material.derived_state(stress, state)["coherence"][0] == pytest.approx(coherence, rel=1e-9)
        peak = coherence * 1e3 + (1 - coherence) * 1e-5
        assert 3 * tensors.mean(stress)[0] == pytest.approx(peak, rel=1e-6)


def test_damage_grows_on_the_shear_limit_and_on_the_cap_if_asked_to():
    """Isotropic compaction of .12 in 1.6 ms leaves sand coherent: it is not on the limit surface (manual, eq. 266)."""
    coherence, sheared = {}, {}
    for surface in ("shear_limit", "surface"):
        material = Arena(**QUASISTATIC, initial_saturation=0.0, do_damage=True, damage_grows_on=surface)
        stress, state = strained(material, -0.12, steps=20, dt=1.6e-3)
        coherence[surface] = material.derived_state(stress, state)["coherence"][0]
        firm = Arena(**material.model_dump() | {"p0": 1e9})
        state = strained(firm, -1e-3, [0, 0, 0, 0.01, 0, 0], steps=50, dt=5e-4)[1]
        sheared[surface] = column(firm, state, "damage_time")[0]
    assert coherence["shear_limit"] == pytest.approx(1 / (1 + math.exp(-7)), rel=1e-3)
    assert 0.03 < coherence["surface"] < 0.06
    assert sheared["shear_limit"] == sheared["surface"] > 1e-4


@pytest.mark.filterwarnings("error")
def test_coherence_of_soil_that_failed_long_ago_is_zero():
    material = Arena(**QUASISTATIC, initial_saturation=0.0, do_damage=True)
    stress, state = strained(material, 0.0)
    column(material, state, "damage_time")[:] = 1e3
    assert material.derived_state(stress, state)["coherence"][0] == 0.0


def test_no_damage_without_time_or_yield():
    material = Arena(**QUASISTATIC, initial_saturation=0.0, do_damage=True)
    for strain, dt in ((0.01, math.inf), (1e-7, 1.0)):
        assert column(material, strained(material, strain, dt=dt)[1], "damage_time")[0] == 0.0


def test_weibull_distribution_of_points_and_bonds():
    """Points and bonds follow the same Weibull law; draws depend on ids alone; seed 0 draws nothing."""
    n = 40_000
    points = np.repeat(np.arange(n)[:, None], 2, axis=1)
    bonds = np.stack([np.arange(0, 2 * n, 2), np.arange(1, 2 * n, 2)], axis=1)
    volume = np.full(n, 1e-6)
    size = (1e-3 / 1e-6) ** 0.25
    for ids in (points, bonds):
        factor = strength_factors(ids, volume, 4.0, 4.0, 1e-3, 7)
        share = 1 - np.exp(-((np.sort(factor) / size * math.gamma(1.25)) ** 4))
        assert np.abs(share - (np.arange(n) + 0.5) / n).max() < 1.6 / math.sqrt(n)  # Kolmogorov-Smirnov
        assert factor.mean() == pytest.approx(size, rel=0.01)
        order = np.random.default_rng(0).permutation(n)
        np.testing.assert_array_equal(strength_factors(ids[order], volume, 4.0, 4.0, 1e-3, 7), factor[order])
    swapped = strength_factors(bonds[:, ::-1], volume, 4.0, 4.0, 1e-3, 7)
    np.testing.assert_array_equal(swapped, factor)
    np.testing.assert_allclose(strength_factors(bonds, volume, 4.0, 4.0, 1e-3, 0), size, rtol=1e-14)


def test_every_strength_may_have_a_weibull_law_of_its_own():
    """y = (V_ref/V)^(1/m) mean E^(1/a)/Gamma(1 + 1/a): the deck of the manual, eq. 284."""
    n, volume = 500, 2e-4
    laws = {"PEAKI1": (4.0, 6.0, 1e-3, 1), "FSLOPE": (20.0, 20.0, 1e-3, 1), "STREN": (8.0, 8.0, 5e-4, 1),
            "YSLOPE": (20.0, 20.0, 1e-3, 1)}  # fmt: skip
    keys = ("weibull_modulus", "weibull_exponent", "weibull_reference_volume", "weibull_seed")
    given = {key: {name: law[k] for name, law in laws.items()} for k, key in enumerate(keys)}
    del given["weibull_exponent"]["STREN"], given["weibull_seed"]["YSLOPE"]  # the modulus, and 1
    material = Arena(**QUASISTATIC, initial_saturation=0.0, do_variability=True, **given)
    ids = np.repeat(np.arange(n)[:, None], 2, axis=1)
    state = material.initial_state(np.zeros((n, 6)), ids, np.full(n, volume))
    alike = strength_factors(ids, np.ones(n), 1.0, 1.0, 1.0, 1)  # E itself, for Gamma(2) = 1
    for name, (a, m, reference, _) in laws.items():
        expected = (reference / volume) ** (1 / m) * alike ** (1 / a) / math.gamma(1 + 1 / a)
        np.testing.assert_allclose(column(material, state, f"{name}_factor"), expected, rtol=1e-12)
    stress = np.zeros((n, 6))
    material.compute_stress(stress, np.tile(0.01 * ISOTROPIC, (n, 1)), state, 1.0)
    np.testing.assert_allclose(3 * tensors.mean(stress), 1e3 * column(material, state, "PEAKI1_factor"), rtol=1e-6)
    plain = Arena(do_variability=True, weibull_modulus={"PEAKI1": 4.0, "FSLOPE": 4.0})
    assert plain.scatter_is_common and "strength_factor" in [f.name for f in plain.state_fields]
    unlike = Arena(do_variability=True, weibull_seed={"FSLOPE": 5})
    with pytest.raises(ValueError, match=r"against the rules .*FSLOPE > YSLOPE.*draw alike"):
        unlike.initial_state(np.zeros((n, 6)), ids, np.full(n, volume))


@pytest.mark.parametrize(
    ("fslope", "volume", "components", "words"),
    [
        (0.1, 1e-3, 4, None), (0.1, 1e-3, 6, None),
        (0.1, 1e-6, 6, "times a strength factor of 5.62 has an angle of friction of"),
        (0.1, 1e-6, 4, "size effect makes points that are smaller"), (0.3, 5e-4, 4, "no limit in plane strain"),
    ],
)  # fmt: skip
def test_a_size_effect_beyond_reason_is_doubted(fslope, volume, components, words):
    """57 degrees at FSLOPE 0.56 in compression, no limit in the plane; and a cone that dilates out of the plane."""
    law = Arena(FSLOPE=fslope, YSLOPE=0.05, do_variability=True, weibull_seed=0)
    stress = np.zeros((2, components))
    state = law.initial_state(stress, np.zeros((2, 2), np.int64), np.full(2, volume))
    doubts = law.doubts(stress, state)
    assert doubts == {} if words is None else words in doubts["friction"]
    assert angles_of_cone(1.2, 1.8).plane_strain is None and angles_of_cone(0.5).plane_strain == pytest.approx(30.0)


def test_porosity_saturation_and_density_follow_from_a_sample():
    """Dry density and water content (eqs 253, 258, 260), as bar tests tell them; what contradicts them is refused."""
    sample = {"dry_density": 1520.0, "water_content": 0.184, "grain_density": 2650.0, "water_density": 1000.0}
    material = Arena(**sample)
    porosity = 1 - 1520 / 2650
    assert material.initial_porosity == pytest.approx(porosity, rel=1e-14)
    assert material.initial_saturation == pytest.approx(0.184 * 1520 / (1000 * porosity), rel=1e-14)
    assert material.density == pytest.approx(1520 + porosity * material.initial_saturation * 1000, rel=1e-14)
    assert Arena(**material.model_dump()) == material


ROCK = {"model": "elastic", "density": 2500.0, "bulk_modulus": 1e9, "shear_modulus": 5e8}
SCENE = {
    "dimension": 2,
    "spacing": 0.01,
    "materials": {"sand": {"model": "arena", "do_variability": True, "weibull_seed": 0}},
    "bodies": [
        {"name": "b", "material": "sand", "shape": {"type": "box", "lower": [0.0, 0.0], "upper": [0.05, 0.04]}}
    ],
    "stages": [{"name": "s", "type": "dynamics", "duration": 1e-3}],
}


@pytest.mark.parametrize("scheme", ["bond_projected", "sub_horizon", "standard"])
def test_size_effect_goes_by_the_volume_of_the_points(scheme):
    """All rows of a regular grid have the strength of a specimen of one cell, whatever their share of it."""
    sim = build(parse_scene({**SCENE, "correspondence": scheme}), MPI.COMM_SELF)
    sim.start()
    block = sim.bonds.blocks[0]
    column = [f.name for f in block.material.state_fields].index("strength_factor")
    factors = block.state[block.active, column]
    assert len(factors) >= 20
    np.testing.assert_allclose(factors, (1e-3 / 0.01**2) ** 0.25, rtol=1e-12)


def test_what_matters_is_written_without_being_asked_for():
    """Porosity, saturation, pore pressure, coherence: of the points' state, and 0 where a point has none."""
    sand = {"model": "arena", "do_damage": True, "initial_fluid_pressure": 1e4, "initial_porosity": 0.37}
    scene = {**SCENE, "materials": {"sand": sand, "rock": ROCK}, "correspondence": "point_state", "bodies": [
        *SCENE["bodies"],
        {"name": "r", "material": "rock", "shape": {"type": "box", "lower": [0.1, 0.0], "upper": [0.15, 0.04]}},
    ]}  # fmt: skip
    parsed = parse_scene(scene)
    sim = build(parsed, MPI.COMM_SELF)
    sim.start()
    names = output_names(parsed, sim)
    assert {"pore_pressure", "porosity", "saturation", "coherence"} < set(names) and "kappa" not in names
    found = fields.values(sim, (*names, "kappa", "stress"))
    sand_points = found["material"] == 0
    expected = {"porosity": 0.37, "saturation": 0.5, "pore_pressure": 1e4, "coherence": 1 / (1 + math.exp(-7.0))}
    for name, value in expected.items():
        np.testing.assert_allclose(found[name][sand_points], value, rtol=1e-9)
        assert not found[name][~sand_points].any()
    assert (found["kappa"][sand_points] < 0).all() and fields.available(sim)["kappa"].unit == "Pa"


def test_bond_of_unlike_points_has_the_size_of_their_mean(tmp_path):
    volume = np.tile([1e-4, 3e-4], 10)  # by column
    lines = [f"{0.01 * (k % 4)},{0.01 * (k // 4)},{v}" for k, v in enumerate(volume)]
    (tmp_path / "points.csv").write_text("\n".join(["x,y,volume", *lines]))
    shape = {"type": "points", "file": "points.csv"}
    bodies = [{"name": "b", "material": "sand", "shape": shape}]
    sim = build(parse_scene({**SCENE, "correspondence": "bond_projected", "bodies": bodies}, tmp_path), MPI.COMM_SELF)
    sim.start()
    block = sim.bonds.blocks[0]
    mean = volume[sim.bonds.pairs.ids[block.pair[block.active]]].mean(axis=1)
    assert np.unique(np.round(mean, 9)).tolist() == [1e-4, 2e-4, 3e-4]
    factors = column(block.material, block.state, "strength_factor")[block.active]
    np.testing.assert_allclose(factors, (1e-3 / mean) ** 0.25, rtol=1e-12)


def test_scene_that_gives_suction_to_arena_is_refused():
    water = {"suction": 1e4, "retention": {"set": "fitted"}}
    with pytest.raises(InputError, match="'arena' has its own pore pressure; remove 'pore_water'"):
        parse_scene({**SCENE, "pore_water": water})


def test_strength_factor_scales_the_surface():
    """Vertex of a row in tension: PEAKI1 times its factor."""
    material = Arena(**QUASISTATIC, initial_saturation=0.0, do_variability=True)
    stress, state = start(material, rows=5)
    factors = column(material, state, "strength_factor").copy()
    assert factors.std() > 0.05
    material.compute_stress(stress, np.tile(0.01 * ISOTROPIC, (5, 1)), state, 1.0)
    np.testing.assert_allclose(3 * tensors.mean(stress), 1e3 * factors, rtol=1e-6)
    np.testing.assert_array_equal(column(material, state, "strength_factor"), factors)


def test_initial_fluid_pressure():
    """A row without stress starts at minus the fluid pressure, free of effective stress."""
    material = Arena(**QUASISTATIC, initial_fluid_pressure=5e4)
    stress, state = start(material)
    np.testing.assert_array_equal(stress[0], [-5e4, -5e4, -5e4, 0, 0, 0])
    np.testing.assert_allclose(state[0, :3], [0, 5e4, -1e3 - 1.5e5], atol=1e-6)


def drained_bulk(material, i1):
    """Drained bulk modulus (Pa) at effective I1, from a dry soil of the same parameters."""
    changes = {"initial_saturation": 0.0, "initial_fluid_pressure": 0.0, "pore_pressure": "plastic", "p0": 1e9}
    dry = Arena(**material.model_dump() | changes)
    return dry.elastic_moduli(i1 * ISOTROPIC[None], dry.initial_state(np.zeros((1, 6)), None, np.ones(1)))[0][0]


@pytest.mark.parametrize("fluid_pressure", [0.0, 2e5])
@pytest.mark.parametrize("saturation", [0.0, 0.5, 0.97, 1.0])
def test_skempton_coefficient(saturation, fluid_pressure):
    """Undrained elastic compression: dp_w/dp = (1/K_d - 1/K_s)/[1/K_d - 1/K_s + phi (1/K_f - 1/K_s)] (Bishop 1973)."""
    start_of = {"initial_saturation": saturation, "initial_fluid_pressure": fluid_pressure}
    material = Arena(**QUASISTATIC, **start_of, p0=1e9, pore_pressure="total")
    stress, state = strained(material, -1e-3)
    p, effective = state[0, 1], 3 * tensors.mean(stress)[0] + 3 * state[0, 1]
    wet = material.derived_state(stress, state)["saturation"][0]
    fluid = 1 / (wet / (2.21e9 + 6.029 * p) + (1 - wet) / (1.4 * (p + 101325)))
    grain, bulk = 40e9 + 4 * (-effective / 3 - 101325), drained_bulk(material, effective)
    skeleton = 1 / bulk - 1 / grain
    expected = skeleton / (skeleton + 0.4 * (1 / fluid - 1 / grain))
    before = tensors.mean(stress)[0]
    material.compute_stress(stress, -1e-8 * ISOTROPIC[None], state, 1.0)
    assert state[0, 0] == 0.0
    assert (state[0, 1] - p) / (before - tensors.mean(stress)[0]) == pytest.approx(expected, rel=1e-4)
    assert saturation < 1.0 or expected > 0.9
    plastic = Arena(**material.model_dump() | {"pore_pressure": "plastic"})
    assert strained(plastic, -1e-3)[1][0, 1] == pytest.approx(fluid_pressure, rel=1e-12)  # the default: no change


@pytest.mark.parametrize("saturation", [0.0, 0.5, 1.0])
def test_elastic_pore_pressure_goes_as_it_came(saturation):
    """To the accuracy of the integration; and on the cap the plastic part stays."""
    material = Arena(**QUASISTATIC, initial_saturation=saturation, p0=1e9, pore_pressure="total", tolerance=1e-5)
    peak = strained(material, -5e-3)[1][0, 1]
    assert peak > (1e3 if saturation < 1 else 1e7)
    stress, state = strained(material, -5e-3, 5e-3)
    assert abs(state[0, 1]) < 2e-3 * peak and state[0, 0] == 0.0
    loose = Arena(**material.model_dump() | {"p0": 1e3})
    stress, state = strained(loose, -0.05, 2e-4)
    balance = 0.4 * ((1 - saturation) * ((state[0, 1] + 101325) / 101325) ** (-1 / 1.4)
                     + saturation * ((2.21e9 + 6.029 * state[0, 1]) / 2.21e9) ** (-1 / 6.029))  # fmt: skip
    assert math.exp(-state[0, 0]) - 0.6 == pytest.approx(balance * state[0, 3] / 0.4, rel=1e-6)


def test_water_is_not_made_in_dilation():
    """The pores of saturated soil that dilates are not full: phi S stays, and the fluid stiffens it no longer."""
    material = Arena(**QUASISTATIC, initial_saturation=1.0)
    stress, state = strained(material, [0.03, 0.03, 0.03, 0.2, 0, 0], steps=20)
    derived = material.derived_state(stress, state)
    porosity, saturation = derived["porosity"][0], derived["saturation"][0]
    assert porosity > 0.44 and state[0, 1] == 0.0 and column(material, state, "opened")[0] < 1e-3
    assert porosity * saturation / (1 - porosity) == pytest.approx(0.4 / 0.6, rel=1e-9)
    stress[0, :3] = -1e3
    assert material.elastic_moduli(stress, state)[0][0] < 1.05 * drained_bulk(material, -3e3)
    for _ in range(20):
        material.compute_stress(stress, -0.0046 * ISOTROPIC[None], state, 1.0)
    assert material.derived_state(stress, state)["saturation"][0] == 1.0 and state[0, 1] > 1e6


@pytest.mark.parametrize("ratio", [1.0, 3.0])
@pytest.mark.parametrize("fluid_pressure", [0.0, 5e4])
@pytest.mark.parametrize("saturation", [0.0, 0.5, 1.0])
def test_drained_start(saturation, fluid_pressure, ratio):
    """An initial stress keeps the given fluid pressure; the effective one is on the cap, or a share of its strength."""
    start_of = {"initial_saturation": saturation, "initial_fluid_pressure": fluid_pressure}
    material = Arena(**QUASISTATIC, **start_of, overconsolidation_ratio=ratio)
    isotropic = -(3e4 + fluid_pressure) * (ISOTROPIC > 0)
    stress = np.stack([isotropic, isotropic + np.array([0, -1e4, 0, 1e3, 0, 0])])
    state = material.initial_state(stress, np.zeros((2, 2), np.int64), np.ones(2))
    np.testing.assert_allclose(state[:, 1], fluid_pressure, rtol=1e-12)
    derived = material.derived_state(stress, state)
    np.testing.assert_allclose(derived["saturation"], saturation, rtol=1e-12)
    assert -(state[0, 2] + 3 * fluid_pressure) == pytest.approx(ratio * 9e4, rel=1e-9)
    if ratio == 1.0:
        np.testing.assert_allclose(material.yield_excess(stress, state), 0.0, atol=1e-6)
    assert (derived["porosity"] < 0.4).all()
    before = stress.copy()
    material.compute_stress(stress, np.zeros((2, 6)), state, 1.0)
    np.testing.assert_allclose(stress, before, rtol=1e-5, atol=0.1)
    np.testing.assert_allclose(state[:, 1], fluid_pressure, rtol=1e-9)
    material.compute_stress(stress, np.tile([-1e-3, 0, 0, 0, 0, 0], (2, 1)), state, 1.0)
    assert (state[:, 1] > fluid_pressure).all() == (state[0, 0] > 0)  # from now on undrained


def test_impossible_prestress_is_an_error():
    stress = np.zeros((2, 6))
    stress[1, 3] = 1e6
    with pytest.raises(ValueError, match=r"row 1 .*outside every yield surface.*FSLOPE"):
        Arena().initial_state(stress, np.zeros((2, 2), np.int64), np.ones(2))


def test_strength_factor_that_breaks_the_rule_is_an_error():
    material = Arena(do_variability=True, PEAKI1=1e5, weibull_reference_volume=1e12)
    with pytest.raises(ValueError, match=r"STREN > YSLOPE \* PEAKI1"):
        start(material)


@pytest.mark.parametrize(
    ("parameters", "rule"),
    [
        ({"FSLOPE": 0.2}, "FSLOPE > YSLOPE > 0"),
        ({"STREN": 300.0}, r"STREN > YSLOPE \* PEAKI1"),
        ({"FSLOPE": 0.0, "STREN": 1e6, "YSLOPE": 0.0}, "von Mises: STREN > 0, the others 0"),
        ({"T1": 0.0}, "both must be positive"),
        ({"nu1": 0.49, "nu2": 0.2}, "below 0.5"),
        ({"CR": 1.0}, "CR"),
        ({"BETA": 0.0}, "BETA"),
        ({"BETA": 1.2}, "create energy; choose BETA_acts_on: cap, or insist with BETA_above_1: allow"),
        ({"b4": 0.9}, "b4"),
        ({"initial_saturation": 1.2}, "initial_saturation"),
        ({"p3": 0.4}, "p3"),
        ({"do_damage": True, "failed_YSLOPE": 0.9}, "FSLOPE > YSLOPE"),
        ({"pore_pressure": "total", "undrained_unloading": "drained"}, "change the stiffness without the pressure"),
        ({"grain_slope": 1e6}, "must stay below grain_bulk_modulus"),
        ({"dry_density": 1600.0, "initial_porosity": 0.4}, "initial_porosity = 0.4 contradicts 0.396226"),
        ({"dry_density": 1600.0, "water_content": 0.3}, "at most 0.2476"),
        ({"dry_density": 2700.0}, "less than grain_density"),
        ({"do_variability": True, "weibull_exponent": {"STREN": 0.0}}, "STREN must be positive"),
        ({"weibull_seed": -1}, "must be positive, not -1"),
        ({"do_variability": True, "weibull_modulus": {"BETA": 4.0}}, "'BETA' is no strength"),
        ({"do_damage": True, "failed_PEAKI1": 0.0, "failed_YSLOPE": 0.0}, "of the intact one's kind"),
    ],
)
def test_rules_between_parameters(parameters, rule):
    with pytest.raises(ValidationError, match=rule):
        Arena(**parameters)


@pytest.mark.parametrize(
    "surface",
    [
        {"STREN": 0.0, "YSLOPE": 0.0},
        {"FSLOPE": 0.0, "YSLOPE": 0.0, "PEAKI1": 0.0},
        {"YSLOPE": 0.0, "PEAKI1": 0.0},
    ],
)
def test_special_surfaces(surface):
    """Drucker-Prager, von Mises and saturating limit: shear ends at its closed form, without a failure."""
    material = Arena(**QUASISTATIC, initial_saturation=0.0, p0=1e9, **surface)
    stress, state = start(material)
    material.compute_stress(stress, -1e-2 * ISOTROPIC[None], state, 1.0)
    for _ in range(10):
        material.compute_stress(stress, np.array([[-1e-3, 0, 1e-3, 2e-2, 0, 0]]), state, 1.0)
    i1 = 3 * tensors.mean(stress)[0] + 3 * state[0, 1]
    q = tensors.deviator_norm(stress)[0] / math.sqrt(2)
    peak, fslope, stren = material.PEAKI1, material.FSLOPE, material.STREN
    limit = fslope * (peak - i1) if stren == 0 else stren
    if stren > 0 and fslope > 0:
        limit = stren * (1 - math.exp(fslope / stren * i1))
    assert q == pytest.approx(limit, rel=1e-6)


def test_plane_strain_rows_equal_three_dimensional_ones():
    material = Arena()
    strains = random_strains(50, 3e-3)
    strains[:, 4:] = 0.0
    results = []
    for components in (4, 6):
        stress, state = start(material, 50, components)
        for _ in range(3):
            material.compute_stress(stress, np.ascontiguousarray(strains[:, :components]), state, 1e-4)
        results.append((stress, state))
    np.testing.assert_array_equal(results[0][0], results[1][0][:, :4])
    np.testing.assert_array_equal(results[0][1][:, :9], results[1][1][:, :9])


def test_rows_are_independent():
    material = Arena(**QUASISTATIC)
    strains = random_strains(64, 1e-2)
    together = start(material, 64)
    material.compute_stress(together[0], strains, together[1], 1.0)
    for row in (0, 17, 63):
        alone = start(material)
        material.compute_stress(alone[0], strains[row : row + 1], alone[1], 1.0)
        np.testing.assert_array_equal(alone[0][0], together[0][row])


def test_failed_update_leaves_its_row():
    material = Arena()
    stress, state = strained(material, [-0.01, 0, 0, 0, 0, 0])
    before, kept = stress.copy(), state.copy()
    increment = np.zeros((1, 6))
    increment[0, 0] = np.nan
    with pytest.raises(UpdatesFailed) as failure:
        material.compute_stress(stress, increment, state, 1.0)
    assert failure.value.rows.tolist() == [0]
    np.testing.assert_array_equal(stress, before)
    np.testing.assert_array_equal(state, kept)
    increment[0, 0] = -1e-3
    material.compute_stress(stress, increment, state, 1.0)  # the row goes on
    assert stress[0, 0] < before[0, 0]


def test_rows_that_fail_are_named_and_do_not_hold_up_the_others():
    material = Arena()
    stress, state = start(material, rows=40)
    increment = np.zeros((40, 6))
    increment[:, 0] = -1e-3
    expected, its = stress[:1].copy(), state[:1].copy()
    material.compute_stress(expected, increment[:1].copy(), its, 1.0)
    increment[3::2, 1] = np.nan
    with pytest.raises(UpdatesFailed, match="19 rows") as failure:
        material.compute_stress(stress, increment, state, 1.0)
    assert failure.value.rows.tolist() == list(range(3, 40, 2))
    fine = np.setdiff1d(np.arange(40), failure.value.rows)
    assert (stress[fine] == expected).all() and (state[fine] == its).all() and (stress[3::2] == 0.0).all()


def test_merged_state_is_made_consistent_by_a_zero_increment():
    """Averages of pressure and strength do not fit the averaged strain; a zero increment repairs that."""
    material = Arena(**QUASISTATIC, initial_saturation=0.5)
    stress, state = strained(material, -0.02)
    exact = state.copy()
    state[0, 1:3] *= 1.3
    material.compute_stress(stress, np.zeros((1, 6)), state, 1.0)
    np.testing.assert_allclose(state, exact, rtol=1e-6)


def test_state_columns_follow_the_parts():
    def names(**parameters):
        return [f.name for f in Arena(**parameters).state_fields]

    base = ["volumetric_plastic_strain", "pore_pressure", "compressive_strength", "fluid_content", "opened"]
    assert names(**QUASISTATIC) == base
    assert names() == [*base, "quasistatic_stress"]
    assert names(do_damage=True, do_variability=True) == [
        *base,
        "damage_time",
        "strength_factor",
        "quasistatic_stress",
    ]
    reported = names(**QUASISTATIC, report_plastic_strain=True, report_dissipation=True)
    assert reported == [*base, "plastic_strain", "plastic_strain_length", "dissipation"]
    own = names(**QUASISTATIC, do_variability=True, weibull_modulus={"STREN": 8.0})
    assert own == [*base, "PEAKI1_factor", "FSLOPE_factor", "STREN_factor", "YSLOPE_factor"]


def test_yield_surface_curve():
    """The curve ends at zero shear at both ends and passes through a yielding stress."""
    material = Arena(**QUASISTATIC)
    stress, state = strained(material, [-0.03, 0, 0, 0, 0, 0])
    p, q = material.yield_surface(stress[0], state[0])
    assert (q[0], q[-1]) == pytest.approx((0, 0), abs=1e-6 * q.max())
    assert p[0] == pytest.approx(state[0, 2] / 3)
    at_stress = np.interp(tensors.mean(stress)[0], p, q)
    assert at_stress == pytest.approx(tensors.equivalent_shear(stress)[0], rel=1e-3)


@pytest.mark.parametrize(("pore_pressure", "largest"), [("plastic", 0.2), ("total", 0.02)])
def test_random_states_and_increments(pore_pressure, largest):
    """Reduced form of the benchmark `arena_random_states`: no failure, no NaN, nothing off the surface."""
    rng = np.random.default_rng(3)
    for saturation in (0.0, 0.02, 0.5, 0.98, 1.0):
        material = Arena(
            **QUASISTATIC,
            initial_saturation=saturation,
            BETA=float(rng.uniform(0.3, 2.0)),
            BETA_above_1="allow",
            CR=float(rng.uniform(0.05, 0.95)),
            p1_sat=float(rng.choice([1.0, 0.3])),
            pore_pressure=pore_pressure,
        )
        stress, state = start(material, 400)
        for _ in range(3):
            increment = random_strains(400, 1.0, int(rng.integers(1 << 30)))
            size = largest * 10.0 ** (-7.3 * rng.random(400) ** 2)
            increment *= (size / tensors.deviator_norm(increment))[:, None]
            material.compute_stress(stress, increment, state, 1.0)
        assert np.isfinite(stress).all() and np.isfinite(state).all()
        assert material.yield_excess(stress, state).max() < 1e-6


def test_weaker_soil_has_a_lower_yield_surface_at_every_pressure():
    law = Arena(do_damage=True, dry_density=1600.0, water_content=0.1, initial_fluid_pressure=1e4)
    weaker, stress = law.weakened(1.5), np.zeros((1, 6))
    state = law.initial_state(stress, np.zeros((1, 2), np.int64), np.ones(1))
    (p, q), (same_p, less) = (m.yield_surface(stress[0], state[0]) for m in (law, weaker))
    np.testing.assert_allclose(same_p, p, rtol=1e-12)
    np.testing.assert_allclose(1.5 * less, q, rtol=1e-6, atol=1e-6)
    assert q.max() > 100.0
    assert weaker.failed_strength()[1:3] == pytest.approx([value / 1.5 for value in law.failed_strength()[1:3]])
    assert weaker.initial_porosity == law.initial_porosity and weaker.state_fields == law.state_fields
