"""A pile that is pushed into clay: `python -m benchmarks pile` goes deeper, with more points."""

import pytest

from benchmarks import pile


def test_a_pile_meets_the_bearing_capacity_of_clay():
    history = pile.push(4, deepest=0.25)
    found = pile.factors(history, 4, (0.1, 0.2))
    assert found == pytest.approx(pile.skempton((0.1, 0.2)).tolist(), rel=0.1)
    assert found[1] > found[0] > pile.SURFACE
    assert history[0, 1] < 0.1 * pile.SURFACE  # it begins on the surface, without a force
