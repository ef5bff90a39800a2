"""Strips of points that bend, and the continuum that V23 and V24 compare columns with."""

import numpy as np
import pytest

from benchmarks import bending
from benchmarks.library import continuum
from benchmarks.library.verification_cases import buckling
from benchmarks.library.verification_cases.common import BULK, SHEAR


def test_a_slender_continuum_is_an_elastica():
    slenderness = 40.0
    stress = 1.15 * buckling.critical_load(slenderness)
    rise, chord = continuum.pressed(slenderness, stress, BULK, SHEAR, slope=1.0, elements=(48, 1))
    load, exact = buckling.elastica(rise)
    assert 1.15 / load == pytest.approx(1.0, abs=1e-3)
    assert chord == pytest.approx(exact, abs=1e-3)


def test_a_continuum_without_equilibrium_says_so():
    with pytest.raises(RuntimeError, match="no equilibrium of a column of 40.0 thicknesses"):
        continuum.pressed(40.0, np.nan, BULK, SHEAR, elements=(8, 1))


def test_a_strip_lacks_little_more_than_the_bending_of_its_cells():
    scheme, m = bending.KINDS["point_state, sharpened"]
    assert 1.0 / 6.0**2 < bending.softness(6, scheme, m) < 1.5 / 6.0**2
    assert bending.softness(4, "standard", 2.2) > 0.3
