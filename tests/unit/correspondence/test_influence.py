"""Influence functions against their closed forms."""

import numpy as np
import pytest

from periporo.core.correspondence.influence import NAMES, influence_table, influences


def values(name, distance):
    return influences(1.0 - distance, influence_table(name))


def spline(s):
    return np.where(s < 0.5, 1 - 6 * s**2 + 6 * s**3, 2 * (1 - s) ** 3)


def gaussian(s):
    return (np.exp(-((s / 0.4) ** 2)) - np.exp(-6.25)) / (1 - np.exp(-6.25))


FORMS = {"cubic": spline, "conical": lambda s: 1 - s, "constant": np.ones_like, "gaussian": gaussian}


@pytest.mark.parametrize("name", NAMES)
def test_closed_form(name):
    s = np.linspace(0, 1 - 1e-12, 2001)
    tolerance = 5e-4 if name == "gaussian" else 1e-14
    assert values(name, s) == pytest.approx(FORMS[name](s), abs=tolerance)


@pytest.mark.parametrize("name", NAMES)
def test_positive_inside_the_horizon_and_never_growing(name):
    s = 1 - np.logspace(-14, 0, 400)[::-1]
    w = values(name, s)
    assert (w > 0).all() and (np.diff(w) <= 1e-15).all()


@pytest.mark.parametrize("name", [n for n in NAMES if n != "constant"])
def test_vanishes_at_the_horizon(name):
    assert values(name, np.array([1 - 1e-9]))[0] < 1e-8


def test_gaussian_halves_join_smoothly():
    """Value and two derivatives at s = 1/2, by one-sided differences."""
    step = 1e-3
    side = np.arange(4) * step
    left, right = values("gaussian", 0.5 - side), values("gaussian", 0.5 + side)
    slopes = [(-11 * f[0] + 18 * f[1] - 9 * f[2] + 2 * f[3]) / (6 * step) for f in (left, right)]
    bends = [(2 * f[0] - 5 * f[1] + 4 * f[2] - f[3]) / step**2 for f in (left, right)]
    assert slopes[0] == pytest.approx(-slopes[1], rel=1e-6) and bends[0] == pytest.approx(bends[1], rel=2e-3)


def test_unknown_name_tells_the_allowed_ones():
    with pytest.raises(ValueError, match="no function 'cone'; allowed: cubic, conical, gaussian, constant"):
        influence_table("cone")
