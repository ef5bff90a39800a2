"""Cylinders of sand that collapse, as rings and in three dimensions, against the measurements of Lube et al. (2004).

    python -m benchmarks axisymmetric_collapse [--rings] [--points 42000] [--aspects 1 2] [--stiffer 1] [--slope M]
        [--folder DIR] [--figure FILE]

A quarter of a cylinder, the soil that of configs/axisymmetric_collapse.yaml, is run between two planes of symmetry, at
heights of one and of two radii, with more than 40 000 points each (about an hour each), or with about as many as are
given. With --rings it is that scene itself, with rings as large as those points: a minute. Run-out is that of 99 % of
the soil that is bonded; "outermost" is that of the last point. "95 %" is the run-out of so much of all soil, and "cone"
the height to which the cone of the inner soil reaches, which do not hang on single grains: by them rings and points are
compared. Runs that are finished are not repeated,
interrupted ones go on; --walltime stops one in time, to be called again. --stiffer multiplies the moduli, --slope is
another M, --figure draws the deposits. Exit status 1 if a run-out is more than 25 % from the measured one, 3 if a run
has not come to its end.
"""

import sys
from pathlib import Path

import numpy as np

from periporo.io.input.yaml_source import read_yaml
from periporo.io.output.results import open_results

from . import ROOT, option_parser
from .library import runs
from .library.study.cylinders import draw
from .library.study.laws import lube_axisymmetric_height, lube_axisymmetric_run_out

CONFIG = ROOT / "configs" / "axisymmetric_collapse.yaml"
RADIUS = 0.05  # m
ASPECTS = (1.0, 2.0)  # height over radius
TOLERANCE = 0.25
UNFINISHED = 3  # exit status
POINTS = 42_000  # about
COLUMNS = ("a", "points", "run-out / R", "outermost", "Lube", "95 %", "height / R", "Lube", "cone", "t, s", "K / peak",
           "free-flying", "steps", "wall, s")  # fmt: skip
INNER = 0.3  # radii: of the soil within this and twice this the height of the cone is found
SCENE, RESULT = "cylinder.yaml", "cylinder.vtkhdf"


def scene(aspect: float, points: int, stiffer: float = 1.0, slope: float | None = None, rings: bool = False) -> dict:
    """The input for a cylinder of height `aspect` radii with about `points` points in its quarter, or such `rings`."""
    text = read_yaml(CONFIG).data
    rows = round((4.0 * points / (np.pi * aspect)) ** (1.0 / 3.0))
    text["title"] = f"Cylinder of sand, height = {aspect:g} radii"
    text["spacing"] = RADIUS / rows
    if rings:
        text["bodies"][0]["shape"]["upper"] = [RADIUS, aspect * RADIUS]
    else:
        text |= _quarter(aspect * RADIUS, text["bodies"][0], text["contacts"][-1])
    text["output"]["file"] = RESULT
    text["checkpoint"] = {"interval": 300.0}
    sand = text["materials"]["sand"]
    for modulus in ("bulk_modulus", "shear_modulus"):
        sand[modulus] *= stiffer
    if slope is not None:
        sand["critical_state_slope"] = slope
    return text


def _quarter(height: float, body: dict, floor: dict) -> dict:
    """What is other in three dimensions."""
    angle = np.linspace(0.0, 0.5 * np.pi, 19)
    arc = (RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)).tolist()
    shape = {"type": "polygon", "extrude": [0.0, height], "vertices": [[0.0, 0.0], *arc]}
    return {
        "dimension": 3, "axisymmetric": False, "gravity": [0.0, 0.0, -9.81], "bodies": [body | {"shape": shape}],
        "contacts": [floor | {"point": [0, 0, 0], "normal": [0, 0, 1]}], "symmetry": {"lower": [0.0, 0.0, None]},
    }  # fmt: skip


def run(text: dict, folder: Path, walltime: float | None = None) -> int:
    """Run a scene in a folder, or the rest of it; the exit status of `periporo`."""
    limit = [] if walltime is None else ["--walltime", str(walltime)]
    return runs.run(text, folder / SCENE, folder / RESULT, *limit)


def measure(path: Path) -> dict[str, float]:
    """Run-out and height over the radius, and how the run ended."""
    with open_results(path) as r:
        position, bonded = r.positions(), r.field("integrity") > 0.0
        half, points = 0.5 * float(r.configuration["spacing"]), len(position)
        rings = r.configuration["axisymmetric"]
        start = position[:, 0] - r.field("displacement")[:, 0]
        aspect = (r.positions(0)[:, 1 if rings else 2].max() + half) / RADIUS
        kinetic, time, seconds = r.history("kinetic_energy"), r.times[-1], r.attributes["wall_time_s"]
        steps = int(r.history("step")[-1])
    distance, height = (position[:, 0], 1) if rings else (np.hypot(*position[:, :2].T), 2)
    weight = start if rings else np.ones(points)
    return {
        "points": points,
        "run-out": (_within(distance[bonded], weight[bonded], 0.99) + half) / RADIUS - 1.0,
        "outermost": (distance[bonded].max() + half) / RADIUS - 1.0,
        "run-out of 95 %": _within(distance, weight, 0.95) / RADIUS - 1.0,
        "height": (position[bonded, height].max() + half) / RADIUS,
        "cone": _cone(distance / RADIUS, weight * aspect / weight.sum()),
        "time": time,
        "kinetic": kinetic[-1] / kinetic.max(),
        "free-flying": int((~bonded).sum()),
        "steps": steps,
        "seconds": seconds,
    }


def _within(distance, weight, share):
    """Distance within which this share of the soil lies."""
    order = np.argsort(distance)
    sums = np.cumsum(weight[order])
    return distance[order][np.searchsorted(sums, share * sums[-1])]


def _cone(distance, volume):
    """Height of the cone to which the inner soil is heaped up, over R; from `volume`s over pi R^3.

    With weights 1 - (r/a)^2 the mean height of a cone is that of its tip less 8/15 a times its slope.
    """
    means = [2.0 / a**2 * (volume * np.maximum(1.0 - (distance / a) ** 2, 0.0)).sum() for a in (INNER, 2.0 * INNER)]
    return 2.0 * means[0] - means[1]


def line(aspect: float, m: dict[str, float]) -> str:
    """Row of the table for what `measure` returns."""
    run_out, height = float(lube_axisymmetric_run_out(aspect)), float(lube_axisymmetric_height(aspect))
    across, up = (m["run-out"], m["outermost"], run_out, m["run-out of 95 %"]), (m["height"], height, m["cone"])
    lengths = [f"{x:.2f}" for x in (*across, *up)]
    end = [f"{m['time']:.3f}", f"{m['kinetic']:.1e}", f"{m['free-flying']}", f"{m['steps']}", f"{m['seconds']:.0f}"]
    return "| " + " | ".join([f"{aspect:g}", f"{m['points']}", *lengths, *end]) + " |"


def main(words=None):
    """Run both cylinders and compare."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--rings", action="store_true", help="of the scene, in place of points of a quarter")
    parser.add_argument("--points", type=int, default=POINTS, help="points of a quarter, about")
    parser.add_argument("--aspects", type=float, nargs="+", default=ASPECTS, help="heights over the radius")
    parser.add_argument("--folder", type=Path, default=Path("axisymmetric_collapse"), help="where the runs are kept")
    parser.add_argument("--walltime", type=float, help="s after which a run is stopped")
    parser.add_argument("--stiffer", type=float, default=1.0, help="factor of the moduli")
    parser.add_argument("--slope", type=float, help="slope M of the critical state line")
    parser.add_argument("--figure", type=Path, help="file of the picture")
    arguments = parser.parse_args(words)
    if arguments.rings and arguments.figure:
        parser.error("--figure draws sections of quarters; leave out --rings")
    sound, results = True, {}
    print("| " + " | ".join(COLUMNS) + " |\n" + "|---" * len(COLUMNS) + "|")
    for aspect in arguments.aspects:
        text = scene(aspect, arguments.points, arguments.stiffer, arguments.slope, arguments.rings)
        folder = arguments.folder.resolve() / ("rings" if arguments.rings else "quarter") / f"a{aspect:g}"
        if status := run(text, folder, arguments.walltime):
            sys.exit(status)
        if not runs.is_finished(folder / RESULT):
            sys.exit(UNFINISHED)
        results[aspect] = folder / RESULT
        m = measure(results[aspect])
        print(line(aspect, m), flush=True)
        sound &= abs(m["run-out"] / float(lube_axisymmetric_run_out(aspect)) - 1.0) <= TOLERANCE
    if arguments.figure:
        draw(results, RADIUS, arguments.figure)
    sys.exit(0 if sound else 1)
