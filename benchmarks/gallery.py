"""The gallery: runs every shipped scene, draws it, and writes docs/gallery.md.

    python -m benchmarks gallery [--only PATTERN] [--folder DIR] [--draw]

Every scene of configs/ is run on one core in a folder of its own below DIR. What is finished is not run again, what was
interrupted or whose scene has changed starts anew. Two pictures of each, made as `periporo plot` makes them, go to
docs/figures/gallery: the end, and a still of the movie when motion is at its height; of wet soil a third, of its water
half way to the motion. Figures of the runs are kept in
runs.csv beside them, so that a scene that is run alone leaves the others' as they are; --draw runs none. The time is
processor time, with kernels compiled before.
"""

import csv
import itertools
import time
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
from PIL import Image

from periporo import Simulation, open_results
from periporo import run as run_scene
from periporo.io.input.yaml_source import read_yaml
from periporo.io.pictures.plots import LEDGER, plot_run

from . import FIGURES, ROOT, option_parser
from .library.runs import is_finished

SCENES = sorted((ROOT / "configs").glob("*.yaml"))
PICTURES, PAGE = FIGURES / "gallery", ROOT / "docs" / "gallery.md"
TABLE = PICTURES / "runs.csv"
LARGE = 250_000  # bytes of a picture
_AT_REST = 1e-3  # of the largest kinetic energy
HEAD = """# Gallery

Every scene that comes with the program: `periporo new` lists them, and with a name writes one to start from. The
pictures are those that `periporo plot` makes: the points of the soil by their shear strain, over the outline that they
had at first. All of this page is made by `python -m benchmarks gallery`; times are of one core, with kernels compiled.
The fastest is a point; the residual is that of the energy, over the largest term of its ledger. Any of them by hand:
`periporo new slope`, `periporo slope.yaml`, `periporo plot slope.vtkhdf --animate`.

"""


def run(scene: Path, folder: Path) -> float | None:
    """Run a scene in its folder; s of processor time, None if it was there already."""
    result, copy = folder / f"{scene.stem}.vtkhdf", folder / scene.name
    if copy.exists() and copy.read_bytes() == scene.read_bytes() and is_finished(result):
        return None
    folder.mkdir(parents=True, exist_ok=True)
    copy.write_bytes(scene.read_bytes())
    Simulation.from_scene(scene).start()  # compiles
    began = time.process_time()
    run_scene(scene, result, overwrite=True)
    return time.process_time() - began


def figures_of(scene: Path, result: Path, seconds: float) -> dict[str, str]:
    """A row of the table."""
    with open_results(result) as r:
        largest = max(np.abs(r.history(name)).max() for name in LEDGER if name in r.history_names)
        left = np.abs(r.history("energy_residual") - r.history("integration_term")).max()
        row = {
            "points": r.point_counts[0], "steps": r.steps[-1], "processor_s": seconds,
            "fastest_m_per_s": r.history("max_speed")[release(r):].max(), "energy_unexplained": left / largest,
            "still_s": r.times[liveliest(r)], "end_s": r.times[-1],
        }  # fmt: skip
    texts = {name: f"{value:.3g}" if isinstance(value, float) else str(value) for name, value in row.items()}
    return {"scene": scene.stem} | texts


def release(results) -> int:
    """Where in the histories the motion begins: the time is zero in the steps of a relaxation."""
    return int(np.flatnonzero(results.history("time") == 0.0)[-1])


def liveliest(results) -> int:
    """The output when the kinetic energy of the motion is largest."""
    first = release(results)
    step = results.history("step")[first + np.argmax(results.history("kinetic_energy")[first:])]
    return int(np.argmin(np.abs(np.asarray(results.steps) - step)))


def half_way(results) -> int:
    """The output half way to the last one before motion; that of its height where it comes at once, or the second."""
    still, kinetic = liveliest(results), results.history("kinetic_energy")
    rows = np.searchsorted(results.history("step"), results.steps[:still])
    slow = np.flatnonzero(kinetic[rows] < _AT_REST * kinetic[release(results) :].max())
    return (int(slow.max(initial=0)) + 1) // 2 or max(still, 1)


def draw(scene: Path, result: Path) -> None:
    """The pictures of a scene; with fewer colours where the file would be large."""
    with open_results(result) as results:
        still, wet = liveliest(results), half_way(results)
    PICTURES.mkdir(parents=True, exist_ok=True)
    shown = [(-1, 0, scene.stem), (still, 0, f"{scene.stem}_still")]
    shown += [(wet, 1, f"{scene.stem}_water")] if is_wet(scene) else []
    for step, number, name in shown:
        picture = plot_run(result, result.parent, step=step)[number]
        image, file = Image.open(picture).convert("RGB"), PICTURES / f"{name}.png"
        image.save(file, optimize=True)
        colours = 256
        while file.stat().st_size > LARGE and colours > 8:
            image.quantize(colours, method=Image.Quantize.MEDIANCUT).save(file, optimize=True)
            colours //= 2


def read_table() -> dict[str, dict]:
    """The rows that are kept, by scene."""
    if not TABLE.exists():
        return {}
    with TABLE.open() as file:
        return {row["scene"]: row for row in csv.DictReader(file)}


def write_table(rows: dict[str, dict]) -> None:
    """Keep the rows."""
    with TABLE.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(next(iter(rows.values()))), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows[name] for name in sorted(rows))


def page(rows: dict[str, dict]) -> str:
    """The text of the page: a table, and then every scene with what its file says of it, its pictures and figures."""
    chosen = [scene for scene in SCENES if scene.stem in rows]
    lines = [*HEAD.splitlines(), "| scene | | points | steps | time on one core |", "|---|---|---|---|---|"]
    for scene in chosen:
        row = rows[scene.stem]
        lines.append(f"| [{scene.stem}](#{scene.stem}) | {title_of(scene)} | {row['points']} | {row['steps']} | "
                     f"{duration(float(row['processor_s']))} |")  # fmt: skip
    for scene in chosen:
        lines += ["", *section(scene, rows[scene.stem])]
    return "\n".join(lines) + "\n"


def section(scene: Path, row: dict) -> list[str]:
    """The lines of a scene."""
    name, file = scene.stem, f"{FIGURES.name}/{PICTURES.name}/{scene.stem}"
    lines = [
        f"## {name}", "", f"**{title_of(scene)}.**", *described(scene), "",
        f"| after {row['still_s']} s; fastest {row['fastest_m_per_s']} m/s | the end, after {row['end_s']} s; "
        f"residual {row['energy_unexplained']} |", "|---|---|",
        f"| ![in motion]({file}_still.png) | ![end]({file}.png) |",
    ]  # fmt: skip
    return [*lines, f"| ![water in the pores]({file}_water.png) | |"] if is_wet(scene) else lines


def is_wet(scene: Path) -> bool:
    """Whether there is water in the pores of its soil."""
    return "pore_water" in read_yaml(scene).data


def title_of(scene: Path) -> str:
    """What the scene calls itself."""
    return read_yaml(scene).data["title"]


def described(scene: Path) -> list[str]:
    """The comment at the head of the scene's file."""
    comment = itertools.takewhile(lambda line: line.startswith("#"), scene.read_text().splitlines())
    return [line.removeprefix("#").strip() for line in comment]


def duration(seconds: float) -> str:
    """Roughly, in words."""
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"


def main(words=None):
    """Run, draw, write."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--only", default="*", metavar="PATTERN", help="only scenes whose name matches")
    parser.add_argument("--folder", type=Path, default=Path("gallery"), help="where the runs are kept")
    parser.add_argument("--draw", action="store_true", help="run nothing")
    arguments = parser.parse_args(words)
    rows = read_table()
    for scene in SCENES:
        if not fnmatch(scene.stem, arguments.only):
            continue
        folder = arguments.folder.resolve() / scene.stem
        result = folder / f"{scene.stem}.vtkhdf"
        seconds = None if arguments.draw else run(scene, folder)
        if seconds is None and scene.stem in rows:
            seconds = float(rows[scene.stem]["processor_s"])
        if seconds is not None and is_finished(result):
            print(f"{scene.stem}: {seconds:.0f} s", flush=True)
            draw(scene, result)
            rows[scene.stem] = figures_of(scene, result, seconds)
            write_table(rows)
    PAGE.write_text(page(rows))
    print(PAGE)
