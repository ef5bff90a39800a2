"""V11 to V14: Cam-Clay against closed forms, with the helpers of its own tests."""

import importlib.util

import numpy as np
from scipy.optimize import brentq

from periporo.core.numerics.tensors import equivalent_shear, mean

from ... import ROOT
from .common import Figure, order


def _tests():
    """The module tests/materials/test_cam_clay.py of this checkout."""
    path = ROOT / "tests" / "materials" / "test_cam_clay.py"
    spec = importlib.util.spec_from_file_location("cam_clay_tests", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _followed(volumetric, shear, steps, pressure=-1e3, until=None, **parameters):
    """Stress row after `steps` equal increments from isotropic `pressure` Pa, or when until(stress) holds."""
    t = _tests()
    material, stress = t.soil(**parameters), t.isotropic(pressure)
    state = material.initial_state(stress, t.IDS, t.VOLUME)
    increment = t.triaxial_increment(volumetric / steps, shear / steps)
    for _ in range(steps):
        material.compute_stress(stress, increment, state, t.NEVER)
        if until is not None and until(stress):
            break
    return stress


def isotropic_compaction(full=False, scheme=None):
    """V11: (l - k) ln(p/p0) + (p - p0)/K = 0.05 from 1 kPa."""
    pressure = -mean(_followed(-0.05, 0.0, 50))[0]
    return [Figure("pressure against 1867.43584 Pa, relative", abs(pressure / 1867.43584 - 1.0), at_most=1e-6)]


def constant_pressure_shear(full=False, scheme=None):
    """V12: the integral of the flow rule at constant pressure."""
    t = _tests()
    p, strain = 1e3, 0.2

    def shear_strain(q):
        ratio = q / p
        flow = np.log((t.M + ratio) / (t.M - ratio)) / t.M - 2.0 / t.M * np.arctan(ratio / t.M)
        return t.PLASTIC_INDEX * flow + q / (3.0 * t.MU)

    exact = brentq(lambda q: shear_strain(q) - strain, 0.0, t.M * p * (1.0 - 1e-9))
    errors = [abs(t.constant_pressure_shear(n, strain) / exact - 1.0) for n in (1500, 3000)]
    return [
        Figure("shear stress at 3000 steps, relative", errors[1], at_most=1e-3),
        Figure("order in the step", order(errors), at_least=0.9),
    ]


def undrained_critical_state(full=False, scheme=None):
    """V13: critical state at constant volume from p0 = -1, p_c0 = -1.25 kPa."""
    stress = _followed(0.0, 20.0, 400, overconsolidation_ratio=1.25)
    p, q = mean(stress)[0], equivalent_shear(stress)[0]
    return [
        Figure("pressure against -625.11716 Pa, relative", abs(p / -625.11716 - 1.0), at_most=1e-6),
        Figure("shear stress against 687.62888 Pa, relative", abs(q / 687.62888 - 1.0), at_most=1e-6),
    ]


def oedometer(full=False, scheme=None):
    """V14: K0 of virgin compression at 1.2 kPa."""
    strain = 2e-4 * 5000  # axis yy: a third of it volumetric on each axis, and as much shear as makes x and z zero
    stress = _followed(-strain, 2.0 / 3.0 * strain, 5000, pressure=-10.0, until=lambda s: s[0, 1] < -1.2e3)
    return [Figure("K0 against 0.7096, difference", abs(stress[0, 0] / stress[0, 1] - 0.7096), at_most=1e-3)]
