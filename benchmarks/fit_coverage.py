"""How often 95 % intervals of fitted parameters hold the truth: fits of synthetic tests with noise, drawn many times.

    python -m benchmarks fit_coverage [--draws 100] [--noise 0.015]

Three tests for each law. Each measured value is off by normal noise, a share of its column's range. The rate should be
0.95; of that many draws it is off by up to the last column, twice its deviation.
"""

import math
import tempfile
from pathlib import Path

import numpy as np

import periporo
from periporo.materials.laboratory.files import write_table

from . import option_parser

CLAY = {
    "model": "cam_clay", "grain_density": 2700.0, "porosity": 0.45, "bulk_modulus": 8e6, "shear_modulus": 5e6,
    "critical_state_slope": 1.05, "compression_index": 0.08, "swelling_index": 0.01,
}  # fmt: skip
SAND = {
    "model": "mohr_coulomb", "density": 1700.0, "bulk_modulus": 20e6, "shear_modulus": 12e6, "cohesion": 5e3,
    "friction_angle": 33.0, "dilation_angle": 6.0,
}  # fmt: skip
NAME, RATE = "axial_strain", 0.95


def triaxial(pressure, **keys):
    """A test at a confining pressure in Pa."""
    phase = {"type": "triaxial", "strain": 0.15, "rows": 15, **keys}
    return {"pressure": pressure, "substeps": 2, "phases": [phase]}


OEDOMETER = {"pressure": 2e4, "phases": [{"type": "oedometer", "strain": 0.12, "rows": 15}], "substeps": 2}
BOTH = ["q", "volumetric_strain"]
CASES = {
    "cam_clay": (
        CLAY, {"critical_state_slope": 0.8, "compression_index": 0.11, "shear_modulus": 6.5e6},
        [(triaxial(1e5), BOTH), (triaxial(2e5, drainage="undrained"), ["q", "pore_pressure"]),
         (OEDOMETER, ["axial_stress"])],
    ),
    "mohr_coulomb": (
        SAND, {"friction_angle": 28.0, "cohesion": 8e3, "dilation_angle": 3.0},
        [(triaxial(pressure), BOTH) for pressure in (5e4, 1e5, 2e5)],
    ),
}  # fmt: skip


def fitted(case, noise, seed, folder):
    """Of each parameter whether its interval holds the truth, how far off it is, and half the interval, over it."""
    truth, start, tests = case
    rng, entries = np.random.default_rng(seed), []
    for k, (test, names) in enumerate(tests):
        columns, file = periporo.drive(truth, test), folder / f"lab{k}.csv"
        count = len(columns[NAME])
        off = {n: columns[n] + noise * np.ptp(columns[n]) * rng.normal(size=count) for n in names}
        write_table(file, {n: values[1:] for n, values in ({NAME: columns[NAME]} | off).items()})
        entries.append({"test": test, "measured": str(file), "over": NAME, "compare": names})
    fit = periporo.fit(truth | start, {"parameters": dict.fromkeys(start), "tests": entries})
    off = {name: fit.values[name] - truth[name] for name in start}
    return [(abs(off[n]) <= fit.confidence[n], off[n] / truth[n], fit.confidence[n] / truth[n]) for n in start]


def main(words=None):
    """Print a row for each parameter."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--draws", type=int, default=100, help="fits of each law")
    parser.add_argument("--noise", type=float, default=0.015, help="of each value, over its column's range")
    arguments = parser.parse_args(words)
    spread = 2.0 * math.sqrt(RATE * (1.0 - RATE) / arguments.draws)
    print("| law | parameter | rate | mean error | half the interval | off by chance |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        for law, case in CASES.items():
            draws = np.array([fitted(case, arguments.noise, seed, Path(name)) for seed in range(arguments.draws)])
            for parameter, (rate, _, width), error in zip(
                case[1], draws.mean(axis=0), np.sqrt((draws[:, :, 1] ** 2).mean(axis=0)), strict=True
            ):
                print(f"| {law} | {parameter} | {rate:.3f} | {error:.4f} | {width:.4f} | {spread:.3f} |", flush=True)
