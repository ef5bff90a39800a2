"""Drucker-Prager: closed forms of the return to cone, apex and cut-off, and the match with Mohr-Coulomb."""

import numpy as np
import pytest
from pydantic import ValidationError

from periporo.core.numerics.tensors import equivalent_shear, mean
from periporo.materials.drucker_prager import DruckerPrager

K, MU = 25e6, 15e6


def soil(**changes):
    parameters = {
        "density": 1700.0,
        "bulk_modulus": K,
        "shear_modulus": MU,
        "cohesion": 5e3,
        "friction_angle": 30.0,
    }
    return DruckerPrager(**(parameters | changes))


def advance(material, stress, increment):
    """New stress, plastic strain and state of rows that start at `stress`."""
    new = stress.copy()
    state = material.initial_state(stress, None, None)
    material.compute_stress(new, increment, state, np.inf)
    change = new - stress
    elastic = change / (2 * MU)
    elastic[:, :3] += (mean(change) * (1 / (3 * K) - 1 / (2 * MU)))[:, None]
    return new, increment - elastic, state


def random_rows(n=5000, seed=1):
    rng = np.random.default_rng(seed)
    stress = np.zeros((n, 6))
    stress[:, :3] = -rng.uniform(0, 5e4, n)[:, None]
    increment = rng.normal(size=(n, 6)) * 10 ** rng.uniform(-6, -2, n)[:, None]
    return stress, increment


def shear_root(rows):
    """sqrt(J2)."""
    return equivalent_shear(rows) / np.sqrt(3)


@pytest.mark.parametrize("dilation", [0.0, 10.0, 30.0])
def test_return_satisfies_yield_and_flow(dilation):
    """On the cone plastic strain has the ratio eta_bar; at the apex it lies in the cone of normals."""
    material = soil(dilation_angle=dilation)
    eta, strength, ratio = material.cone(3)
    stress, increment = random_rows()
    new, plastic, _ = advance(material, stress, increment)
    f = shear_root(new) + eta * mean(new) - strength
    assert np.max(f) < 1e-8 * strength
    volumetric = 3 * mean(plastic)
    shear = 2 * shear_root(plastic)  # conjugate to sqrt(J2)
    flows = shear + np.abs(volumetric) > 1e-12
    apex = flows & (shear_root(new) < 1e-9 * strength)
    cone = flows & ~apex
    assert 0.2 < flows.mean() < 0.95 and apex.mean() > 0.01 and cone.mean() > 0.2
    assert np.max(np.abs(f[cone])) < 1e-8 * strength
    np.testing.assert_allclose(volumetric[cone], ratio * shear[cone], rtol=1e-8, atol=1e-13)
    np.testing.assert_allclose(mean(new)[apex], strength / eta, rtol=1e-12)
    assert np.all(volumetric[apex] >= ratio * shear[apex] - 1e-12)


@pytest.mark.parametrize("dilation", [0.0, 30.0])
def test_cone_return_in_closed_form(dilation):
    """dgamma = f_trial/(mu + K eta eta_bar) for an isotropic start and pure shear."""
    material = soil(dilation_angle=dilation)
    sine = np.sin(np.radians(30.0))
    eta = sine if dilation == 0 else np.sqrt(3) * sine / np.sqrt(3 + sine**2)
    ratio = 0.0 if dilation == 0 else eta
    strength = 5e3 * eta / np.tan(np.radians(30.0))  # both cones meet p = c cot(phi)
    stress = np.zeros((1, 4))
    stress[0, :3] = -2e4
    increment = np.array([[0.0, 0.0, 0.0, 2e-3]])
    new, _, _ = advance(material, stress, increment)
    multiplier = (2 * MU * 2e-3 - eta * 2e4 - strength) / (MU + K * eta * ratio)
    assert multiplier > 0
    assert new[0, 3] == pytest.approx(2 * MU * 2e-3 - MU * multiplier, rel=1e-12)
    assert mean(new)[0] == pytest.approx(-2e4 - K * ratio * multiplier, rel=1e-12)


@pytest.mark.parametrize("dilation", [0.0, 30.0])
def test_pulled_soil_ends_at_the_apex(dilation):
    new, _, _ = advance(soil(dilation_angle=dilation), np.zeros((1, 6)), np.full((1, 6), 1e-3))
    apex = 5e3 / np.tan(np.radians(30.0))
    np.testing.assert_allclose(new[0], [apex, apex, apex, 0, 0, 0], rtol=1e-12, atol=1e-9)
    dry, _, _ = advance(soil(cohesion=0.0, dilation_angle=dilation), np.zeros((1, 6)), np.full((1, 6), 1e-3))
    np.testing.assert_array_equal(dry, np.zeros((1, 6)))


@pytest.mark.parametrize("steps", [1, 7, 400])
def test_dilation_fades_with_the_volume_that_it_made(steps):
    """v = e (1 - exp(-eta_bar gamma/e)), however long the steps; sheared on, p = p_0 - K e and the volume stays."""
    end = 1e-3
    material = soil(dilation_angle=20.0, largest_dilation=end)
    eta, strength, ratio = material.cone(3)
    stress = np.zeros((1, 6))
    stress[0, :3] = -2e4
    state = material.initial_state(stress, None, None)
    for shear in (2e-3, 0.2):
        increment = np.zeros((1, 6))
        increment[0, 4] = shear / steps
        for _ in range(steps):
            material.compute_stress(stress, increment, state, np.inf)
        if shear == 2e-3:
            flow = 2 * shear - stress[0, 4] / MU
            dilated = end * (1 - np.exp(-ratio * flow / end))
            assert 0.2 * end < dilated < 0.9 * end
        else:
            dilated = end
        assert state[0, 0] == pytest.approx(dilated, rel=1e-9)
        assert mean(stress)[0] == pytest.approx(-2e4 - K * dilated, rel=1e-10)
        assert stress[0, 4] == pytest.approx(strength - eta * mean(stress)[0], rel=1e-10)


def test_soil_that_opens_is_not_at_its_critical_state():
    """What expands at the apex is a gap, and no dilation; without dilation there is nothing to remember."""
    material = soil(dilation_angle=20.0, largest_dilation=0.05)
    _, _, state = advance(material, np.zeros((1, 6)), np.full((1, 6), 1e-3))
    assert [f.name for f in material.state_fields] == ["plastic_dilation", "opened"] and not state.any()
    assert [f.name for f in soil(largest_dilation=0.05).state_fields] == ["opened"]


def biaxial_increment(dilation):
    """Collapse at constant stress in the plane: tr de = sin(psi) times the shear, axes at 20 deg."""
    shear, turn = 2e-4, np.radians(40.0)
    volume = shear * np.sin(np.radians(dilation))
    deviator = shear * np.cos(turn)
    return np.array([[volume + deviator, volume - deviator, 0.0, shear * np.sin(turn)]])


def plane_strain_failure(material):
    """Radius R and centre of Mohr's circle in the plane, and the last plastic strain, after long shear."""
    stress = np.array([[-2e4, -2e4, -2e4, 0.0]])
    for _ in range(1000):
        stress, plastic, _ = advance(material, stress, biaxial_increment(material.dilation_angle))
    radius = np.hypot((stress[0, 0] - stress[0, 1]) / 2, stress[0, 3])
    return radius, (stress[0, 0] + stress[0, 1]) / 2, plastic[0]


@pytest.mark.parametrize("dilation", [0.0, 12.0, 30.0])
def test_plane_strain_match_fails_as_mohr_coulomb(dilation):
    """Plastic strain is in plane then, dilating by sin(psi) of its shear."""
    radius, centre, plastic = plane_strain_failure(soil(dilation_angle=dilation))
    np.testing.assert_allclose(plastic, biaxial_increment(dilation)[0], rtol=1e-8, atol=1e-12)
    phi = np.radians(30.0)
    assert radius == pytest.approx(5e3 * np.cos(phi) - centre * np.sin(phi), rel=1e-9)


def test_without_friction_the_undrained_strength_is_the_cohesion():
    """Plane strain: R = c; triaxial compression: q = 2 c. Mean stress stays elastic, also in tension."""
    material = soil(friction_angle=0.0)
    assert plane_strain_failure(material)[0] == pytest.approx(5e3, rel=1e-12)
    new, _, _ = advance(material, np.zeros((1, 6)), np.array([[0.02, -0.01, 0.0, 0.0, 0.0, 0.0]]))
    assert equivalent_shear(new)[0] == pytest.approx(2 * 5e3, rel=1e-12)
    assert mean(new)[0] == pytest.approx(K * 0.01, rel=1e-12)
    assert material.largest_mean_stress(3) == np.inf


@pytest.mark.parametrize("match, sign", [(None, 1.0), ("compression", 1.0), ("extension", -1.0)])
def test_edges_meet_mohr_coulomb_in_triaxial_tests(match, sign):
    """sigma_1 - sigma_3 = 2 c cos(phi) - (sigma_1 + sigma_3) sin(phi) at failure, sigma_1 the largest."""
    material = soil(match=match)
    stress = np.zeros((1, 6))
    stress[0, :3] = -2e4
    new, _, _ = advance(material, stress, sign * np.array([[0.005, -0.01, 0.005, 0.0, 0.0, 0.0]]))
    largest, smallest = new[0, :3].max(), new[0, :3].min()
    phi = np.radians(30.0)
    assert largest - smallest == pytest.approx(
        2 * 5e3 * np.cos(phi) - (largest + smallest) * np.sin(phi), rel=1e-12
    )


@pytest.mark.parametrize("match, sign", [(None, 1.0), ("compression", 1.0), ("extension", -1.0)])
def test_triaxial_dilation_is_that_of_mohr_coulomb(match, sign):
    """de_v/de_1 = -2 sin(psi)/(1 - sin(psi)) in compression, 2 sin(psi)/(1 + sin(psi)) in extension, at failure."""
    material = soil(match=match, dilation_angle=20.0)
    stress = np.full((1, 6), -2e4) * [1, 1, 1, 0, 0, 0]
    failed, _, _ = advance(material, stress, sign * np.array([[0.005, -0.01, 0.005, 0.0, 0.0, 0.0]]))
    _, plastic, _ = advance(material, failed, sign * np.array([[5e-5, -1e-4, 5e-5, 0.0, 0.0, 0.0]]))
    sine = np.sin(np.radians(20.0))
    assert plastic[0, :3].sum() / plastic[0, 1] == pytest.approx(-2 * sign * sine / (1 - sign * sine), rel=1e-9)


def test_the_cone_follows_the_dimension_and_its_angles_are_told():
    """tan(22.2) in compression is what a cone of 30 degrees in plane strain has (de Souza Neto et al. 2008)."""
    material = soil()
    assert material.cone(2) == soil(match="plane_strain").cone(3)
    assert material.cone(3) == soil(match="compression").cone(2)
    plane, space = material.friction_angles(2), material.friction_angles(3)
    assert plane.plane_strain == pytest.approx(30.0, rel=1e-12)
    slope = np.sqrt(3.0) * 0.5  # q/|p| without dilation
    assert plane.compression == pytest.approx(np.degrees(np.arcsin(3 * slope / (6 + slope))), rel=1e-12)
    assert plane.compression == pytest.approx(22.2, abs=0.05)
    assert space.compression == pytest.approx(30.0, rel=1e-12)
    assert space.extension == pytest.approx(np.degrees(np.arcsin(3 * 1.2 / (6 - 1.2))), rel=1e-12)
    assert space.plane_strain == pytest.approx(np.degrees(np.arcsin(1.2 / np.sqrt(3))), rel=1e-12)
    assert soil(match="compression", friction_angle=45.0).friction_angles(2).plane_strain is None
    assert soil(match="extension", dilation_angle=20.0).friction_angles(3).extension == pytest.approx(30.0, rel=1e-12)


@pytest.mark.parametrize(
    ("match", "dimension", "words"),
    [
        (None, 2, None), (None, 3, None), ("plane_strain", 2, None), ("compression", 3, None),
        ("plane_strain", 3, "acts as 22.2 degrees in compression"),
        ("compression", 2, "acts as 43.9 degrees in plane strain"),
        ("extension", 3, "acts as 22.0 degrees in compression"),
    ],
)  # fmt: skip
def test_a_cone_that_fits_another_test_is_doubted(match, dimension, words):
    rows = np.zeros((0, 4 if dimension == 2 else 6))
    doubts = soil(match=match).doubts(rows, rows[:, :0])
    assert doubts == {} if words is None else words in doubts["friction"]


def test_dilation_without_an_end_is_doubted():
    rows = np.zeros((0, 4))
    assert "largest_dilation" in soil(dilation_angle=10.0).doubts(rows, rows[:, :0])["dilation"]
    assert soil(dilation_angle=10.0, largest_dilation=0.1).doubts(rows, rows[:, :0]) == {}


def test_inscribed_cone_never_exceeds_mohr_coulomb():
    """Its Mohr-Coulomb function is at most 0 in every direction of the deviatoric plane, and touches 0."""
    material = soil(match="inscribed")
    eta, strength, _ = material.cone(3)
    angle = np.linspace(0, 2 * np.pi, 3601)[:, None] + np.array([0, 2 * np.pi / 3, 4 * np.pi / 3])
    p = -2e4
    principal = p + 2 / np.sqrt(3) * (strength - eta * p) * np.cos(angle)
    largest, smallest = principal.max(axis=1), principal.min(axis=1)
    phi = np.radians(30.0)
    excess = (largest - smallest) / 2 + (largest + smallest) / 2 * np.sin(phi) - 5e3 * np.cos(phi)
    assert np.max(excess) == pytest.approx(0.0, abs=1e-5 * strength)
    assert np.max(excess) < 1e-9 * strength


def test_cutoff_keeps_the_shear_stress_that_the_cone_allows():
    material = soil(tension_cutoff=1e3)
    eta, strength, _ = material.cone(2)
    edge = strength - eta * 1e3
    pull = np.zeros((2, 4))
    pull[:, :3] = 1e-3
    pull[:, 3] = [0.5 * edge / (2 * MU), 3 * edge / (2 * MU)]
    new, _, _ = advance(material, np.zeros((2, 4)), pull)
    np.testing.assert_allclose(mean(new), 1e3, rtol=1e-12)
    np.testing.assert_allclose(new[:, 3], [0.5 * edge, edge], rtol=1e-12)
    assert soil(tension_cutoff=1e9).largest_mean_stress(2) == pytest.approx(5e3 / np.tan(np.radians(30.0)))


def test_reported_dissipation_is_the_work_of_the_plastic_strain():
    material = soil(dilation_angle=10.0, report_dissipation=True, tension_cutoff=2e3)
    stress, increment = random_rows()
    new, plastic, state = advance(material, stress, increment)
    work = np.sum(new[:, :3] * plastic[:, :3], axis=1) + 2 * np.sum(new[:, 3:] * plastic[:, 3:], axis=1)
    np.testing.assert_allclose(state[:, 0], work, rtol=1e-8, atol=1e-9)
    assert (state[:, 0] > 1.0).any() and (state[:, 0] >= 0).all()
    assert [f.name for f in material.state_fields] == ["dissipation", "opened"]


def test_drawn_yield_surface_and_moduli():
    material = soil()
    p, q = material.yield_surface(np.array([-1e5, -1e5, -1e5, 0, 0, 0]), None)
    eta, strength, _ = material.cone(3)
    assert q[0] == 0.0 and p[0] == pytest.approx(5e3 / np.tan(np.radians(30.0)))
    assert p[-1] == -1.5e5 and q[-1] == pytest.approx(np.sqrt(3) * (strength + eta * 1.5e5))
    p, q = soil(friction_angle=0.0).yield_surface(np.zeros(6), None)
    np.testing.assert_allclose(q[1:], 2 * 5e3)
    assert p[-1] < p[0]
    bulk, shear = material.elastic_moduli(np.zeros((2, 4)), np.zeros((2, 0)))
    assert bulk.tolist() == [K, K] and shear.tolist() == [MU, MU]


@pytest.mark.parametrize(
    "change, message",
    [
        ({"cohesion": 0.0, "friction_angle": 0.0}, "no strength"),
        ({"dilation_angle": 31.0}, "must not exceed friction_angle"),
        ({"friction_angle": 90.0}, "less than 90"),
        ({"match": "outer"}, "plane_strain"),
        ({"tension_cutoff": -1.0}, "greater than or equal to 0"),
        ({"largest_dilation": 0.0}, "greater than 0"),
    ],
)
def test_impossible_parameters_are_refused(change, message):
    with pytest.raises(ValidationError, match=message):
        soil(**change)
