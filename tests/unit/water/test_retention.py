"""Water retention: parameter sets, formulas, tables, and slopes."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from periporo.core.numerics.jit import kernel
from periporo.core.water.retention import (
    RETENTION,
    Retention,
    exponential,
    of_voids,
    packed,
    saturation_of,
    tabulated,
    van_genuchten,
)


def at(name, suction, porosity=0.2, ratio=1.0):
    return of_voids(*RETENTION[name]).saturation(suction, np.array([porosity]), np.array([ratio]))[0]


def test_both_parameter_sets():
    """The printed parameters give nearly full pores; the fitted ones the saturations that the paper states."""
    assert [at("menon_song", s) for s in (25e3, 50e3)] == pytest.approx([0.9996, 0.9989], abs=5e-5)
    assert [at("fitted", s) for s in (25e3, 50e3)] == pytest.approx([0.92, 0.88], abs=5e-4)
    for name in RETENTION:
        assert at(name, 0.0) == 1.0
        assert at(name, 1e12) < 0.2


def test_retention_follows_the_volume():
    """x = alpha1 (v - 1)^alpha2 J s with v = 1/(1 - phi): compaction of the pores holds water back."""
    a1, a2, a3 = RETENTION["fitted"]
    porosity, ratio, suction = 0.35, 1.23, 40e3
    x = a1 * (1.0 / (1.0 - porosity) - 1.0) ** a2 * ratio * 40.0
    assert at("fitted", suction, porosity, ratio) == pytest.approx((1 + x**a3) ** ((1 - a3) / a3), rel=1e-14)
    assert at("fitted", suction, 0.15, 0.94) > at("fitted", suction) > at("fitted", suction, 0.3, 1.14)
    assert at("fitted", suction, 0.0) == 1.0 and np.isnan(at("fitted", suction, np.nan))


def test_table_is_a_monotone_interpolation():
    s, y = np.array([0.0, 5e3, 20e3, 60e3, 90e3]), np.array([1.0, 0.97, 0.6, 0.55, 0.2])
    table, reference = tabulated(s, y), PchipInterpolator(s, y)
    inner = np.linspace(5e3, 60e3, 301)  # beyond, the end slopes differ
    found = table.saturation(inner, np.zeros(301), np.ones(301))
    assert found == pytest.approx(reference(inner), abs=1e-13)
    everywhere = table.saturation(np.linspace(0, 1e5, 999), np.zeros(999), np.ones(999))
    assert (np.diff(everywhere) <= 1e-15).all() and everywhere[-1] == 0.2
    assert table.saturation(20e3, np.zeros(3), np.ones(3)) == pytest.approx([0.6] * 3)


@pytest.mark.parametrize("rows", [([0, 1], [1.0, 1.1]), ([0, 0], [1.0, 0.9]), ([0, 1], [0.5, 0.9]), ([0], [1.0]),
                                  ([0, 1], [0.9, 0.5])])
def test_a_table_that_is_no_retention_curve_is_refused(rows):
    with pytest.raises(ValueError, match="retention table"):
        tabulated(*rows)


def test_formulas():
    s = np.array([-1e3, 0.0, 4e3, 50e3])
    filled = van_genuchten(0.25, 2.0, 0.1).saturation(s, np.full(4, 0.3), np.ones(4))
    assert filled == pytest.approx([1.0, 1.0, 0.1 + 0.9 / np.sqrt(2.0), 0.1 + 0.9 / np.sqrt(1.0 + 12.5**2)])
    filled = exponential(0.1, 0.2).saturation(s, np.full(4, 0.3), np.ones(4))
    assert filled == pytest.approx([1.0, 1.0, 0.2 + 0.8 * np.exp(-0.4), 0.2 + 0.8 * np.exp(-5.0)])
    assert Retention(0).saturation(1e9, np.full(2, 0.3), np.ones(2)).tolist() == [1.0, 1.0]


@kernel
def _values_and_slopes(curves, suction, result):
    for k in range(suction.shape[0]):
        for m in range(curves.shape[0]):
            result[k, m, 0], result[k, m, 1] = saturation_of(curves, m, suction[k], 0.35, 1.1)


def test_slopes_are_those_of_the_values():
    """Every curve, side by side in one table, against central differences."""
    table = tabulated([0.0, 5e3, 20e3, 60e3, 90e3], [1.0, 0.97, 0.6, 0.55, 0.2])
    curves = packed([of_voids(*RETENTION["fitted"]), van_genuchten(0.2, 1.7, 0.05), exponential(0.05, 0.1), table])
    suction = np.array([1e3, 7e3, 30e3, 80e3, 95e3])
    here, after, before = np.zeros((3, 5, 4, 2))
    _values_and_slopes(curves, suction, here)
    _values_and_slopes(curves, suction + 0.5, after)
    _values_and_slopes(curves, suction - 0.5, before)
    assert here[..., 1] == pytest.approx(after[..., 0] - before[..., 0], rel=1e-5, abs=1e-13)
    assert (here[:4, :, 1] < 0.0).all()
