"""Draws the limit loads of V20 and V21 for docs/explanation/verification.md.

    python -m benchmarks limit_loads [--quick]

Load against settlement of the strip footing, with the refinements of the table; and how the crest of the vertical cut
and the surface of the infinite slope move on either side of their limits, in both cases until they stand or go on.
"""

from pathlib import Path

import matplotlib
import numpy as np

from .library.verification_cases import footing, slopes
from .library.verification_cases.common import GRAVITY, Recorder, owned

matplotlib.use("Agg")
from matplotlib import pyplot as plt

from . import FIGURES, option_parser

SCHEME = "bond_projected"


def draw_footing(axes, numbers):
    """Load-settlement curves of the rough footing for each number of points under it."""
    for points in numbers:
        axes.plot(*_percent(footing.load_curve(points, footing.flowing(SCHEME))), label=f"{points} points")
    locked = numbers[-1] // 2
    axes.plot(*_percent(footing.load_curve(locked, SCHEME)), "--", label=f"{locked}, dilatation: bond")
    axes.axhline(footing.EXACT, color="black", lw=0.8, label="2 + π")
    axes.set(xlabel="settlement / width, %", ylabel="load / (c width)", title="strip footing", ylim=(0.0, None))
    axes.legend()


def draw_motion(axes, cases, what):
    """Speed of the fastest point over g/rate against time, for (label, (simulation, rate)) pairs."""
    for label, (sim, rate) in cases:
        record = Recorder(lambda s: np.sqrt((owned(s, "velocity") ** 2).sum(axis=1).max()), 10)
        sim.observers.append(record)
        sim.start()
        sim.run()
        time, speed = record.columns()
        axes.semilogy(time, speed * rate / GRAVITY, label=label)
    axes.set(xlabel="time, s", ylabel="fastest point / (g/rate)", title=what)
    axes.legend()


def _percent(curve):
    settled, load = curve
    return 100.0 * settled, load


def main(words=None):
    """Draw both figures."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--quick", action="store_true", help="few points")
    parser.add_argument("--folder", type=Path, default=FIGURES, help="where the figures go")
    arguments = parser.parse_args(words)
    figure, axes = plt.subplots(1, 3, figsize=(14, 4.2), constrained_layout=True)
    draw_footing(axes[0], (8, 16) if arguments.quick else (12, 24, 48))
    rows, scheme = 10 if arguments.quick else 20, footing.flowing(SCHEME)
    cuts = [(f"γH/c = {n:g}", slopes.cut(n, rows, scheme)) for n in (3.5, 3.7, 3.8, 3.9, 4.1, 4.4)]
    draw_motion(axes[1], cuts, "vertical cut")
    layers = [
        (f"{angle:g}°, ψ = {psi:g}°", slopes.infinite_slope(angle, psi, 12, scheme))
        for psi, angles in ((30.0, (29.0, 31.0)), (0.0, (26.0, 27.5)))
        for angle in angles
    ]
    draw_motion(axes[2], layers, "infinite slope, φ = 30°")
    arguments.folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(arguments.folder / "limit_loads.png", dpi=110)
