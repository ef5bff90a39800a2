"""The retrogressive slide of configs/sensitive_clay.yaml at two spacings: slabs that break off, and where the scarp is.

    python -m benchmarks sensitive_clay [--spacings 1.0 1.25] [--runs DIR] [--folder DIR]

The scarp is where points of the surface begin that have moved by less than 1 m. A slab is one of its retreats by 4 m
and more, between two halves of a second in which it stays. The figure shows the retreat, and the strain at the end.
"""

import importlib.resources
from pathlib import Path

import matplotlib
import numpy as np

from periporo import open_results
from periporo.io.input.yaml_source import read_yaml

from .library import runs

matplotlib.use("Agg")
from matplotlib import pyplot as plt

from . import FIGURES, option_parser

HEIGHT, CREST, LEAST = 22.0, 20.0, 4.0


def slide(spacing: float, folder: Path):
    """Times (m,) s and the scarp (m,) m at them; places and plastic shear strain of the points at the end."""
    scene = read_yaml(importlib.resources.files("periporo.configs") / "sensitive_clay.yaml").data
    result = folder / f"{spacing:g}" / "scene.vtkhdf"
    if runs.run(scene | {"spacing": spacing}, result.with_suffix(".yaml"), result):
        raise RuntimeError(f"the run in {result.parent} has failed")
    with open_results(result) as r:
        start, scarp = r.positions(0), []
        surface = start[:, 1] > HEIGHT - spacing
        for step in range(len(r)):
            stays = surface & (np.linalg.norm(r.field("displacement", step=step), axis=1) < 1.0)
            scarp.append(start[stays, 0].min())
        return r.times[:], np.array(scarp), r.positions(-1), r.field("plastic_shear", step=-1)


def slabs(scarp) -> list[float]:
    """By how much (m) the scarp retreats each time."""
    found, begun = [], scarp[0]
    for before, after in zip(scarp, [*scarp[1:], scarp[-1]], strict=True):
        if after <= before and before - begun >= LEAST:
            found.append(float(before - begun))
            begun = before
    return found


def main(words=None):
    """Print the table and draw the figure."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--spacings", type=float, nargs="+", default=[1.0, 1.25], help="m")
    parser.add_argument("--runs", type=Path, default=Path("sensitive_clay"), help="where the runs are kept")
    parser.add_argument("--folder", type=Path, default=FIGURES, help="where the figure goes")
    arguments = parser.parse_args(words)
    figure, axes = plt.subplots(1 + len(arguments.spacings), 1, figsize=(10, 8), constrained_layout=True)
    print("| spacing, m | slabs | widths, m | retreat at the end, m | run-out, m |\n|---|---|---|---|---|")
    for spacing, picture in zip(arguments.spacings, axes[1:], strict=True):
        times, scarp, place, strain = slide(spacing, arguments.runs.resolve())
        widths = slabs(scarp)
        texts = ", ".join(f"{w:.0f}" for w in widths)
        retreat = scarp[-1] - CREST
        print(f"| {spacing:g} | {len(widths)} | {texts} | {retreat:.0f} | {-place[:, 0].min():.0f} |", flush=True)
        axes[0].step(times, scarp - CREST, where="post", label=f"spacing {spacing:g} m")
        picture.scatter(*place[:, :2].T, c=strain, s=4.0 * spacing**2, vmin=0.0, vmax=1.0, marker="s", lw=0)
        picture.set(aspect="equal", title=f"spacing {spacing:g} m: plastic shear strain, 0 to 1", xlim=(-100, 140))
    axes[0].set(xlabel="time, s", ylabel="retreat of the scarp, m")
    axes[0].legend()
    figure.savefig(arguments.folder / "sensitive_clay.png", dpi=100)
