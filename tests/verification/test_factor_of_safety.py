"""Factors of safety, small: `python -m benchmarks factor_of_safety` has more cases and points."""

import pytest

from benchmarks import factor_of_safety


def test_a_slope_has_the_factor_of_slices():
    assert factor_of_safety.search("slope", 8) == pytest.approx(factor_of_safety.EXACT["slope"], rel=0.1)


def test_a_layer_without_end_has_the_factor_of_its_friction():
    """By points that are not kept regular, which costs the dilation of a layer that shears."""
    found = factor_of_safety.search("layer", 6, "point_state")
    assert found == pytest.approx(factor_of_safety.EXACT["layer"], rel=0.03)
