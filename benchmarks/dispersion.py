"""Speed of plane P waves on a grid, over the true one.

    python -m benchmarks dispersion [--folder docs/figures]

A wave u = cos k(x - x_c) in a block much larger than the horizon is given to the program's own kernels; the force on
the point at its middle says omega^2. Writes dispersion.md and dispersion.png.
"""

from pathlib import Path

import numpy as np

from periporo.core.motion.timestep import apply_stiffness

from . import FIGURES, option_parser
from .library.elastic_block import DENSITY, SCHEMES, SPACING, WAVE_SPEED, block

CASES = (("constant", 2.1), ("constant", 3.1), ("conical", 2.0), ("cubic", 2.2), ("cubic", 3.0))
LENGTHS = np.array([3, 4, 5, 6, 8, 10, 14, 20, 40])  # spacings


def phase_speeds(scheme, influence, m, lengths) -> np.ndarray:
    """omega/k over the true speed at wavelengths (n,) in spacings."""
    sim = block((25, 25), scheme, influence, m, 0.0)
    p = sim.particles
    centre = p.owned // 2
    speeds = []
    for length in lengths:
        k = 2 * np.pi / (length * SPACING)
        displacement = np.zeros_like(p.position)
        displacement[:, 0] = np.cos(k * (p.position[:, 0] - p.position[centre, 0]))
        square = apply_stiffness(sim, displacement)[centre, 0] / (DENSITY * SPACING**2)
        speeds.append(np.sqrt(max(square, 0.0)) / (k * WAVE_SPEED))
    return np.array(speeds)


def main(words=None):
    """Table at 20 and 10 spacings, and curves for cubic influence."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    parser = option_parser(__name__, __doc__)
    parser.add_argument("--folder", type=Path, default=FIGURES)
    folder = parser.parse_args(words).folder
    lines = ["| scheme | " + " | ".join(f"{i}, m = {m}" for i, m in CASES) + " |", "|---" * (len(CASES) + 1) + "|"]
    figure, axes = plt.subplots(figsize=(8, 4.2), layout="constrained")
    for scheme in SCHEMES:
        pairs = [phase_speeds(scheme, influence, m, (20, 10)) for influence, m in CASES]
        lines.append(f"| {scheme} | " + " | ".join(f"{a:.3f}, {b:.3f}" for a, b in pairs) + " |")
        axes.semilogx(LENGTHS, phase_speeds(scheme, "cubic", 2.2, LENGTHS), ".-", label=scheme)
    (folder / "dispersion.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))
    axes.set(xlabel="wavelength / Δ", ylabel="speed / c_p", title="cubic, m = 2.2, 2D grid")
    axes.set_xticks(LENGTHS, [str(n) for n in LENGTHS], minor=False)
    axes.axhline(1.0, color="k", lw=0.5)
    axes.legend()
    figure.savefig(folder / "dispersion.png", dpi=130)
