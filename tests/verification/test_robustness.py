"""A few of the random columns of the benchmark `robustness` on a coarse grid."""

import numpy as np
import pytest

from benchmarks import robustness


@pytest.mark.parametrize("number", [0, 3, 7, 8])
def test_a_random_column_falls_without_harm(number):
    draw = robustness.draw(number)
    outcome = robustness.run(draw, spacing=0.01, duration=0.1)
    assert outcome.sound, outcome
    assert outcome.speed > 1e-3, "nothing moved"
    highest = draw.height + 0.01 * draw.jitter + 0.001  # nothing rose by more than a tenth of a spacing
    assert outcome.height_left < highest / robustness.HALF_WIDTH


def test_draws_are_reproducible_and_spread():
    draws = [robustness.draw(k) for k in range(60)]
    assert robustness.draw(17) == draws[17]
    assert {d.influence for d in draws} == set(robustness.INFLUENCES)
    assert any(d.suction is None for d in draws) and any(d.viscosity == 0.0 for d in draws)
    for name, low, high in (("friction", 0, 1), ("jitter", 0, 0.3), ("height", 0.025, 0.2), ("horizon", 1.8, 3.2)):
        values = np.array([getattr(d, name) for d in draws])
        assert values.min() >= low and values.max() <= high and np.ptp(values) > 0.7 * (high - low), name


def test_a_column_that_is_too_fast_or_nan_is_not_sound():
    good = robustness.Outcome("done", 1.0, 2.0, 1.0, 0.0, 10, 0, 0, 1.0)
    assert good.sound
    fields = good.__dict__
    for wrong in ({"speed": 3.1}, {"speed": np.nan}, {"front": np.nan}, {"verdict": "WatchdogError: nan"}):
        assert not robustness.Outcome(**(fields | wrong)).sound
