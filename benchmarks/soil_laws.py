"""Closed forms of the laws of soils, each driven as in the laboratory: how far the law is from it.

    python -m benchmarks soil_laws [--write]

A row is a closed form with its source, the error that is measured here, what it may be, and the tests that hold it.
`--write` keeps the table in docs/reference/verification/soils.md. Exit status 1 if a row is missed.
"""

import sys
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from math import cos, exp, log, radians, sin, sqrt, tan

import numpy as np

import periporo
from periporo.materials import registry
from periporo.materials.granular_mu_i import GranularMuI

from . import ROOT, option_parser

PAGE = ROOT / "docs" / "reference" / "verification" / "soils.md"
HEAD = """# Verification: closed forms of soils

For readers who ask whether a law is what its page says. Each row is a closed form with its source, the largest relative
error of the law, driven as by [`periporo drive`](../../how-to/drive_a_material.md), and the tests of `tests/materials`
that hold it, in more cases and in both dimensions (a file, and what pytest's option `-k` takes).

    python -m benchmarks soil_laws --write          # measures all rows, and makes this page

Symbols are those of the laws' pages ([materials](../materials.md)).
"""
TAIL = """## Elsewhere

Grains stand below the static angle, and flow above (`test_granular_mu_i.py -k static_angle`). Constant pressure,
critical state and $K_0$ of Cam-Clay with constant moduli are [V11 to V14](closed_forms.md). Laws of others equal the
built-in ones to 1e-14 (`test_umat.py -k equals`). The length of softening, whose measure is a band in a scene, is on
the page of [`mohr_coulomb`](../laws/mohr_coulomb.md).
"""
K, G, C = 25e6, 15e6, 1e4
STIFF = {"density": 1700.0, "bulk_modulus": K, "shear_modulus": G}
FRICTIONAL = {"model": "mohr_coulomb", **STIFF, "cohesion": C, "friction_angle": 30.0, "dilation_angle": 10.0}
TRESCA = {"model": "mohr_coulomb", **STIFF, "cohesion": 3e4, "friction_angle": 0.0}
CLAY = {
    "model": "cam_clay", "grain_density": 2700.0, "porosity": 0.4, "critical_state_slope": 1.1,
    "compression_index": 0.1, "swelling_index": 0.02,
}  # fmt: skip
LINEAR, SWELLING = CLAY | {"bulk_modulus": 10e6, "shear_modulus": 6e6}, CLAY | {"poisson_ratio": 0.25}
GRAINS = GranularMuI.example()


@dataclass(frozen=True)
class Row:
    """A closed form of a law: `how` measures the relative error, which may be at most `bound`."""

    law: str
    form: str
    how: Callable[[], float]
    bound: float
    test: str

    def entry(self, found: str) -> str:
        """What the page says of it."""
        file, _, name = self.test.partition("::")
        text = f"{self.form}: error {found}, at most {self.bound:g}. Held by `{file} -k {name}`."
        return textwrap.fill(text, 120, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False)


def example(model: str, **changes: float | None) -> dict:
    """The example material of a law."""
    return {"model": model} | registry.load(model).example().model_dump(exclude_none=True) | changes


def driven(material: dict, *phases: dict, pressure: float = 1e5, substeps: int = 10) -> dict[str, np.ndarray]:
    """The columns of a test."""
    return periporo.drive(material, {"pressure": pressure, "substeps": substeps, "phases": list(phases)})


def largest(found: np.ndarray | float, exact: np.ndarray | float) -> float:
    """The largest relative error."""
    return float(np.max(np.abs(np.asarray(found) / exact - 1)))


def sheared(material: dict, angle: float, rate: float | None = None, **keys: float) -> tuple[float, float]:
    """Shear stress and angle at the end of simple shear at constant vertical stress."""
    phase = {"type": "simple_shear", "strain": angle, "rows": 100} | ({"duration": angle / rate} if rate else {})
    columns = driven(material, phase, **keys)
    return abs(columns["tau"][-1]), abs(columns["gamma"][-1])


def strength() -> float:
    """Axial stress at failure at a constant lateral one."""
    found = driven(FRICTIONAL, {"type": "triaxial", "strain": 0.04, "rows": 20})
    slope = tan(radians(60)) ** 2
    return largest(found["axial_stress"][-1], slope * 1e5 + 2 * C * sqrt(slope))


def dilation() -> float:
    """Volumetric over axial strain rate at failure."""
    found = driven(FRICTIONAL, {"type": "triaxial", "strain": 0.04, "rows": 20})
    rate = np.diff(found["volumetric_strain"])[-1] / np.diff(found["axial_strain"])[-1]
    return largest(rate, -2 * sin(radians(10)) / (1 - sin(radians(10))))


def remoulding() -> float:
    """Shear stress of sensitive clay while it softens, and after."""
    errors = []
    for angle in (0.2, 0.7):
        tau, gamma = sheared(TRESCA | {"sensitivity": 6.0, "remoulding_shear": 0.4}, angle)
        errors.append(largest(tau, 3e4 * (1 - (1 - 1 / 6) * min((gamma - tau / G) / 0.4, 1))))
    return max(errors)


def rate_of_clay() -> float:
    """Undrained strength at rates of one to three decades above the reference."""
    law = TRESCA | {"rate_coefficient": 0.1, "reference_rate": 1e-2}
    return max(largest(sheared(law, 0.1, 1e-2 * 10**k)[0], 3e4 * (1 + 0.1 * k)) for k in (1, 2, 3))


def friction_of_grains() -> float:
    """Shear over normal stress at three inertial numbers."""
    errors, pressure = [], 2e3
    span = GRAINS.largest_friction - GRAINS.static_friction
    for inertial in (1e-3, 0.1, 3.0):
        rate = inertial * sqrt(pressure / GRAINS.grain_density) / GRAINS.grain_diameter
        tau, _ = sheared(example("granular_mu_i"), 0.5, rate, pressure=pressure)
        exact = GRAINS.static_friction + span / (1 + GRAINS.inertial_number / inertial)
        errors.append(largest(tau, pressure * exact))
    return max(errors)


def chute(angle: float, layers: int = 20, depth: float = 0.01, duration: float = 3.0) -> tuple[np.ndarray, np.ndarray]:
    """Heights (layers + 1,) m and speeds m/s of the faces of layers of grains on an endless slope of `angle`.

    A momentum balance along the slope, explicit in time, with the law in each layer.
    """
    h, g = depth / layers, 9.81
    heights = (np.arange(layers) + 0.5) * h
    pressure = GRAINS.density * g * np.cos(angle) * (depth - heights)
    law = GRAINS.model_copy(update={"shear_modulus": 5e3, "bulk_modulus": 1e6})  # slow waves: long steps
    dt = 0.5 * h * np.sqrt(law.density / law.shear_modulus)
    stress = np.zeros((layers, 4))
    stress[:, :3], stress[:, 3] = -pressure[:, None], pressure * np.tan(angle)
    state, speed, increment = np.zeros((layers, 1)), np.zeros(layers + 1), np.zeros((layers, 4))
    for _ in range(int(duration / dt)):
        increment[:, 3] = 0.5 * np.diff(speed) / h * dt
        law.compute_stress(stress, increment, state, dt)
        above = np.append(stress[1:, 3], 0.0)
        mass = np.append(np.ones(layers - 1), 0.5) * h * law.density
        speed[1:] += dt * (g * np.sin(angle) + (above - stress[:, 3]) / mass)
    return np.append(0.0, heights + 0.5 * h), speed


def bagnold() -> float:
    """Speeds down a slope of 25 degrees, over the largest."""
    angle, depth = radians(25), 0.01
    height, speed = chute(angle, depth=depth)
    span = GRAINS.largest_friction - GRAINS.static_friction
    inertial = GRAINS.inertial_number / (span / (tan(angle) - GRAINS.static_friction) - 1)
    scale = inertial * sqrt(GRAINS.density / GRAINS.grain_density * 9.81 * cos(angle)) / GRAINS.grain_diameter
    exact = 2 / 3 * scale * (depth**1.5 - (depth - height) ** 1.5)
    return float(np.abs(speed - exact).max() / exact[-1])


def bauer() -> float:
    """Void ratio of the loosest sand from 10 to more than 100 kPa, after a tenth of the strain."""
    void = 1.05 * exp(-((3e4 / 1e9) ** 0.25))
    sand = example("hypoplastic_sand", initial_void_ratio=void, turn_stiffness=1.0, reversal_stiffness=1.0)
    found = driven(sand, {"type": "isotropic", "strain": 0.05, "rows": 50}, pressure=1e4)
    return largest(found["void_ratio"][5:], 1.05 * np.exp(-((3 * found["p"][5:] / 1e9) ** 0.25)))


def mobilised(void: float, strain: float) -> np.ndarray:
    """Angle of friction, degrees, in drained triaxial compression of Hochstetten sand at 100 kPa."""
    sand = example("hypoplastic_sand", initial_void_ratio=void)
    found = driven(sand, {"type": "triaxial", "strain": strain, "rows": 100})
    ratio = found["axial_stress"] / found["radial_stress"]
    return np.degrees(np.arcsin((ratio - 1) / (ratio + 1)))


def virgin() -> float:
    """Volumetric strain of isotropic compression tenfold, with a constant modulus."""
    found = driven(LINEAR, {"type": "isotropic", "stress": 1e5, "rows": 50}, pressure=1e4)
    return largest(found["volumetric_strain"][-1], 0.08 * log(10) + 9e4 / 10e6)


def swelling() -> float:
    """Pressure along the line of kappa, and back to the virgin line."""
    law = SWELLING | {"overconsolidation_ratio": 4.0}
    found = driven(law, {"type": "isotropic", "strain": 0.02 * log(3), "rows": 20}, pressure=1e4)
    return largest(found["p"], 1e4 * np.exp(found["volumetric_strain"] / 0.02))


def critical_state() -> float:
    """Pressure and deviator of undrained clay sheared far."""
    law = SWELLING | {"overconsolidation_ratio": 1.5}
    found = driven(law, {"type": "triaxial", "strain": 0.3, "drainage": "undrained", "rows": 100})
    exact = 1e5 * 0.75 ** (1 - 0.02 / 0.1)
    return max(largest(found["p"][-1], exact), largest(found["q"][-1], 1.1 * exact))


def depth_of_overconsolidation() -> float:
    """Yield in isotropic compression from two depths, one overburden gone."""
    law, errors = SWELLING | {"preoverburden": 2e4}, []
    for pressure in (1e4, 1e5):
        found = driven(law, {"type": "isotropic", "strain": 0.001, "rows": 1}, pressure=pressure)
        errors.append(largest(-found["preconsolidation"][0], pressure + 2e4))
    return max(errors)


def peak_of_norsand() -> float:
    """Largest q/p in drained triaxial compression."""
    sand = example("norsand", coupling=0.0, initial_state_parameter=-0.1)
    found = driven(sand, {"type": "triaxial", "strain": 0.12, "rows": 400})
    k = int(np.argmax(found["q_over_p"]))
    exact = sand["critical_state_slope"] - sand["dilatancy"] * found["state_parameter"][k]
    return largest(found["q_over_p"][k], exact)


def critical_norsand() -> float:
    """Pressure and deviator of loose sand sheared far at constant volume."""
    sand = example("norsand", initial_state_parameter=None, initial_void_ratio=0.78)
    found = driven(sand, {"type": "triaxial", "strain": 0.8, "drainage": "undrained", "rows": 200})
    void = found["void_ratio"][-1]
    exact = 1e3 * exp((sand["critical_void_ratio"] - void) / sand["compression_index"])
    return max(largest(found["p"][-1], exact), largest(found["q_over_p"][-1], sand["critical_state_slope"]))


def flow_curve() -> float:
    """Shear stress of mud over four decades of rate, exponent one half."""
    mud = example("herschel_bulkley", exponent=0.5)
    rates = (1e-3, 1e-1, 10.0)
    exact = (mud["yield_stress"] + mud["consistency"] * rate**0.5 for rate in rates)
    return max(largest(sheared(mud, 1.0, rate, pressure=1e3)[0], tau) for rate, tau in zip(rates, exact, strict=True))


ROWS = (
    Row("mohr_coulomb", r"$\sigma_1 = N \sigma_3 + 2 c \sqrt N$, $N = \tan^2(45^\circ + \varphi/2)$ (Mohr-Coulomb)",
        strength, 1e-9, "test_mohr_coulomb.py::same_in_every_test"),
    Row("mohr_coulomb", r"$\dot\varepsilon_v/\dot\varepsilon_1 = -2 \sin\psi/(1 - \sin\psi)$ at failure",
        dilation, 1e-6, "test_mohr_coulomb.py::dilates"),
    Row("mohr_coulomb", r"$\tau = s_u (1 - (1 - 1/S_t) \min(\gamma^p/\gamma_r, 1))$",
        remoulding, 1e-6, "test_mohr_coulomb.py::remoulded"),
    Row("mohr_coulomb", r"$\tau = s_u (1 + \mu \log_{10}(\dot\gamma/\dot\gamma_0))$, three decades",
        rate_of_clay, 1e-5, "test_mohr_coulomb.py::each_decade"),
    Row("granular_mu_i", r"$\tau = \mu(I)\, P$ at $I$ = .001, .1, 3 (Jop et al. 2006)",
        friction_of_grains, 1e-6, "test_granular_mu_i.py::steady_shear"),
    Row("granular_mu_i", "Bagnold's profile down 25 degrees, over the largest speed",
        bagnold, 0.02, "test_granular_mu_i.py::bagnold"),
    Row("hypoplastic_sand", r"$e_i = e_{i0} \exp(-(3p/h_s)^n)$ (Bauer 1996)",
        bauer, 2e-3, "test_hypoplastic_sand.py::bauer"),
    Row("hypoplastic_sand", "peak 46.2 degrees at $e_0$ = .6 (von Wolffersdorff 1996)",
        lambda: largest(mobilised(0.6, 0.25).max(), 46.2), 8e-3, "test_hypoplastic_sand.py::peaks"),
    Row("hypoplastic_sand", "peak 36.4 degrees at $e_0$ = .75 (von Wolffersdorff 1996)",
        lambda: largest(mobilised(0.75, 0.25).max(), 36.4), 8e-3, "test_hypoplastic_sand.py::peaks"),
    Row("hypoplastic_sand", "residual 33 degrees, sheared far",
        lambda: largest(mobilised(0.8, 3.0)[-1], 33.0), 0.012, "test_hypoplastic_sand.py::critical_state"),
    Row("cam_clay", r"$\varepsilon_v = (\lambda - \kappa) \ln(p/p_0) + (p - p_0)/K$",
        virgin, 1e-6, "test_cam_clay.py::compaction_hardens"),
    Row("cam_clay", r"$K = p/\kappa$: $p = p_0 \exp(\varepsilon_v/\kappa)$ below $p_c$",
        swelling, 1e-9, "test_cam_clay.py::line_of_kappa"),
    Row("cam_clay", r"undrained $p = p_0\,(R/2)^{1 - \kappa/\lambda}$, $q = M p$ ($R$: overconsolidation)",
        critical_state, 5e-3, "test_cam_clay.py::undrained_shear_with_kappa"),
    Row("cam_clay", "$p_c$ is $p$ and the overburden that is gone, at two depths",
        depth_of_overconsolidation, 1e-2, "test_cam_clay.py::fades_with_depth"),
    Row("norsand", r"drained peak $q/p = M_{tc} - \chi \psi$ (Jefferies & Been 2015)",
        peak_of_norsand, 2e-3, "test_norsand.py::at_the_peak"),
    Row("norsand", r"undrained $p = \exp((\Gamma - e)/\lambda)$ kPa, $q = M_{tc}\, p$",
        critical_norsand, 5e-3, "test_norsand.py::constant_volume"),
    Row("herschel_bulkley", r"$\tau = \tau_y + k \dot\gamma^n$, four decades, $n = .5$ (Herschel & Bulkley 1926)",
        flow_curve, 1e-6, "test_herschel_bulkley.py::flow_curve"),
)  # fmt: skip


def page(found: dict[Row, float]) -> str:
    """The whole page."""
    parts = [HEAD]
    for law in dict.fromkeys(row.law for row in ROWS):
        rows = [row.entry(f"{found[row]:.1e}") for row in ROWS if row.law == law]
        parts.append("\n".join([f"## [`{law}`](../laws/{law}.md)\n", *rows, ""]))
    return "\n".join([*parts, TAIL])


def main(words=None):
    """Measure the rows, and print them."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--write", action="store_true", help="keep the table in the documents")
    arguments = parser.parse_args(words)
    found = {}
    for row in ROWS:
        found[row] = row.how()
        end = "met" if found[row] <= row.bound else "MISSED"
        print(f"{row.law:18}{row.how.__doc__ or row.form}: {found[row]:.2e} ({row.bound:g}), {end}", flush=True)
    if arguments.write:
        PAGE.write_text(page(found))
    sys.exit(0 if all(found[row] <= row.bound for row in ROWS) else 1)
