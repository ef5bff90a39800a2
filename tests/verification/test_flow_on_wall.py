"""What flows do to walls, small: `python -m benchmarks flow_on_wall` prints the same at full size."""

import pytest

from benchmarks import flow_on_wall


def test_the_depth_of_a_bore_keeps_mass_and_momentum():
    for froude in (0.5, 1.0, 3.0):
        h = flow_on_wall.bore_depth(froude)
        back = froude / (h - 1.0)  # speed of the bore over sqrt(g h), from h (v + c) = H c - here of depth 1
        assert froude + back == pytest.approx(h * back, rel=1e-9)
        assert 0.5 * (h * h - 1.0) == pytest.approx((froude + back) * froude, rel=1e-9)


def test_mud_presses_on_a_wall_like_the_bore_that_it_throws_back():
    figures = flow_on_wall.bore(6)
    assert figures["all"] == pytest.approx(1.0, abs=0.05)
    assert figures["late"] == pytest.approx(1.0, abs=0.1)


def test_sand_that_slid_onto_a_wall_rests_between_the_bounds_of_friction():
    figures = flow_on_wall.chute(0.05)
    assert figures["lower bound"] == pytest.approx(0.6) and figures["upper bound"] == pytest.approx(1.4)
    assert figures["lower bound"] < figures["at rest"] < figures["upper bound"] < figures["largest"]
