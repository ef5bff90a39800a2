"""The gallery's column from lattice to rest, by two versions, or with and without a key, in turns.

    python -m benchmarks whole_runs bba6980                       # the files as they are, against a commit
    python -m benchmarks whole_runs bba6980 main --turns 1        # one commit against another: 3 minutes on a free core
    python -m benchmarks whole_runs checkout --with '{"time_step": {"added_inertia": 2}}'      # what a key does

Each row is a run: processor time of the fall on one core, steps, time at rest, and the 99th percentiles of distance and
height. A seed, one for each turn, shakes the lattice by 1e-9 m: what it changes is the scatter of a flow. Below stand
the ratios B/A of the turns' medians. `--with` adds keys to the scene of B alone.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from . import option_parser
from .library.versions import CHECKOUT, VersionError, lay_out, name_of
from .sleep import column

_SHORT = 1e-4  # s, of the run that compiles
_COLUMNS = ("seconds", "steps", "end", "run_out", "height")
_RUN = """
import json, sys, time
import numpy as np
from periporo import Simulation
scene, seed = json.loads(sys.argv[1]), int(sys.argv[2])
sim = Simulation.from_scene(scene)
n, began = sim.particles.owned, []
sim.particles.position[:n] += 1e-9 * np.random.default_rng(seed).uniform(-1, 1, (n, 2))
def watch(sim):
    if sim.stage_number == 1 and not began:
        began.extend((time.process_time(), sim.step_number))
sim.call_every(1, watch)
sim.run()
x = np.abs(sim.particles.position[:n])
print(json.dumps([time.process_time() - began[0], sim.step_number - began[1], sim.time,
                  *(float(np.quantile(x[:, a], 0.99)) for a in (0, 1))]))
"""


def fall(folder: Path, scene: dict, seed: int) -> list[float]:
    """Seconds, steps, end, run-out and height of a run of the version in `folder`. Raises VersionError."""
    environment = os.environ | {"PYTHONPATH": str(folder), "PERIPORO_CACHE": str(folder / "cache")}
    done = subprocess.run([sys.executable, "-P", "-c", _RUN, json.dumps(scene), str(seed)], env=environment,
                          stdout=subprocess.PIPE, text=True)  # fmt: skip
    if done.returncode:
        raise VersionError(f"{folder.name}: the run failed; what it said is above")
    return json.loads(done.stdout.splitlines()[-1])


def main(words=None) -> int:
    """Print the table; 2 if a version cannot be run."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("before", metavar="A", help="a commit")
    parser.add_argument("after", nargs="?", metavar="B", default=CHECKOUT, help="another (default: the files)")
    parser.add_argument("--with", dest="keys", type=json.loads, default={}, help="keys of B's scene, JSON")
    parser.add_argument("--spacing", type=float, default=2.5e-3, help="m")
    parser.add_argument("--turns", type=int, default=2)
    arguments = parser.parse_args(words)
    scene = column(arguments.spacing)
    scenes = scene, scene | arguments.keys
    try:
        with tempfile.TemporaryDirectory() as place:
            found = compare(Path(place), (arguments.before, arguments.after), scenes, arguments.turns)
    except VersionError as problem:
        print(problem, file=sys.stderr)
        return 2
    middle = np.median(found, axis=0)
    print("\nB/A: " + ", ".join(f"{name} {b / a:.3f}" for name, a, b in zip(_COLUMNS, *middle, strict=True)))
    return 0


def compare(place: Path, versions, scenes, turns: int) -> np.ndarray:
    """What `fall` tells, by turn and version."""
    names = [name_of(version) for version in versions]
    folders = [lay_out(version, place / label) for label, version in zip("AB", versions, strict=True)]
    for folder, scene in zip(folders, scenes, strict=True):  # compiles
        fall(folder, scene | {"stages": [scene["stages"][0], scene["stages"][1] | {"duration": _SHORT}]}, 0)
    print("| version | seed | time, s | steps | end, s | run-out, m | height, m |\n" + "|---" * 7 + "|", flush=True)
    found = np.empty((turns, 2, len(_COLUMNS)))
    for turn in range(turns):
        for k in (0, 1) if turn % 2 == 0 else (1, 0):
            found[turn, k] = seconds, steps, end, out, height = fall(folders[k], scenes[k], turn)
            print(f"| {'AB'[k]}: {names[k]} | {turn} | {seconds:.1f} | {steps:.0f} | {end:.3f} | {out:.4f} "
                  f"| {height:.4f} |", flush=True)  # fmt: skip
    return found
