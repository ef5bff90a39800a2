"""Time of a study of 20 small cases on two cores, over that of the cases one after the other.

    python -m benchmarks study_speed [--duration 0.25]     # on a machine that does nothing else

"Commands" are 20 calls of `periporo run`, which a shell would make; the studies have one and two cores.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml

from . import option_parser

CASES = 20
SCENE = {
    "dimension": 2, "spacing": 5e-3, "gravity": [0, -9.81],
    "materials": {"soil": {"model": "drucker_prager", "density": 1800, "bulk_modulus": 2.5e6, "shear_modulus": 1.5e6,
                           "cohesion": 0, "friction_angle": 30}},
    "bodies": [{"name": "column", "material": "soil", "shape": {"type": "box", "lower": [-0.05, 0],
                                                                "upper": [0.05, 0.1]}}],
    "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.5}],
    "output": {"interval": 0.05},
}  # fmt: skip
ANGLE = "materials.soil.friction_angle"


def timed(*words: str, folder: Path) -> float:
    """Seconds that a command line of periporo takes."""
    start = time.perf_counter()
    command = [sys.executable, "-m", "periporo.core.cli", *words]
    subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def main(words=None):
    """Print the three times, and their ratios to the study on two cores."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--duration", type=float, default=0.25, help="s that each column falls")
    duration = parser.parse_args(words).duration
    scene = SCENE | {"stages": [{"name": "collapse", "type": "dynamics", "duration": duration}]}
    angles = [20.0 + k for k in range(CASES)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "case.yaml").write_text(yaml.safe_dump(scene))
        study = {"scene": "case.yaml", "variants": [{"grid": {ANGLE: angles}}], "results": ["run_out_m", "height_m"]}
        (folder / "study.yaml").write_text(yaml.safe_dump(study))
        run = ("run", "case.yaml", "--quiet", "--no-plot", "--overwrite")
        timed(*run, folder=folder)  # what is not compiled yet is compiled
        times = {
            "study, two cores": timed("study", "study.yaml", "-o", "two", "--cores", "2", folder=folder),
            "study, one core": timed("study", "study.yaml", "-o", "one", "--cores", "1", folder=folder),
            "commands": sum(timed(*run, folder=folder) for _ in range(CASES)),
        }
        if (folder / "one" / "study.csv").read_bytes() != (folder / "two" / "study.csv").read_bytes():
            raise RuntimeError("the studies differ")
    two = times["study, two cores"]
    for what, seconds in times.items():
        print(f"{what:20} {seconds:7.1f} s   two cores take {two / seconds:.2f} of it")
