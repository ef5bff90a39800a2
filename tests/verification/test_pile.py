"""A pile that is pushed into clay: `python -m benchmarks pile` goes deeper, with more points."""

import pytest

from benchmarks import pile


def test_a_pile_meets_the_bearing_capacity_of_clay():
    history = pile.push(4, deepest=0.65)
    found = pile.factors(history, (0.1, 0.2, 0.6), 1.0 / 12.0)
    assert found[:2] == pytest.approx([pile.SURFACE, pile.SURFACE], rel=0.08)
    assert found[2] == pytest.approx(pile.skempton(0.6), rel=0.12)
    assert history[0, 1] < 0.1 * pile.SURFACE  # it begins on the surface, without a force


def test_a_cone_bears_more_as_it_goes_deeper():
    found = pile.factors(pile.push_cone(2, deepest=2.0, clay=8.0), (1.0, 1.8), 1.0 / 6.0)
    assert found == pytest.approx([1.4, 4.8], rel=0.1) and found[1] < pile.DEEP_CONE
