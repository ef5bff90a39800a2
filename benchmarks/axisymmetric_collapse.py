"""Cylinders of sand that collapse, against the measurements of Lube et al. (2004).

    python -m benchmarks axisymmetric_collapse [--points 42000] [--aspects 1 2] [--stiffer 1] [--slope M] [--folder DIR]
        [--figure FILE]

A quarter of a cylinder, as in configs/axisymmetric_collapse.yaml, is run at heights of one and of two radii, with more
than 40 000 points each (about an hour each), or with about as many as are given. Run-out is that of 99 % of the points
that are bonded; "outermost" is that of the last of them. Runs that are finished are not repeated, interrupted ones go
on; --walltime stops one in time, to be called again. --stiffer multiplies the moduli, --slope is another M, --figure
draws the deposits. Exit status 1 if a run-out is more than 25 % from the measured one, 3 if a run has not come to its
end.
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
COLUMNS = ("a", "points", "run-out / R", "outermost", "Lube", "height / R", "Lube", "t, s", "K / peak", "free-flying",
           "steps", "wall, s")  # fmt: skip
SCENE, RESULT = "cylinder.yaml", "cylinder.vtkhdf"


def scene(aspect: float, points: int, stiffer: float = 1.0, slope: float | None = None) -> dict:
    """The input for a cylinder of height `aspect` radii with about `points` points in its quarter."""
    text = read_yaml(CONFIG).data
    rows = round((4.0 * points / (np.pi * aspect)) ** (1.0 / 3.0))
    text["title"] = f"Cylinder of sand, height = {aspect:g} radii"
    text["spacing"] = RADIUS / rows
    text["bodies"][0]["shape"]["extrude"] = [0.0, aspect * RADIUS]
    text["output"]["file"] = RESULT
    text["checkpoint"] = {"interval": 300.0}
    sand = text["materials"]["sand"]
    for modulus in ("bulk_modulus", "shear_modulus"):
        sand[modulus] *= stiffer
    if slope is not None:
        sand["critical_state_slope"] = slope
    return text


def run(text: dict, folder: Path, walltime: float | None = None) -> int:
    """Run a scene in a folder, or the rest of it; the exit status of `periporo`."""
    limit = [] if walltime is None else ["--walltime", str(walltime)]
    return runs.run(text, folder / SCENE, folder / RESULT, *limit)


def measure(path: Path) -> dict[str, float]:
    """Run-out and height over the radius, and how the run ended."""
    with open_results(path) as r:
        position, bonded = r.positions(), r.field("integrity") > 0.0
        half, points = 0.5 * float(r.configuration["spacing"]), len(position)
        kinetic, time, seconds = r.history("kinetic_energy"), r.times[-1], r.attributes["wall_time_s"]
        steps = int(r.history("step")[-1])
    distance = np.hypot(*position[bonded, :2].T)
    return {
        "points": points,
        "run-out": (np.quantile(distance, 0.99, method="inverted_cdf") + half) / RADIUS - 1.0,
        "outermost": (distance.max() + half) / RADIUS - 1.0,
        "height": (position[bonded, 2].max() + half) / RADIUS,
        "time": time,
        "kinetic": kinetic[-1] / kinetic.max(),
        "free-flying": int((~bonded).sum()),
        "steps": steps,
        "seconds": seconds,
    }


def line(aspect: float, m: dict[str, float]) -> str:
    """Row of the table for what `measure` returns."""
    run_out, height = float(lube_axisymmetric_run_out(aspect)), float(lube_axisymmetric_height(aspect))
    lengths = [f"{x:.2f}" for x in (m["run-out"], m["outermost"], run_out, m["height"], height)]
    end = [f"{m['time']:.3f}", f"{m['kinetic']:.1e}", f"{m['free-flying']}", f"{m['steps']}", f"{m['seconds']:.0f}"]
    return "| " + " | ".join([f"{aspect:g}", f"{m['points']}", *lengths, *end]) + " |"


def main(words=None):
    """Run both cylinders and compare."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--points", type=int, default=POINTS, help="points of a quarter, about")
    parser.add_argument("--aspects", type=float, nargs="+", default=ASPECTS, help="heights over the radius")
    parser.add_argument("--folder", type=Path, default=Path("axisymmetric_collapse"), help="where the runs are kept")
    parser.add_argument("--walltime", type=float, help="s after which a run is stopped")
    parser.add_argument("--stiffer", type=float, default=1.0, help="factor of the moduli")
    parser.add_argument("--slope", type=float, help="slope M of the critical state line")
    parser.add_argument("--figure", type=Path, help="file of the picture")
    arguments = parser.parse_args(words)
    sound, results = True, {}
    print("| " + " | ".join(COLUMNS) + " |\n" + "|---" * len(COLUMNS) + "|")
    for aspect in arguments.aspects:
        text = scene(aspect, arguments.points, arguments.stiffer, arguments.slope)
        folder = arguments.folder.resolve() / f"a{aspect:g}"
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
