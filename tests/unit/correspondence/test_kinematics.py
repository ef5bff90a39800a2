"""Objective kinematics against matrix formulas: midpoint gradient, Hughes-Winget rotation, rigid motion."""

import numpy as np
import pytest

from periporo.core.correspondence import kinematics
from periporo.core.numerics import algebra as la
from periporo.core.numerics.jit import kernel
from periporo.core.numerics.tensors import from_matrix, to_matrix


@kernel
def _step(gradient, stress, out, dim):
    """Midpoint gradient, strain, spin, rotated stress (whole and half) of one matrix."""
    g = kinematics.midpoint_gradient(la.matrix_at(gradient, 0, 0, dim))
    spin = kinematics.spin_of(g)
    s = la.symmetric_at(stress, 0, 0, dim)
    la.store(out, 0, 0, g)
    la.store(out, 1, 0, kinematics.strain_of(g))
    la.store(out, 2, 0, spin)
    la.store(out, 3, 0, kinematics.rotated(s, kinematics.rotation(spin, 1.0)))
    la.store(out, 4, 0, kinematics.rotated(s, kinematics.rotation(spin, 0.5)))


def step(gradient, stress):
    d = len(gradient)
    components = 4 if d == 2 else 6
    out = np.zeros((5, 9))
    _step(gradient.reshape(1, -1), stress[None, :components], out, la.DIMENSION[d])
    return out[0, : d * d].reshape(d, d), out[1, :components], out[2], out[3, :components], out[4, :components]


def cayley(skew):
    return np.linalg.solve(np.eye(len(skew)) - skew / 2, np.eye(len(skew)) + skew / 2)


def in_space(matrix):
    full = np.zeros((3, 3))
    full[: len(matrix), : len(matrix)] = matrix
    return full


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("size", [1e-6, 0.3])
def test_step_against_matrices(d, size):
    rng = np.random.default_rng(d)
    gradient, stress = size * rng.normal(size=(d, d)), rng.normal(size=6)
    g, strain, spin, whole, half = step(gradient, stress)
    expected = gradient @ np.linalg.inv(np.eye(d) - gradient / 2)
    assert g == pytest.approx(expected, rel=1e-12, abs=1e-15 * size)
    full = in_space(expected)
    components = 4 if d == 2 else 6
    assert strain == pytest.approx(from_matrix((full + full.T)[None] / 2, components)[0], rel=1e-12, abs=1e-16)
    skew = (full - full.T) / 2
    axial = [skew[1, 0]] if d == 2 else [skew[2, 1], skew[0, 2], skew[1, 0]]
    assert spin[: len(axial)] == pytest.approx(axial, rel=1e-11, abs=1e-16)
    s = to_matrix(stress[None, :components])[0]
    for found, turn in ((whole, cayley(skew)), (half, cayley(skew / 2))):
        assert found == pytest.approx(from_matrix((turn @ s @ turn.T)[None], components)[0], rel=1e-12, abs=1e-13)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("angle", [1e-5, 0.4])
def test_rigid_rotation_has_no_strain_and_turns_stress_exactly(d, angle):
    axis = np.array([0.0, 0.0, 1.0]) if d == 2 else np.array([2.0, -1.0, 2.0]) / 3
    cross = np.cross(np.eye(3), -axis)
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    gradient = np.ascontiguousarray((np.eye(3) - turn.T)[:d, :d])  # dt v = x - R^T x at the end of the step
    stress = np.random.default_rng(0).normal(size=6)
    _, strain, _, whole, _ = step(gradient, stress)
    assert np.abs(strain).max() < 1e-15
    components = 4 if d == 2 else 6
    s = to_matrix(stress[None, :components])[0]
    assert whole == pytest.approx(from_matrix((turn @ s @ turn.T)[None], components)[0], rel=1e-13, abs=1e-14)


def test_midpoint_strain_of_a_stretch_is_symmetric_in_time():
    """x to s x gives 2 (s-1)/(s+1), which changes sign when the step is undone."""
    stretch = 1.2
    for factor, sign in ((stretch, 1), (1 / stretch, -1)):
        gradient = np.zeros((2, 2))
        gradient[0, 0] = 1 - 1 / factor
        strain = step(gradient, np.zeros(6))[1]
        assert strain[0] == pytest.approx(sign * 2 * (stretch - 1) / (stretch + 1), rel=1e-14)
