"""Which way is up."""

import pytest

from periporo.core.numerics.gravity import vertical_axis


@pytest.mark.parametrize(
    ("gravity", "axis"),
    [([0, -9.8], 1), ([-9.8, 0], 0), ([6.9, -6.9], 1), ([8, -5], 1), ([3, 0], 0), ([0, 0, -9.8], 2), ([0, -1, 0], 1)],
)
def test_down_is_down(gravity, axis):
    """A chute runs along x, and gravity may pull along it as well: y is up all the same."""
    assert vertical_axis(gravity, len(gravity)) == axis


@pytest.mark.parametrize("dimension", [2, 3])
def test_without_gravity_the_last_axis_is_up(dimension):
    assert vertical_axis(None, dimension) == vertical_axis([0.0] * dimension, dimension) == dimension - 1
