"""Factors of safety, small: `python -m benchmarks factor_of_safety` has more cases and points."""

import pytest

from benchmarks import factor_of_safety


def test_a_slope_has_the_factor_of_slices():
    assert factor_of_safety.search("slope", 8) == pytest.approx(factor_of_safety.EXACT["slope"], rel=0.1)


@pytest.mark.parametrize("scheme", [None, "point_state"])
def test_a_layer_without_end_has_the_factor_of_its_friction(scheme):
    """Soil that dilates lifts what lies on it: without, the factor is .93 of that (Davis 1968)."""
    found = factor_of_safety.search("layer", 6, scheme)
    assert found == pytest.approx(factor_of_safety.EXACT["layer"], rel=0.03)
