"""Load and shear band of softening clay over a factor of four in spacing, with and without a length.

    python -m benchmarks softening_length [--spacings 0.1 0.05 0.025] [--folder DIR]

A biaxial test in plane strain: a notched block of clay, 1 m wide and 2 m high, is pressed together by 5 % of its height
between smooth ends. The clay loses two thirds of its strength. The table has, for each way and spacing, the largest
load and the last one over 2 c, the work over 2 c and the volume, and the width of the band, from the displacement u
along it since the peak: u of the place s across the band is an error function of s, whose slope is a bell with the
deviation d, and the width is 2 sqrt(pi) d, (int u' ds)^2/(int u'^2 ds). Strain would not do: that of a point is a mean
over its horizon, and a coarse one makes bands look wide that are not.
"""

import math
from pathlib import Path

import matplotlib
import numpy as np

from .library.verification_cases.common import owned, simulation

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from scipy.optimize import curve_fit
from scipy.special import erf

from . import FIGURES, option_parser

WIDTH, HEIGHT, COHESION, SPEED, RISE, STRAIN = 1.0, 2.0, 20e3, 0.1, 0.1, 0.05
CLAY = {
    "model": "mohr_coulomb", "density": 1700.0, "bulk_modulus": 10e6, "shear_modulus": 3e6, "friction_angle": 0.0,
    "cohesion": COHESION, "sensitivity": 3.0, "remoulding_shear": 0.1,
}  # fmt: skip
WAYS = {"nothing": {}, "reference_spacing": {"reference_spacing": 0.1}, "length": {"length": 0.4}}
BLOCK = {
    "type": "polygon",
    "vertices": [[0, 0], [WIDTH, 0], [WIDTH, HEIGHT], [0, HEIGHT], [0, 0.9], [0.1, 0.9], [0.1, 0.7], [0, 0.7]],
}


def biaxial(spacing: float, way: dict) -> tuple[np.ndarray, np.ndarray, float, np.ndarray, np.ndarray]:
    """Settlement over height and load over 2 c (m,), width of the band (m), and places and strain of the points."""
    drive = {"y": {"times": [0, RISE], "values": [0, -SPEED]}}
    sim = simulation(
        spacing, BLOCK, material=CLAY | way,
        boundaries={
            "bottom": {"where": {"upper": [None, 0.1]}, "fix": ["y"]},
            "top": {"where": {"lower": [None, HEIGHT - 0.1]}, "velocity": drive},
        },
        stages=[{"name": "press", "type": "dynamics", "duration": STRAIN * HEIGHT / SPEED + 0.5 * RISE,
                 "boundaries": ["bottom", "top"], "damping": {"viscous": 5.0}}],
    )  # fmt: skip
    curve, ways = [], []

    def watch(sim):
        load = next(part.histories(sim)["bottom_force_y"] for part in sim.reactions if hasattr(part, "histories"))
        t = sim.time
        settled = SPEED * (0.5 * t * t / RISE if t < RISE else t - 0.5 * RISE)
        curve.append((settled / HEIGHT, abs(load) / (2.0 * COHESION * WIDTH)))
        ways.append(owned(sim, "position").copy())

    sim.call_every(max(1, round(2.0 / spacing)), watch)
    sim.run()
    settled, load = np.array(curve).T
    place, strain = owned(sim, "position").copy(), owned(sim, "equivalent_shear_strain").copy()
    return settled, load, width_of_band(place, place - ways[int(np.argmax(load))], strain), place, strain


def width_of_band(place, way, strain) -> float:
    """Width (m) of a band at 45 degrees, of places and ways (n, 2) m and the strain (n,) of points."""
    most, middle = strain > np.quantile(strain, 0.95), abs(place[:, 0] - 0.5 * WIDTH) < 0.25 * WIDTH
    turn = 1.0 if np.polyfit(*place[most].T, 1)[0] > 0.0 else -1.0
    across, along = (place @ [-turn, 1.0] / math.sqrt(2.0))[middle], (way @ [1.0, turn] / math.sqrt(2.0))[middle]

    def step(s, mean, half, centre, deviation):
        return mean + half * erf((s - centre) / (math.sqrt(2.0) * deviation))

    rise = 0.5 * np.ptp(along) * np.sign(np.polyfit(across, along, 1)[0])
    start = along.mean(), rise, np.median((place @ [-turn, 1.0])[most]) / math.sqrt(2.0), 0.1
    return 2.0 * math.sqrt(math.pi) * abs(curve_fit(step, across, along, start)[0][3])


def main(words=None):
    """Print the table and draw curves and bands."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--spacings", type=float, nargs="+", default=[0.1, 0.05, 0.025], help="m")
    parser.add_argument("--folder", type=Path, default=FIGURES, help="where the figure goes")
    arguments = parser.parse_args(words)
    spacings = arguments.spacings
    figure, axes = plt.subplots(1, len(WAYS) + len(spacings), figsize=(15, 4.2), constrained_layout=True)
    print("| way | spacing, m | largest load | last load | work | band, m |\n|---|---|---|---|---|---|")
    for way, (name, keys) in zip(axes, WAYS.items(), strict=False):
        for k, spacing in enumerate(spacings):
            settled, load, band, place, strain = biaxial(spacing, keys)
            work = float(np.sum(0.5 * (load[1:] + load[:-1]) * np.diff(settled)))
            last = load[settled > 0.95 * settled[-1]].mean()
            print(f"| {name} | {spacing:g} | {load.max():.3f} | {last:.3f} | {work:.4f} | {band:.3f} |", flush=True)
            way.plot(100.0 * settled, load, lw=0.9, label=f"{spacing:g} m")
            if name == "length":
                picture = axes[len(WAYS) + k]
                picture.scatter(*place.T, c=strain, s=(130.0 * spacing) ** 2, vmin=0.0, vmax=0.3, marker="s", lw=0)
                picture.set(aspect="equal", title=f"{name}: {spacing:g} m", xlim=(-0.1, 1.2), ylim=(0.0, 2.0))
        way.set(xlabel="settlement / height, %", ylabel="load / 2 c", title=name, ylim=(0.0, 1.2))
        way.legend()
    figure.savefig(arguments.folder / "softening_length.png", dpi=100)
