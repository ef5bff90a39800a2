"""`periporo section`: a result in space, cut by an upright plane along a line on the map."""

import argparse
from pathlib import Path

import numpy as np

from periporo.core.numerics.gravity import vertical_axis
from periporo.io.output.results import ResultError, open_results
from periporo.io.pictures.colours import choose_field, colour_limits, colour_values
from periporo.io.pictures.drawing import STYLE, faces_and_lines, point_spacing, require_matplotlib


def cut(faces: list[np.ndarray], start: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Lines (m, 2, 3) m in which the plane through `start` with this `normal`, (3,), cuts faces of (k, 3) corners m."""
    fans = [np.stack([np.broadcast_to(f[0], f[1:-1].shape), f[1:-1], f[2:]], axis=1) for f in faces]
    corners = np.concatenate(fans) if fans else np.empty((0, 3, 3))
    side = (corners - start) @ normal
    places, passed = [], []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        through = (side[:, a] < 0.0) != (side[:, b] < 0.0)
        share = np.where(through, side[:, a] / np.where(through, side[:, a] - side[:, b], 1.0), 0.0)[:, None]
        places.append(corners[:, a] + share * (corners[:, b] - corners[:, a]))
        passed.append(through)
    crossed, ends = np.stack(passed, axis=1), np.stack(places, axis=1)
    met = crossed.any(axis=1)  # then twice
    return ends[met][crossed[met]].reshape(-1, 2, 3)


def plot_section(results, path, start, end, step: int = -1, field: str | None = None) -> int:
    """Picture of the points within half a spacing of the upright plane from `start` to `end`, (2,) m on the map.

    Obstacles are drawn as lines. How many points there are; raises ResultError if there are none, or in two dimensions.
    """
    if results.dimension != 3:
        raise ResultError(f"{results.path} is a result in 2 dimensions: it is a section by itself")
    matplotlib = require_matplotlib()
    from matplotlib.collections import EllipseCollection, LineCollection
    from matplotlib.figure import Figure

    up = vertical_axis(results.configuration.get("gravity"), 3)
    level = [axis for axis in range(3) if axis != up]
    along, first = np.zeros(3), np.zeros(3)
    first[level] = start
    along[level] = np.subtract(end, start)
    length = float(np.linalg.norm(along))
    if not length > 0.0:
        raise ResultError("the section begins and ends at the same place")
    along /= length
    normal = np.cross(along, np.eye(3)[up])
    number, spacing, position = results.output(step), point_spacing(results), results.positions(step)
    way = (position - first) @ along
    near = (np.abs((position - first) @ normal) <= 0.5 * spacing) & (way >= 0.0) & (way <= length)
    if not near.any():
        raise ResultError(f"no point of output {number} lies within half a spacing of the section")
    values, label = colour_values(results, choose_field(results, field), step)
    lines = cut(faces_and_lines(results.obstacles(step))[0], first, normal)
    lines = np.stack([(lines - first) @ along, lines[:, :, up]], axis=2)
    seen = lines[((lines[:, :, 0] >= 0.0) & (lines[:, :, 0] <= length)).any(axis=1), :, 1]
    height = np.concatenate([position[near, up], seen.ravel()])
    with matplotlib.rc_context(STYLE):
        tall = np.ptp(height) + 4.0 * spacing
        figure = Figure(figsize=(9.0, min(max(8.2 * tall / length, 1.2), 8.0) + 2.4), layout="constrained")
        axes = figure.subplots()
        points = EllipseCollection(
            [spacing], [spacing], [0.0], units="xy", offsets=np.column_stack([way[near], position[near, up]]),
            offset_transform=axes.transData, linewidths=0.2, edgecolors=(0, 0, 0, 0.35),
        )  # fmt: skip
        points.set_array(np.ma.masked_invalid(values[near]))
        points.set_clim(*colour_limits(values[near]))
        axes.add_collection(points)
        axes.add_collection(LineCollection(list(lines), colors="0.3", linewidths=1.4))
        axes.set(xlim=(0.0, length), ylim=(height.min() - 2.0 * spacing, height.max() + 2.0 * spacing), aspect="equal",
                 xlabel="along the section [m]", ylabel=f"{'xyz'[up]} [m]")  # fmt: skip
        axes.set_title(f"t = {results.times[number]:.4g} s", loc="left", color="0.2")
        figure.colorbar(points, ax=axes, orientation="horizontal", label=label, shrink=0.7, aspect=40)
        figure.savefig(path, bbox_inches="tight")
    return int(near.sum())


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `periporo section`."""
    parser.add_argument("path", type=Path, help="result file in 3 dimensions")
    for name, meaning in (("from", "begins"), ("to", "ends")):
        parser.add_argument(
            f"--{name}", dest=f"{name}_", type=float, nargs=2, required=True, metavar="M",
            help=f"place on the map at which it {meaning}",
        )  # fmt: skip
    parser.add_argument("--field", help="field to colour by: name, name.component or displacement")
    parser.add_argument("--step", type=int, default=-1, help="output to draw, -1 is the last (default)")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="default: run_section.png beside it")


def run(arguments: argparse.Namespace) -> int:
    """Run `periporo section`; the exit status."""
    file = arguments.output or arguments.path.with_name(f"{arguments.path.stem}_section.png")
    file.parent.mkdir(parents=True, exist_ok=True)
    with open_results(arguments.path) as results:
        count = plot_section(results, file, arguments.from_, arguments.to_, arguments.step, arguments.field)
    print(f"{file}: {count:,} points")
    return 0
