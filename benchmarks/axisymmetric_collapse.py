"""Cylinders of sand that collapse, against the measurements of Lube et al. (2004).

    python benchmarks/axisymmetric_collapse.py [--quick] [--folder DIR] [--slope M]

A quarter of a cylinder, as in configs/axisymmetric_collapse.yaml, is run at heights of one and of two radii, with more
than 40 000 points each (hours), or with --quick about a thousand. Run-out is that of 99 % of the points that are
bonded. Runs that are finished are not repeated, interrupted ones go on. --slope is another M. Exit status 1 if a
run-out is more than 25 % from the measured one.
"""

import argparse
import contextlib
import sys
from pathlib import Path

import numpy as np
import yaml
from study.laws import lube_axisymmetric_height, lube_axisymmetric_run_out

from periporo.core.cli import main as periporo
from periporo.io.results import ResultError, open_results
from periporo.io.yaml_source import read_yaml

CONFIG = Path(__file__).resolve().parent.parent / "configs" / "axisymmetric_collapse.yaml"
RADIUS = 0.05  # m
ASPECTS = (1.0, 2.0)  # height over radius
TOLERANCE = 0.25
FULL, QUICK = 42_000, 1_200  # points, about
SCENE, RESULT = "cylinder.yaml", "cylinder.h5"


def scene(aspect: float, points: int, slope: float | None = None) -> dict:
    """The input for a cylinder of height `aspect` radii with about `points` points in its quarter."""
    text = read_yaml(CONFIG).data
    rows = round((4.0 * points / (np.pi * aspect)) ** (1.0 / 3.0))
    text["title"] = f"Cylinder of sand, height = {aspect:g} radii"
    text["spacing"] = RADIUS / rows
    text["bodies"][0]["shape"]["extrude"] = [0.0, aspect * RADIUS]
    text["output"]["file"] = RESULT
    text["checkpoint"] = {"interval": 300.0}
    if slope is not None:
        text["materials"]["sand"]["critical_state_slope"] = slope
    return text


def run(text: dict, folder: Path) -> int:
    """Run a scene in a folder, or the rest of it; the exit status of `periporo`."""
    wanted = yaml.safe_dump(text, sort_keys=False)
    file = folder / SCENE
    same = file.exists() and file.read_text() == wanted
    if same and _is_finished(folder / RESULT):
        return 0
    folder.mkdir(parents=True, exist_ok=True)
    file.write_text(wanted)
    with contextlib.chdir(folder):
        return periporo(["run", SCENE, "--resume" if same else "--overwrite", "--quiet", "--no-plot"])


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
        "height": (position[bonded, 2].max() + half) / RADIUS,
        "time": time,
        "kinetic": kinetic[-1] / kinetic.max(),
        "free-flying": int((~bonded).sum()),
        "steps": steps,
        "seconds": seconds,
    }


def _is_finished(path):
    try:
        with open_results(path) as results:
            return "finished" in results.attributes
    except ResultError:
        return False


def main():
    """Run both cylinders and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="about a thousand points")
    parser.add_argument("--folder", type=Path, default=Path("axisymmetric_collapse"), help="where the runs are kept")
    parser.add_argument("--slope", type=float, help="slope M of the critical state line")
    arguments = parser.parse_args()
    sound = True
    print("| a | points | run-out / R | Lube | height / R | Lube | t, s | K / peak | free-flying | steps | wall, s |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for aspect in ASPECTS:
        text = scene(aspect, QUICK if arguments.quick else FULL, arguments.slope)
        folder = arguments.folder.resolve() / f"a{aspect:g}{'-quick' if arguments.quick else ''}"
        if status := run(text, folder):
            sys.exit(status)
        m, law = measure(folder / RESULT), float(lube_axisymmetric_run_out(aspect))
        print(
            f"| {aspect:g} | {m['points']} | {m['run-out']:.2f} | {law:.2f} | {m['height']:.2f} | "
            f"{float(lube_axisymmetric_height(aspect)):.2f} | {m['time']:.3f} | {m['kinetic']:.1e} | "
            f"{m['free-flying']} | {m['steps']} | {m['seconds']:.0f} |",
            flush=True,
        )
        sound &= abs(m["run-out"] / law - 1.0) <= TOLERANCE
    sys.exit(0 if sound else 1)


if __name__ == "__main__":
    main()
