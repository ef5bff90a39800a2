"""Kills a run again and again and compares what it ends with.

    python -m benchmarks kill [--kills 30] [--ranks 2]

A small column collapses with a checkpoint every twentieth of a second. SIGKILL comes at a random moment of each part,
also while it starts, writes results or a checkpoint; the next part starts with --resume. With several ranks it hits
one of them, or mpirun, and the rest must be gone at once. After every kill the result file must open in h5py and in
VTK; in the end it must equal, bit for bit, that of a run on one rank that was left alone.
"""

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np
import yaml

from . import option_parser

SCENE = {
    "dimension": 2, "spacing": 0.01, "gravity": [0.0, -9.81],
    "materials": {"sand": {"model": "drucker_prager", "density": 1600.0, "bulk_modulus": 2e6, "shear_modulus": 1e6,
                           "friction_angle": 20.0, "cohesion": 0.0}},
    "bodies": [{"name": "column", "material": "sand",
                "shape": {"type": "box", "lower": [-0.1, 0.0], "upper": [0.1, 0.2]}}],
    "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.3}],
    "stages": [{"name": "fall", "type": "dynamics", "duration": 0.35}],
    "output": {"interval": 2e-3},
    "checkpoint": {"interval": 0.05},
}  # fmt: skip
COMMAND = [sys.executable, "-m", "periporo.core.cli", "scene.yaml", "--quiet", "--no-plot"]


PATIENCE = 10.0  # s in which all processes of a job must follow the one that was killed


def command(ranks):
    """The words that start a run."""
    mpirun = Path(sys.executable).with_name("mpirun")
    return COMMAND if ranks == 1 else [str(mpirun), "-n", str(ranks), *COMMAND]


def family(pid):
    """A process and all below it."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except FileNotFoundError:
        children = []
    return [pid, *(p for child in children for p in family(int(child)))]


def kill(part, moments):
    """Kill one process of a job, mpirun or a rank, and wait until all are gone."""
    processes = family(part.pid)
    victim = moments.choice([processes[0], *processes[2:]])  # all but mpirun's helper
    os.kill(victim, signal.SIGKILL)
    part.wait()
    until = time.monotonic() + PATIENCE
    while left := [p for p in processes[1:] if Path(f"/proc/{p}").exists()]:
        if time.monotonic() > until:
            raise SystemExit(f"processes {left} outlive process {victim}, which was killed")
        time.sleep(0.01)
    return "mpirun" if victim == processes[0] and len(processes) > 1 else "a rank"


def datasets(path):
    """All datasets by name."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
    return found


def outputs_in_vtk(path):
    """Number of outputs that VTK reads."""
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetNumberOfSteps()


def found(folder):
    """What a killed part left: steps of the checkpoints, outputs in the result file."""
    steps = [p.name.split("-")[1][:12].lstrip("0") for p in sorted(folder.glob("*.checkpoint-*.h5"))]
    file = folder / "scene.vtkhdf"
    outputs = len(datasets(file)["VTKHDF/Steps/Values"]) if file.exists() and steps else 0
    seen = outputs_in_vtk(file) if outputs else 0
    if seen != outputs:
        raise SystemExit(f"{outputs} outputs in h5py, {seen} in VTK ({folder})")
    return f"checkpoints {steps}, {outputs} outputs in h5py and VTK"


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--latest", type=float, default=2.5, help="s after the start of a part")
    arguments = parser.parse_args(words)
    moments, folder = random.Random(arguments.seed), Path(tempfile.mkdtemp(prefix="kill-"))
    (folder / "scene.yaml").write_text(yaml.safe_dump(SCENE))
    subprocess.run(COMMAND, cwd=folder, check=True)
    expected = datasets(folder / "scene.vtkhdf")
    (folder / "scene.vtkhdf").unlink()
    kills, messages = 0, (folder / "messages.txt").open("a")
    while True:
        part = subprocess.Popen([*command(arguments.ranks), "--resume"], cwd=folder, stderr=messages)
        try:
            left = kills >= arguments.kills
            status = part.wait(timeout=None if left else moments.uniform(0.5, arguments.latest))
        except subprocess.TimeoutExpired:
            hit = kill(part, moments)
            kills += 1
            print(f"kill {kills:2d}, {hit}: {found(folder)}", flush=True)
            continue
        if status != 0:
            raise SystemExit(f"a part failed with status {status} in {folder}")
        break
    ended = datasets(folder / "scene.vtkhdf")
    same = all(np.array_equal(expected[n], ended[n], equal_nan=expected[n].dtype.kind == "f") for n in expected)
    outcome = "the same, bit for bit" if same else "DIFFERENT"
    print(f"{kills} kills, {arguments.ranks} ranks; the results are {outcome} ({folder})")
    raise SystemExit(0 if same and kills > 0 else 1)
