"""Walls against Rankine, few points of height: `python -m benchmarks retaining_wall` takes more."""

import pytest

from benchmarks import retaining_wall


def test_walls_bear_the_thrusts_of_rankine():
    found = retaining_wall.thrusts(8)
    assert found["passive"] == pytest.approx(1.0, abs=0.1)
    assert 0.8 < found["active"] < 1.0  # the floor takes a part in the corner, in proportion to the spacing


def test_on_a_smooth_floor_the_active_thrust_is_that_of_rankine():
    assert retaining_wall.active(8, 0.0) == pytest.approx(1.0, abs=0.08)
