"""Pictures of the cylinders that the benchmark `axisymmetric_collapse` has run."""

from pathlib import Path

import matplotlib
import numpy as np

from periporo.io.output.results import open_results

from .laws import lube_axisymmetric_height, lube_axisymmetric_run_out

matplotlib.use("Agg")
from matplotlib import pyplot as plt

SECTION = np.radians(15.0)  # the points that are shown lie within this angle of 45 degrees
STAGES = (0.0, 0.35, 1.0)  # of the time until rest


def draw(results: dict[float, Path], radius: float, file: Path) -> None:
    """Sections of the deposits, by height over radius: at the start, on the way and at rest, and their outlines."""
    figure, axes = plt.subplots(
        len(results), len(STAGES), figsize=(13, 2.9 * len(results)), layout="constrained", squeeze=False, sharey="row"
    )
    for row, (aspect, path) in zip(axes, results.items(), strict=True):
        with open_results(path) as r:
            for panel, share in zip(row, STAGES, strict=True):
                k = int(np.argmin(np.abs(r.times - share * r.times[-1])))
                image = _section(panel, r.positions(k) / radius, r.field("equivalent_shear_strain", k))
                panel.set_title(f"a = {aspect:g}, t = {r.times[k]:.3f} s")
            spacing = float(r.configuration["spacing"]) / radius
            _outline(row[-1], r.positions() / radius, r.field("integrity") > 0.0, spacing)
        front, top = 1.0 + float(lube_axisymmetric_run_out(aspect)), float(lube_axisymmetric_height(aspect))
        row[-1].plot([front, 0.0], [0.0, top], "rv", ms=8, clip_on=False, label="Lube et al. 2004: front, height")
        row[-1].legend(loc="upper right")
        for panel in row:
            panel.set(xlim=(0.0, 1.15 * front), ylim=(0.0, 1.05 * aspect), xlabel="r / R", aspect="equal")
        row[0].set_ylabel("z / R")
        figure.colorbar(image, ax=row, label="shear strain", extend="max")
    figure.savefig(file, dpi=110)
    plt.close(figure)


def _section(panel, position, strain):
    near = np.abs(np.arctan2(position[:, 1], position[:, 0]) - 0.25 * np.pi) < SECTION
    distance = np.hypot(position[near, 0], position[near, 1])
    return panel.scatter(distance, position[near, 2], c=strain[near], s=2.0, vmin=0.0, vmax=2.0, cmap="viridis", lw=0)


def _outline(panel, position, bonded, spacing):
    """Height of the highest bonded points in rings: the mean of those of eight sectors that have points."""
    distance, angle = np.hypot(position[:, 0], position[:, 1]), np.arctan2(position[:, 1], position[:, 0])
    ring, sector = (distance / (1.5 * spacing)).astype(int), np.clip((angle / (np.pi / 16)).astype(int), 0, 7)
    tops = np.zeros((ring.max() + 1, 8))
    np.maximum.at(tops, (ring[bonded], sector[bonded]), position[bonded, 2] + 0.5 * spacing)
    mean = tops.sum(axis=1) / np.maximum((tops > 0.0).sum(axis=1), 1)
    panel.plot((np.arange(len(tops)) + 0.5) * 1.5 * spacing, mean, "k-", lw=1.2)
