"""The local equations printed in Menon & Song (2022): the sign of eq. 72, Newton's method of eqs. 76-93."""

import numpy as np
import pytest

from periporo.core.numerics.tensors import equivalent_shear, mean
from periporo.materials.cam_clay import CamClay

K, MU, M, PLASTIC_INDEX, DT = 25e6, 15e6, 1.1, 0.08, 3e-6


@np.errstate(over="ignore", invalid="ignore")  # it diverges
def published_newton(p_trial, q_trial, size_start, fluidity, sign=-1.0, iterations=100):
    """p, q, p_c by eqs. 73-93 from the trial state, or None; `fluidity` dt/eta; sign 1 is that of eq. 72."""
    x = np.array([p_trial, q_trial, size_start])
    scale = np.abs(x).sum()
    for _ in range(iterations):
        p, q, size = x
        f = max((q / M) ** 2 + p * (p - size), 0.0)
        gradient = np.array([2 * p - size, 2 * q / M**2, -p])
        hardened = size_start * np.exp(sign * fluidity / PLASTIC_INDEX * f * gradient[0])
        residual = np.array([
            p - p_trial + K * fluidity * f * gradient[0],
            q - q_trial + 3 * MU * fluidity * f * gradient[1],
            size - hardened,
        ])  # fmt: skip
        if not np.isfinite(residual).all():
            return None
        if np.abs(residual).max() < 1e-9 * scale:
            return x
        rows = gradient[0] * gradient + f * np.array([2.0, 0.0, -1.0])
        matrix = np.eye(3) + fluidity * np.array([
            K * rows,
            3 * MU * (gradient[1] * gradient + f * np.array([0.0, 2 / M**2, 0.0])),
            -size * sign / PLASTIC_INDEX * rows,
        ])  # fmt: skip
        try:
            x = x - np.linalg.solve(matrix, residual)
        except np.linalg.LinAlgError:
            return None
    return None


def trial_states(count, seed=0):
    """p, q, p_c outside of the ellipse, up to 1.5 and 2 times its size."""
    rng = np.random.default_rng(seed)
    size = 10 ** rng.uniform(3, 5, count)
    p, q = -size * rng.uniform(-0.2, 1.5, count), size * rng.uniform(0, 2, count)
    outside = (q / M) ** 2 + p * (p + size) > 0
    return np.stack([p, q, -size], axis=1)[outside]


def ours(p, q, size, viscosity):
    material = CamClay.example().model_copy(update={"viscosity": viscosity})
    stress = np.zeros((1, 6))
    stress[0, :3] = p + q * np.array([1, -2, 1]) / 3
    state = np.array([[size]])
    material.compute_stress(stress, np.zeros((1, 6)), state, DT)
    return np.array([mean(stress)[0], equivalent_shear(stress)[0], state[0, 0]])


@pytest.mark.parametrize("viscosity, lowest, highest", [(1e3, 0.9, 1.0), (1e8, 0.2, 0.6), (1e12, 0.0, 0.0)])
def test_published_newton_fails_where_viscosity_is_small(viscosity, lowest, highest):
    """At the paper's eta and dt hardly any trial state converges; where it does, ours is the same root."""
    states = trial_states(150)
    found = [published_newton(*s, DT / viscosity) for s in states]
    failed = [x is None or x[2] > 0 for x in found]
    assert lowest <= np.mean(failed) <= highest
    for state, x, bad in zip(states, found, failed, strict=True):
        if not bad:
            np.testing.assert_allclose(ours(*state, viscosity), x, rtol=1e-6, atol=1e-6 * -state[2])


def test_sign_of_hardening():
    """Isotropic compression of eq. 72: with the printed sign |p_c| shrinks when soil is compacted."""
    p, size, viscosity = -1.5e3, -1e3, 1e10
    printed = published_newton(p, 0.0, size, DT / viscosity, sign=1.0)
    corrected = published_newton(p, 0.0, size, DT / viscosity)
    assert (p - printed[0]) / K < 0 and (p - corrected[0]) / K < 0  # both compact
    assert -printed[2] < 1e3 < -corrected[2]
    np.testing.assert_allclose(ours(p, 0.0, size, viscosity), corrected, rtol=1e-8, atol=1e-6)
