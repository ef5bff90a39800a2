"""Split-Hopkinson-bar tests of Mason sand: the material alone, and a bar of points, against the measurement.

    python -m benchmarks bar_tests     # draws docs/figures/bar_drive.png and docs/figures/bar_impact.png

The two tests go through `periporo drive` with the files of tests/materials/data/shpb; the dry one also as the
scene configs/bar_impact.yaml on two ranks.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from periporo.io.output.results import open_results

from . import FIGURES, ROOT, option_parser

DATA = ROOT / "tests" / "materials" / "data" / "shpb"
SCENE = ROOT / "configs" / "bar_impact.yaml"
COMMAND = (sys.executable, "-m", "periporo.core.cli")
TITLES = {"dry": "dry, porosity 0.36", "wet": "saturation 0.656, porosity 0.426"}
STRUCK, REST, HEIGHT = 0.01, 0.0, 0.001  # m: where the driven and the resting points begin; the bar's section


def driven(name: str, folder: Path) -> dict[str, np.ndarray]:
    """Columns of the table that `periporo drive` writes for the test `name`."""
    words = ["drive", DATA / f"{name}.yaml", DATA / f"{name}.csv", "-o", folder]
    subprocess.run([*COMMAND, *words], check=True, stdout=subprocess.DEVNULL)
    return table(folder / f"{name}.csv")


def table(file: Path) -> dict[str, np.ndarray]:
    """Columns of a CSV file by name; `#` starts a comment line."""
    header, *rows = (line for line in file.read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
    return dict(zip(header.split(","), np.loadtxt(rows, delimiter=",", unpack=True), strict=True))


def measured(name: str) -> dict[str, np.ndarray]:
    """Measured axial and radial stress, Pa, compression positive."""
    return table(DATA / f"{name}_measured.csv")


def struck_bar(folder: Path, ranks: int = 2) -> dict[str, np.ndarray]:
    """Force over section (Pa, compression positive) against time at the struck end and the end at rest."""
    words = [*COMMAND, SCENE, "--quiet", "--no-plot", "--overwrite"]
    mpirun = Path(sys.executable).with_name("mpirun")
    launcher = [mpirun if mpirun.exists() else "mpirun", "-n", str(ranks)]
    subprocess.run([*launcher, *words], check=True, cwd=folder)
    with open_results(folder / f"{SCENE.stem}.vtkhdf") as results:
        x = results.positions(0)[:, 0]
        force = np.array([results.field("internal_force", k)[:, 0] for k in range(len(results))])
        stress = {"struck": force[:, x > STRUCK].sum(axis=1), "rest": -force[:, x < REST].sum(axis=1)}
        return {"time_s": results.times} | {end: total / HEIGHT for end, total in stress.items()}


def draw_tests(columns: dict[str, dict[str, np.ndarray]]) -> Path:
    """Axial and radial stress over axial strain of both tests, model and measurement."""
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    for panel, (name, driven_columns) in zip(axes, columns.items(), strict=True):
        data = measured(name)
        strain = -100 * np.interp(data["time_s"], driven_columns["time_s"], driven_columns["F11"] - 1)
        for color, axis, component in (("C0", "axial", "xx"), ("C3", "radial", "yy")):
            panel.plot(strain, data[f"{axis}_stress_Pa"] / 1e6, color=color, linestyle=":", label=f"{axis}, measured")
            model = -driven_columns[f"stress_{component}"] / 1e6
            panel.plot(-100 * (driven_columns["F11"] - 1), model, color=color, label=f"{axis}, Arena")
        panel.set(title=TITLES[name], xlabel="shortening (%)", ylabel="stress, compression (MPa)")
        panel.legend(frameon=False)
    return _saved(figure, "bar_drive.png")


def draw_bar(bar: dict[str, np.ndarray], point: dict[str, np.ndarray]) -> Path:
    """Axial stress at both ends of the struck bar over time, with the driven point and the measurement."""
    figure, axes = plt.subplots(figsize=(6.5, 4.2), layout="constrained")
    data = measured("dry")
    axes.plot(1e6 * data["time_s"], data["axial_stress_Pa"] / 1e6, "k:", label="measured")
    axes.plot(1e6 * point["time_s"], -point["stress_xx"] / 1e6, color="C0", label="one point")
    for end, color in (("struck", "C3"), ("rest", "C2")):
        label = "bar, struck end" if end == "struck" else "bar, end at rest"
        axes.plot(1e6 * bar["time_s"], bar[end] / 1e6, color=color, linestyle="--", label=label)
    axes.set(xlabel="time (µs)", ylabel="axial stress, compression (MPa)", xlim=(0, 850))
    axes.legend(frameon=False)
    return _saved(figure, "bar_impact.png")


def _saved(figure, name: str) -> Path:
    figure.savefig(FIGURES / name, dpi=130)
    return FIGURES / name


def main(words=None):
    """Print the peaks and draw the figures."""
    option_parser(__name__, __doc__).parse_args(words)
    with tempfile.TemporaryDirectory() as folder:
        columns = {name: driven(name, Path(folder)) for name in TITLES}
        bar = struck_bar(Path(folder))
    for name, title in TITLES.items():
        model, data = -columns[name]["stress_xx"].min(), measured(name)["axial_stress_Pa"].max()
        print(f"{title:34s} peak axial stress {model / 1e6:.1f} MPa, measured {data / 1e6:.1f} MPa")
    print(f"{'bar of points, struck end':34s} peak axial stress {bar['struck'].max() / 1e6:.1f} MPa")
    point = np.interp(bar["time_s"], columns["dry"]["time_s"], -columns["dry"]["stress_xx"])
    gap = np.abs(bar["struck"] - point).max() / point.max()
    print(f"largest difference of its stress history from the driven point: {100 * gap:.2f} % of the peak")
    print(draw_tests(columns))
    print(draw_bar(bar, columns["dry"]))
