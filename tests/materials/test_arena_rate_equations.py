"""Arena against its rate equations, written down anew here and integrated by scipy at high order.

Nothing of the material's code is used: moduli from the printed formulas, pore pressure by bracketing its
volume balance, derivatives of the yield function by central differences, plastic strain rate from the
consistency condition. sigma' = C:(eps' - epsp'), epsp' = g [s - BETA^2 (F^2)_,I1 I], evp' = -tr epsp',
f = J2 - F(I1_eff, X_eff)^2 (squared, so that it is smooth at the nose of the cap).
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from periporo.materials.arena import Arena
from periporo.materials.laboratory.drive import drive
from periporo.materials.laboratory.paths import STRAIN_COLUMNS, STRESS_COLUMNS, StrainPath, built_in_path

P = {f: d.default for f, d in Arena.model_fields.items()}
TENSOR = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # weights of a double contraction
UNIT = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
ABSOLUTE = np.array([1e-3] * 6 + [1e-12] * 2)  # Pa, strain: undrained, 1e-12 of strain is 1e-2 Pa


class Reference:
    """The rate equations for one parameter set."""

    def __init__(self, **changes):
        self.p = {**P, **changes}
        phi, ref = self.p["initial_porosity"], self.p["reference_porosity"]
        self.factor = math.exp(ref / (1 - ref) - phi / (1 - phi))
        scale = self.p["p1_density_scale_fac"]
        self.p1 = self.p["p1"] * math.exp(scale * self.factor * (self.factor - 1))

    def pressure(self, evp, squeezed=0.0):
        """Root of the volume balance; elastic strain has `squeezed` ln(1/volume) of the pores."""
        phi0, s0, start = (self.p[k] for k in ("initial_porosity", "initial_saturation", "initial_fluid_pressure"))

        def water(p):
            return 2.21e9 + 6.029 * (p - 1e-4)

        def surplus(p):
            air = ((p + 101325) / (start + 101325)) ** (-1 / 1.4)
            wet = (water(p) / water(start)) ** (-1 / 6.029)
            return phi0 * ((1 - s0) * air + s0 * wet) - (math.exp(-evp) - (1 - phi0)) * math.exp(-squeezed)

        if surplus(0.0) <= 0.0:
            return 0.0
        return brentq(surplus, 0.0, 5e10, xtol=1e-9, rtol=1e-15)

    def saturation(self, p, evp, squeezed):
        """Water over pores; pores that are wider than the fluid without pressure are not full."""
        s0, start = self.p["initial_saturation"], self.p["initial_fluid_pressure"]
        air = ((p + 101325) / (start + 101325)) ** (-1 / 1.4)
        wet = ((2.21e9 + 6.029 * (p - 1e-4)) / (2.21e9 + 6.029 * (start - 1e-4))) ** (-1 / 6.029)
        phi0 = self.p["initial_porosity"]
        pores = (math.exp(-evp) - (1 - phi0)) / phi0 * math.exp(-squeezed)
        return s0 * wet / max((1 - s0) * air + s0 * wet, pores)

    def strength(self, evp, p, squeezed=0.0):
        phi0 = self.p["initial_porosity"]
        crush = 0.0
        if evp > 0:
            crush = self.p1 * (phi0 / (1 - (1 - phi0) * math.exp(evp)) - 1) ** (1 / self.p["p2"])
        share = self.saturation(p, evp, squeezed)
        return -(self.p["p0"] + (1 - share + self.p["p1_sat"] * share) * crush)

    def squared_limit(self, i1, x):
        peak, stren, y = self.p["PEAKI1"], self.p["STREN"], self.p["YSLOPE"]
        a2 = (self.p["FSLOPE"] - y) / (stren - y * peak)
        ff = stren - (stren - y * peak) * math.exp(a2 * (i1 - peak)) - y * i1
        kappa = peak - self.p["CR"] * (peak - x)
        cap = 1.0 if i1 > kappa else 1 - ((kappa - i1) / (kappa - x)) ** 2
        return ff * ff * cap

    def moduli(self, i1, p, evp, squeezed):
        """Bulk and shear modulus, and the share of elastic compression that squeezes the pores."""
        b0, b1, b2, b3, b4 = (self.p[f"b{k}"] for k in range(5))
        grain = 40e9
        mean = -i1 / 3
        bulk = b0 * grain
        if mean > 0:
            grain += 4 * (mean - 101325)
            strain = (b3 * mean / (b1 * grain - b2 * mean)) ** (1 / b4)
            bulk = grain**2 / (grain - 4 * mean)
            bulk *= b0 + b1 * b3 * b4 * strain ** (b4 - 1) / (b2 * strain**b4 + b3) ** 2
        nu = self.p["nu1"] + self.p["nu2"] * math.exp(-bulk / grain)
        shear = self.factor * 1.5 * bulk * (1 - 2 * nu) / (1 + nu)
        bulk *= self.factor
        phi = 1 - (1 - self.p["initial_porosity"]) * math.exp(evp)
        share = self.saturation(p, evp, squeezed)
        fluid = 1 / (share / (2.21e9 + 6.029 * (p - 1e-4)) + (1 - share) / (1.4 * (p + 101325)))
        biot = 1 - bulk / grain
        modulus = 1 / (biot / grain + phi * (1 / fluid - 1 / grain))
        total = self.p["pore_pressure"] == "total"
        if (self.p["initial_saturation"] > 0 or total) and (mean > 0 or p > 0):
            bulk += biot**2 * modulus
        return bulk, shear, biot * modulus / fluid if total else 0.0

    def yield_function(self, stress, evp, squeezed):
        p = self.pressure(evp, squeezed)
        i1 = stress[:3].sum()
        s = stress - i1 / 3 * UNIT
        return 0.5 * TENSOR @ s**2 - self.squared_limit(i1 + 3 * p, self.strength(evp, p, squeezed))

    def rates(self, y, strain_rate):
        """Rates of stress, evp, squeeze without plastic flow, the plastic multiplier, and what one unit of it adds."""
        stress, evp, squeezed = y[:6], y[6], y[7]
        p = self.pressure(evp, squeezed)
        x = self.strength(evp, p, squeezed)
        i1 = stress[:3].sum()
        bulk, shear, coupling = self.moduli(i1 + 3 * p, p, evp, squeezed)
        s = stress - i1 / 3 * UNIT
        size = 1e-5 * (abs(x) + abs(i1 + 3 * p))
        slope = self.squared_limit(i1 + 3 * p + size, x) - self.squared_limit(i1 + 3 * p - size, x)
        slope /= 2 * size
        step = 1e-6 * (abs(evp) + 1e-4)
        back = 0.0 if abs(evp) < step else step  # the pressure has a kink at 0

        def slope_by(evp_share, squeeze_share):
            def moved(h):
                return self.yield_function(stress, evp + h * evp_share, squeezed + h * squeeze_share)

            return (moved(step) - moved(-back)) / (step + back)

        def stiffness(e):
            return bulk * e[:3].sum() * UNIT + 2 * shear * (e - e[:3].sum() / 3 * UNIT)

        normal = s - slope * UNIT
        beta = 1.0 if slope < 0.0 and self.p["BETA_acts_on"] == "cap" else self.p["BETA"]
        flow = s - beta**2 * slope * UNIT
        squeeze = -coupling * strain_rate[:3].sum()
        growth = -flow[:3].sum()
        elastic = np.array([*stiffness(strain_rate), 0.0, squeeze])
        plastic = np.array([*-stiffness(flow), growth, -coupling * growth])
        loading = (TENSOR * normal) @ elastic[:6] + (slope_by(0.0, 1.0) * squeeze if squeeze else 0.0)
        resistance = -(TENSOR * normal) @ plastic[:6] - slope_by(1.0, -coupling) * growth
        return elastic, loading / resistance, plastic

    def follow(self, y, increment):
        """Stress, evp and squeeze after a straight strain increment; elastic and plastic parts alternate."""
        time = 0.0
        plastic = self.yield_function(y[:6], y[6], y[7]) > -1e-7 * (1e3 + np.abs(y[:6]).max()) ** 2
        plastic = plastic and self.rates(y, increment)[1] >= 0

        def right(t, y):
            elastic, multiplier, flow = self.rates(y, increment)
            return elastic + multiplier * flow if plastic else elastic

        def leaves(t, y):
            return self.rates(y, increment)[1] if plastic else self.yield_function(y[:6], y[6], y[7])

        leaves.terminal = True
        while time < 1.0:
            leaves.direction = -1 if plastic else 1
            result = solve_ivp(right, (time, 1.0), y, "LSODA", rtol=1e-7, atol=ABSOLUTE, events=leaves)
            time, y = result.t[-1], result.y[:, -1]
            plastic = not plastic
        return y


def compare(path, atol, **parameters):
    """Largest stress difference between the material and the rate equations along `path`."""
    reference = Reference(**parameters)
    material = Arena(T1=0.0, T2=0.0, tolerance=1e-5, **parameters)
    stress = np.zeros((1, 6))
    state = material.initial_state(stress, np.zeros((1, 2), np.int64), np.ones(1))
    other = np.array([*stress[0], 0.0, 0.0])
    largest, gap, strains = 0.0, 0.0, []
    for increment in path:
        material.compute_stress(stress, np.asarray(increment)[None], state, 1.0)
        other = reference.follow(other, np.asarray(increment))
        largest = max(largest, np.abs(other[:6]).max())
        gap = max(gap, np.abs(stress[0] - other[:6]).max())
        strains.append(abs(state[0, 0] - other[6]))
    assert gap < atol * largest
    assert max(strains) < atol


UNIAXIAL = [-0.004, 0, 0, 0, 0, 0]
SHEAR = [-0.001, 0.0005, -0.002, 0.004, -0.003, 0.002]


@pytest.mark.parametrize(
    "parameters",
    [
        {"initial_saturation": 0.0},
        {"initial_saturation": 0.5, "p1_sat": 0.4},
        {"initial_saturation": 0.93, "BETA": 0.6, "CR": 0.7},
        {"initial_saturation": 0.0, "BETA": 1.7, "BETA_acts_on": "cap"},
        {"initial_saturation": 0.3, "initial_fluid_pressure": 2e5},
        {"initial_saturation": 0.5, "p1_sat": 0.4, "pore_pressure": "total"},
    ],
)
def test_cyclic_and_non_proportional(parameters):
    """Compression, shear in all planes, unloading, and reversed shear."""
    unloading = [0.0006, 0.0003, 0, 0, 0, 0]
    reverse = [-0.002, -0.001, 0.0, -0.006, 0.004, 0.001]
    compare([UNIAXIAL, UNIAXIAL, SHEAR, unloading, reverse, UNIAXIAL], 2e-5, **parameters)


@pytest.mark.parametrize("parameters", [{}, {"pore_pressure": "total", "p0": 3e6}], ids=["plastic", "total"])
def test_saturated_shear(parameters):
    """Undrained: the pore pressure carries the compression, the shear moves along the limit surface."""
    path = [[-0.003, 0, 0, 0, 0, 0], SHEAR, [0, 0, 0, -0.004, 0, 0.004]]
    compare(path, 2e-5, initial_saturation=1.0, **parameters)


def driven(corners, rows=10, substeps=10, **parameters):
    """Increments, stress, volumetric plastic and opened strain of the driver at the corners of a strain path."""
    corners = np.array([[0.0] * 6, *corners])
    place = np.arange(rows * (len(corners) - 1) + 1) / rows
    strain = np.stack([np.interp(place, np.arange(len(corners)), column) for column in corners.T], axis=1)
    columns = drive(Arena(T1=0.0, T2=0.0, **parameters), StrainPath("path", place, strain), substeps)
    stress = np.stack([columns[name] for name in STRESS_COLUMNS], axis=1)
    evp, opened = columns["volumetric_plastic_strain"], columns["opened"]
    return np.diff(corners, axis=0), stress[::rows], evp[::rows], opened[::rows]


def assert_follows(increments, stress, evp, opened, accuracy, first=0, **parameters):
    """The rate equations from the state `first` on come to the same stresses and strains."""
    reference, other = Reference(**parameters), np.array([*stress[first], evp[first], 0.0])
    scale = np.abs(stress).max()
    for k in range(first, len(increments)):
        other = reference.follow(other, increments[k])
        assert np.abs(stress[k + 1] - other[:6]).max() < accuracy * scale
        assert abs(evp[k + 1] - other[6]) < accuracy and opened[k + 1] < accuracy


TURNING_SHEAR = [
    [-0.022, -0.02, -0.02, 0, 0, 0],
    [-0.024, -0.02, -0.02, 0.02, 0, 0],
    [-0.024, -0.02, -0.02, 0.02, 0.02, 0],
    [-0.024, -0.02, -0.02, 0, 0.02, 0.02],
    [-0.03, -0.01, -0.02, 0, 0, 0],
]
LARGE_CYCLES = [[e, 0, 0, 0, 0, 0] for e in (-0.06, -0.05, -0.10, -0.085, -0.14)]


@pytest.mark.parametrize("saturation", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("corners", [TURNING_SHEAR, LARGE_CYCLES], ids=["turning", "cycles"])
def test_driver_on_partly_saturated_paths(corners, saturation):
    """At 10 substeps a row; at S0 = 0.9 the pores fill with water on the way, and the stress rises to 350 MPa."""
    result = driven(corners, initial_saturation=saturation)
    assert_follows(*result, 2e-4, initial_saturation=saturation)


@pytest.mark.parametrize("extension", [[0.01, 0.01, 0.01, 0, 0, 0], [0.02, 0, 0, 0, 0, 0]], ids=["all", "one"])
@pytest.mark.parametrize("saturation", [0.0, 0.3])
def test_driver_through_extension_and_recompression(extension, saturation):
    """Extension ends at the vertex, without pore pressure; what came apart closes first on the way back to 6 MPa."""
    corners = [[-0.02, -0.005, -0.005, 0, 0, 0], extension, [-0.03, -0.01, -0.01, 0.004, 0, 0]]
    increments, stress, evp, opened = driven(corners, initial_saturation=saturation)
    assert stress[2, :3].sum() <= 1000.0 * (1 + 1e-9)
    if extension[1]:
        assert stress[2, :3] == pytest.approx(1000.0 / 3, rel=1e-6) and opened[2] > 0.01
    share = opened[2] / -increments[2][:3].sum()
    increments[2] *= 1.0 - share
    assert 0 <= share < 0.7
    assert_follows(increments, stress, evp, opened, 1e-4, first=2, initial_saturation=saturation)


@pytest.mark.parametrize("saturation", [0.0, 0.5])
def test_driver_with_stress_control(saturation):
    """Triaxial compression: the lateral stress stays, and the strains that were found give the stress."""
    parameters = {"initial_saturation": saturation, "p0": 3e6}
    path = built_in_path("triaxial", "confining=1e6,strain=0.06,rows=20")
    columns = drive(Arena(T1=0.0, T2=0.0, tolerance=1e-5, **parameters), path, substeps=1)
    stress = np.stack([columns[name] for name in STRESS_COLUMNS], axis=1)
    strain = np.stack([columns[name] for name in STRAIN_COLUMNS], axis=1)
    assert np.allclose(stress[:, [0, 2]], -1e6, rtol=1e-6)
    evp = columns["volumetric_plastic_strain"]
    assert_follows(np.diff(strain, axis=0), stress, evp, columns["opened"], 1e-4, **parameters)
    assert evp[-1] > 1e-3 and stress[-1, 1] < -2e6
