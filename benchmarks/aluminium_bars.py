"""A pile of aluminium bars that collapses beside a wall, against what Bui et al. (2008) measured.

    python -m benchmarks aluminium_bars                        # 3200 points and half the spacing; about half an hour
    python -m benchmarks aluminium_bars --spacings 2.5e-3 --figure docs/figures/aluminium_bars.png

Runs configs/aluminium_bars.yaml. A row of the table is a spacing: root mean square distance of the final surface from
the measured one, the front over the measured one, root mean square distance of the failure line, which parts points
that have moved by more than a bar's diameter from the rest, and the run's steps.
"""

from pathlib import Path

import numpy as np

from periporo import Simulation
from periporo.io.input.yaml_source import read_yaml

from . import ROOT, option_parser
from .library.deposits import connected, profile

SCENE = ROOT / "configs" / "aluminium_bars.yaml"
BAR = 1.6e-3  # m, the mean diameter
SURFACE = 1e-3 * np.array([
    (0, 99.2), (20, 99.3), (40, 95.9), (60, 89.0), (80, 84.4), (100, 77.6), (120, 72.2), (140, 66.5), (160, 61.6),
    (180, 53.9), (200, 47.4), (220, 42.5), (241, 34.8), (262, 30.7), (282, 26.5), (302, 21.5), (322, 18.9),
    (342, 13.6), (362, 10.9), (382, 7.9), (402, 3.7), (422, 2.2), (442, 1.5),
])  # fmt: skip
"""The measured surface at rest, x and y in m."""
FAILURE_LINE = 1e-3 * np.array([
    (21, 98.9), (40, 90.1), (60, 80.2), (80, 65.2), (100, 54.5), (120, 36.8), (139, 25.7), (160, 10.4), (179, 0.5),
])  # fmt: skip
"""The measured lower edge of what moved, x and y in m."""


def collapse(spacing: float, **keys) -> tuple[Simulation, np.ndarray]:
    """The pile at rest, and the displacements (n, 2) m of its points; settling takes up tenths of a millimetre.

    `keys` take the place of others in the input.
    """
    sim = Simulation.from_scene(read_yaml(SCENE).data | {"spacing": spacing} | keys)
    start = sim.particles.position[: sim.particles.owned].copy()
    sim.run()
    return sim, sim.particles.position[: sim.particles.owned] - start


def outline(position: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Places x (m) and heights (m) of what points (n, 2) m beside the wall cover, which is a mirror."""
    x, height = profile(np.vstack([position, position * [-1, 1]]), spacing)
    return x[x >= 0.0], height[x >= 0.0]


def compare(position: np.ndarray, moved: np.ndarray, spacing: float) -> dict[str, float]:
    """Figures of a pile at rest: points (n, 2) m and their displacements (n, 2) m; and lines of the surface."""
    own = connected(position, spacing)
    x, height = outline(position[own], spacing)
    surface = np.interp(SURFACE[:, 0], x, height, right=0.0)
    unmoved = np.linalg.norm(moved, axis=1) < BAR
    place = position - moved
    resting_x, resting = outline(place[unmoved], spacing)
    line = np.interp(FAILURE_LINE[:, 0], resting_x, resting, right=0.0)
    return {
        "surface": np.sqrt(np.mean((surface - SURFACE[:, 1]) ** 2)),
        "front": (np.quantile(position[own, 0], 0.998) + 0.5 * spacing) / SURFACE[-1, 0],
        "failure line": np.sqrt(np.mean((line - FAILURE_LINE[:, 1]) ** 2)),
    }


def draw(path: Path, piles) -> None:
    """Surfaces and failure lines of `piles`, (spacing, position, displacement) each, over the measured ones."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 2.8), layout="constrained")
    axes = figure.add_subplot(aspect="equal", xlabel="x, m", ylabel="y, m")
    for spacing, position, moved in piles:
        x, height = outline(position[connected(position, spacing)], spacing)
        (line,) = axes.plot(x, height, label=f"surface, spacing {1e3 * spacing:g} mm")
        unmoved = np.linalg.norm(moved, axis=1) < BAR
        axes.plot(*outline((position - moved)[unmoved], spacing), "--", color=line.get_color(), label="failure line")
    axes.plot(*SURFACE.T, "ko", ms=4, label="surface, measured")
    axes.plot(*FAILURE_LINE.T, "k^", ms=4, label="failure line, measured")
    axes.set(xlim=(0, 0.5), ylim=(0, 0.11))
    axes.legend(fontsize="small", ncols=2)
    figure.savefig(path, dpi=150)


def main(words=None) -> None:
    """Print the table, and draw."""
    options = option_parser(__name__, __doc__)
    options.add_argument("--spacings", type=float, nargs="+", default=[2.5e-3, 1.25e-3], help="m")
    options.add_argument("--figure", type=Path)
    chosen = options.parse_args(words)
    print("| spacing, mm | surface, mm | front | failure line, mm | steps |\n|---|---|---|---|---|", flush=True)
    piles = []
    for spacing in chosen.spacings:
        sim, moved = collapse(spacing)
        position = sim.particles.position[: sim.particles.owned].copy()
        f = compare(position, moved, spacing)
        print(
            f"| {1e3 * spacing:g} | {1e3 * f['surface']:.1f} | {f['front']:.3f} | {1e3 * f['failure line']:.1f} | "
            f"{sim.step_number} |",
            flush=True,
        )
        piles.append((spacing, position, moved))
    if chosen.figure:
        draw(chosen.figure, piles)
