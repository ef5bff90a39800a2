"""Mohr-Coulomb: every return obeys yield and flow, closed forms of strength, softening, sensitivity and rate."""

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.optimize import nnls

from periporo.core.numerics.tensors import to_matrix
from periporo.io.schema.errors import model_problems
from periporo.materials import StateField, built_in_path, check_material, drive
from periporo.materials.mohr_coulomb import MohrCoulomb

K, MU = 25e6, 15e6
PHI, C = np.radians(30.0), 5e3
PAIRS = [(i, j) for i in range(3) for j in range(3) if i != j]


def soil(**changes):
    parameters = {"density": 1700.0, "bulk_modulus": K, "shear_modulus": MU, "cohesion": C, "friction_angle": 30.0}
    return MohrCoulomb(**(parameters | changes))


def advanced(material, stress, increment, dt=np.inf, state=None):
    new = stress.copy()
    state = material.initial_state(stress, None, None) if state is None else state
    material.compute_stress(new, increment, state, dt)
    return new, state


def random_rows(components, n=3000, seed=1):
    """Trial stresses near faces, edges, apex and cut-off: with two or three nearly equal values among them."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(n, 3)) * 10 ** rng.uniform(2, 5, (n, 1))
    values[: n // 3, 1] = values[: n // 3, 0] * (1 + 1e-9 * rng.normal(size=n // 3))
    values += rng.uniform(-4e4, 2e4, (n, 1))
    turn, _ = np.linalg.qr(rng.normal(size=(n, 3, 3)))
    if components == 4:
        angle = rng.uniform(0, 2 * np.pi, n)
        turn = np.tile(np.eye(3), (n, 1, 1))
        turn[:, 0, 0], turn[:, 1, 1] = np.cos(angle), np.cos(angle)
        turn[:, 0, 1], turn[:, 1, 0] = -np.sin(angle), np.sin(angle)
    full = np.einsum("nik,nk,njk->nij", turn, values, turn)
    pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)][:components]
    return np.stack([full[:, a, b] for a, b in pairs], axis=1)


@pytest.mark.parametrize("components", [4, 6])
@pytest.mark.parametrize("phi, psi, cutoff", [(30, 0, None), (30, 12, None), (30, 30, 2e3), (30, 10, 0.0), (0, 0, 3e3)])
def test_every_return_obeys_yield_and_flow(components, phi, psi, cutoff):
    """The stress is admissible, and plastic strain a sum of the flows of the surfaces that it lies on.

    At the apex flow without association cannot be such a sum, and need not be.
    """
    material = soil(friction_angle=phi, dilation_angle=psi, tension_cutoff=cutoff, report_dissipation=True)
    trial = random_rows(components)
    new, state = advanced(material, trial, np.zeros_like(trial))
    scale = np.abs(trial).max(axis=1) + C
    mean, sine, flow = (trial - new)[:, :3].mean(axis=1), np.sin(np.radians(phi)), np.sin(np.radians(psi))
    plastic = (trial - new) / (2 * MU)
    plastic[:, :3] += (mean * (1 / (3 * K) - 1 / (2 * MU)))[:, None]
    work = (new * plastic * np.where(np.arange(components) < 3, 1, 2)).sum(axis=1)
    np.testing.assert_allclose(state[:, 0], work, rtol=1e-9, atol=1e-9)
    values, axes = np.linalg.eigh(to_matrix(new))
    strain = np.einsum("nik,nij,njk->nk", axes, to_matrix(plastic), axes)
    twist = np.abs(to_matrix(plastic) - np.einsum("nik,nk,njk->nij", axes, strain, axes)).max(axis=(1, 2))
    limit = np.inf if cutoff is None else cutoff
    strength, apex = 2 * C * np.cos(np.radians(phi)), C / np.tan(np.radians(phi)) if phi else np.inf
    seen = set()
    for n in range(len(trial)):
        v, size = values[n], 1e-10 * scale[n]
        excess = [(1 + sine) * v[i] - (1 - sine) * v[j] - strength for i, j in PAIRS]
        assert max(excess) <= 4 * size and v.max() <= limit + size
        if np.abs(strain[n]).max() < 1e-13:
            continue
        apart = np.abs(np.subtract.outer(v, v))[np.triu_indices(3, 1)].min() > 1e-3 * np.ptp(trial[n])
        assert twist[n] < 1e-7 * np.abs(strain[n]).max() or not apart
        normals = []
        for (i, j), f in zip(PAIRS, excess, strict=True):
            if f > -10 * size:
                normals.append([(1 + flow) * (k == i) - (1 - flow) * (k == j) for k in range(3)])
        on_pyramid = len(normals)
        normals += [np.eye(3)[k] for k in range(3) if v[k] > limit - 10 * size]
        seen.add((on_pyramid, len(normals) - on_pyramid))
        if apex <= limit and v.min() > apex - 1e-6 * scale[n]:
            continue
        _, left = nnls(np.array(normals).T, strain[n])
        assert left < 1e-6 * np.abs(strain[n]).max() + 1e-15
    assert {(1, 0), (2, 0)} <= seen and (cutoff is None or {(0, 1), (0, 3), (1, 1)} <= seen)


def sheared(material, strain, steps, components=6, confining=2e4, dt=np.inf, direction=(0.5, -1.0, 0.5)):
    """Stress and state after `strain` along a `direction` of principal strains from isotropic stress."""
    stress = np.zeros((1, components))
    stress[0, :3] = -confining
    state = material.initial_state(stress, None, None)
    increment = np.zeros_like(stress)
    increment[0, :3] = np.array(direction) * strain / steps
    for _ in range(steps):
        material.compute_stress(stress, increment, state, dt)
    return stress[0], state[0]


@pytest.mark.parametrize("components, direction", [
    (6, (0.5, -1.0, 0.5)), (6, (-0.5, 1.0, -0.5)), (4, (1.0, -1.0, 0.0)), (6, (1.0, -1.0, 0.0)), (6, (1.0, -0.8, -0.2)),
])  # fmt: skip
def test_the_strength_is_the_same_in_every_test(components, direction):
    """s1 - s3 = 2 c cos(phi) - (s1 + s3) sin(phi) in triaxial compression and extension, plane strain and between."""
    values = np.sort(sheared(soil(), 0.02, 3, components, direction=direction)[0][:3])
    strength = 2 * C * np.cos(PHI) - (values[2] + values[0]) * np.sin(PHI)
    assert values[2] - values[0] == pytest.approx(strength, rel=1e-12)
    values = np.sort(sheared(soil(friction_angle=0.0), 0.02, 3, components, direction=direction)[0][:3])
    assert values[2] - values[0] == pytest.approx(2 * C, rel=1e-12)


def test_drained_triaxial_test_dilates_by_the_angle_of_dilation():
    """At constant s3: sigma_1 = N s3 + 2 c sqrt(N), and de_v/de_1 = -2 sin(psi)/(1 - sin(psi))."""
    result = drive(soil(dilation_angle=10.0), built_in_path("triaxial", "confining=1e5,strain=0.04,rows=20"))
    slope = np.tan(np.radians(60.0)) ** 2
    assert -result["stress_yy"][-1] == pytest.approx(slope * 1e5 + 2 * C * np.sqrt(slope), rel=1e-9)
    volume = sum(np.diff(result[f"strain_{c}"])[-1] for c in ("xx", "yy", "zz"))
    sine = np.sin(np.radians(10.0))
    assert volume / np.diff(result["strain_yy"])[-1] == pytest.approx(-2 * sine / (1 - sine), rel=1e-6)


SOFTENING = {"plastic_shear": [0.0, 0.01, 0.03], "values": [5e3, 6e3, 2e3]}


@pytest.mark.parametrize("steps", [1, 3, 50])
def test_cohesion_follows_its_table_however_long_the_steps(steps):
    """Tresca in plane shear: tau = c(gamma - tau/G), backward Euler lies on the table in every step."""
    material = soil(friction_angle=0.0, cohesion=SOFTENING)
    for strain in (2e-3, 5e-3, 8e-3, 0.03):
        stress, state = sheared(material, strain, steps, 4, direction=(1.0, -1.0, 0.0))
        tau, total = 0.5 * (stress[0] - stress[1]), 2 * strain
        assert tau == pytest.approx(np.interp(state[0], SOFTENING["plastic_shear"], SOFTENING["values"]), rel=1e-9)
        assert state[0] == pytest.approx(total - tau / MU, rel=1e-5)


def test_friction_hardens_and_dilation_ends():
    """phi from 20 to 35 and back to 30, psi from 10 to 0: at the end the critical state, at constant volume."""
    strain = [0.0, 0.02, 0.1]
    material = soil(
        cohesion=0.0, friction_angle={"plastic_shear": strain, "values": [20.0, 35.0, 30.0]},
        dilation_angle={"plastic_shear": [0.0, 0.1], "values": [10.0, 0.0]},
    )  # fmt: skip
    result = drive(material, built_in_path("triaxial", "confining=1e5,strain=0.12,rows=120"))
    ratio = result["stress_yy"] / result["stress_xx"]
    sine = (ratio - 1) / (ratio + 1)
    expected = np.interp(result["plastic_shear"], strain, np.sin(np.radians([20.0, 35.0, 30.0])))
    np.testing.assert_allclose(sine[5:], expected[5:], rtol=1e-8)
    assert sine.max() == pytest.approx(np.sin(np.radians(35.0)), rel=5e-3) and sine[-1] == pytest.approx(0.5, rel=1e-9)
    volume = result["strain_xx"] + result["strain_yy"] + result["strain_zz"]
    assert volume.max() > 0.004 and volume[-1] == pytest.approx(volume[-5], abs=1e-9)


def test_sensitive_clay_falls_to_its_remoulded_strength():
    clay = soil(friction_angle=0.0, cohesion=30e3, sensitivity=6.0, remoulding_shear=0.4)
    for plastic, strength in ((0.2, 17.5e3), (0.4, 5e3), (1.0, 5e3)):
        strain = 0.5 * (plastic + strength / MU)
        stress, state = sheared(clay, strain, 40, 4, direction=(1.0, -1.0, 0.0))
        assert 0.5 * (stress[0] - stress[1]) == pytest.approx(strength, rel=1e-6)
        assert state[0] == pytest.approx(plastic, rel=1e-6)


@pytest.mark.parametrize("components, volume", [(4, 0.25), (6, 0.125)])
def test_the_slip_that_softens_a_band_does_not_depend_on_the_spacing(components, volume):
    """Rows of half the size shear by twice as much until they have lost as much strength."""
    clay = soil(friction_angle=0.0, cohesion=SOFTENING, reference_spacing=1.0)
    stress, increment = np.zeros((2, components)), np.zeros((2, components))
    state = clay.initial_state(stress, None, np.array([1.0, volume]))
    assert state[:, 1].tolist() == [1.0, 0.5]
    plastic = 0.02
    for row, strain in ((0, plastic), (1, 2 * plastic)):
        increment[row, 3] = 0.5 * (strain + np.interp(plastic, *SOFTENING.values()) / MU)
    for _ in range(40):
        clay.compute_stress(stress, increment / 40, state, np.inf)
    np.testing.assert_allclose(state[:, 0], plastic, rtol=1e-5)
    np.testing.assert_allclose(stress[:, 3], 4e3, rtol=1e-5)


@pytest.mark.parametrize("dt", [1e-6, 1e-3])
def test_the_rate_raises_the_strength_by_a_part_for_each_decade(dt):
    """s_u (1 + mu log10(rate/reference)) in steady shear; below the reference rate, and at rest, s_u."""
    clay = soil(friction_angle=0.0, rate_coefficient=0.1, reference_rate=1e-2)
    for rate, factor in ((10.0, 1.3), (1.0, 1.2), (1e-3, 1.0)):
        steps = 2000
        stress, _ = sheared(clay, 0.5 * rate * dt * steps, steps, 4, dt=dt, direction=(1.0, -1.0, 0.0))
        reached = 0.5 * (stress[0] - stress[1])
        assert reached == pytest.approx(min(factor * C, MU * rate * dt * steps), rel=1e-5)
    stress, _ = sheared(clay, 0.05, 2, 4, direction=(1.0, -1.0, 0.0))
    assert 0.5 * (stress[0] - stress[1]) == pytest.approx(C, rel=1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("changes", [
    {"tension_cutoff": 1e3, "dilation_angle": 10.0}, {"friction_angle": 0.0, "tension_cutoff": 0.0},
    {"cohesion": SOFTENING, "report_dissipation": True},
    {"friction_angle": 0.0, "sensitivity": 5.0, "remoulding_shear": 0.1, "rate_coefficient": 0.1,
     "reference_rate": 1e-3, "tension_cutoff": 0.0},
])  # fmt: skip
def test_variants_conform(changes, dimension):
    assert check_material(soil(**changes), dimension).cycle_energy > 0.0


def test_weaker_soil_has_its_strength_divided():
    """c/F, tan(phi)/F at every strain: the strength in plane strain at given s1 + s3, too."""
    material = soil(cohesion=SOFTENING, tension_cutoff=1e3)
    weaker = material.weakened(1.5)
    strain, sine, strength, _ = weaker.table()
    assert sine == pytest.approx(np.sin(np.arctan(np.tan(PHI) / 1.5)) * np.ones(3), rel=1e-12)
    np.testing.assert_allclose(strength, 2 * np.array(SOFTENING["values"]) / 1.5 * np.sqrt(1 - sine**2), rtol=1e-12)
    assert weaker.tension_cutoff == pytest.approx(1e3 / 1.5) and strain[-1] == 0.03


def test_only_what_has_memory_keeps_it():
    assert soil().state_fields == (StateField("opened", "1"),) and soil().exchanges_stress
    soft = soil(cohesion=SOFTENING)
    assert [f.name for f in soft.state_fields] == ["plastic_shear", "opened"] and not soft.exchanges_stress
    state = np.array([[0.03, 0.0]])
    assert soft.tension_limit(np.zeros((1, 6)), state)[0] == pytest.approx(2e3 / np.tan(PHI), rel=1e-12)


@pytest.mark.parametrize("change, message", [
    ({"cohesion": 0.0, "friction_angle": 0.0}, "no strength"),
    ({"dilation_angle": 31.0}, "must not exceed friction_angle"),
    ({"friction_angle": {"plastic_shear": [0, 1], "values": [40, 20]}, "dilation_angle": 30.0}, "at plastic_shear 1"),
    ({"cohesion": {"plastic_shear": [0, 1], "values": [1e3, -1.0]}}, "cohesion must stay from 0"),
    ({"cohesion": {"plastic_shear": [0.1, 1], "values": [1e3, 1.0]}}, "must begin with 0"),
    ({"cohesion": {"plastic_shear": [0, 1, 1], "values": [1e3, 1.0, 1.0]}}, "must increase"),
    ({"sensitivity": 3.0}, "remoulding_shear together"),
    ({"rate_coefficient": 0.1}, "reference_rate together"),
    ({"length": 0.3}, "but none does"),
    ({"cohesion": SOFTENING, "length": 0.3, "reference_spacing": 0.1}, "not both"),
    ({"cohesion": SOFTENING, "sensitivity": 3.0, "remoulding_shear": 1.0}, "not both"),
])  # fmt: skip
def test_impossible_parameters_are_refused(change, message):
    with pytest.raises(ValidationError, match=message):
        soil(**change)


def test_what_is_wrong_with_a_table_is_said_of_the_table():
    table = {"plastic_sheer": [0, 1], "values": [1e3, "x"]}
    data = soil().model_dump(exclude_none=True) | {"cohesion": table, "friction_angle": "steep"}
    said = [(p.path, p.message) for p in model_problems(MohrCoulomb, data)]
    assert [path for path, _ in said] == [("cohesion", "plastic_sheer"), ("cohesion", "values", 1), ("friction_angle",)]
    assert "did you mean 'plastic_shear'?" in said[0][1] and all("must be a number" in text for _, text in said[1:])
