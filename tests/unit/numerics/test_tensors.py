"""Invariants of tensor rows against full tensors."""

import numpy as np
import pytest

from periporo.core.numerics import tensors


@pytest.mark.parametrize("components", [4, 6])
def test_invariants_of_random_tensors(components):
    rows = np.random.default_rng(2).normal(size=(20, components))
    full = tensors.to_matrix(rows)
    deviator = full - np.trace(full, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    norm = np.sqrt((deviator**2).sum(axis=(1, 2)))
    assert tensors.mean(rows) == pytest.approx(np.trace(full, axis1=1, axis2=2) / 3, rel=1e-13)
    assert tensors.deviator_norm(rows) == pytest.approx(norm, rel=1e-13)
    assert tensors.equivalent_shear(rows) == pytest.approx(np.sqrt(1.5) * norm, rel=1e-13)


def test_equivalent_shear_of_uniaxial_stress_is_its_size():
    assert tensors.equivalent_shear(np.array([[0.0, -7.0, 0.0, 0.0]])) == pytest.approx(7.0)


def test_components_of_each_dimension():
    assert [tensors.component_count(d) for d in (2, 3)] == [4, 6]
    assert tensors.COMPONENTS[: tensors.component_count(2)] == ("xx", "yy", "zz", "xy")


def test_square_lengths():
    v = np.random.default_rng(2).normal(size=(7, 3))
    assert tensors.square_lengths(v) == pytest.approx(np.linalg.norm(v, axis=1) ** 2, rel=1e-14)
    assert tensors.square_lengths(np.array([[3.0, 4.0], [0.0, np.nan]]))[0] == 25.0
