"""Small scenes drawn at random: no energy from nothing, momentum kept, no wall passed, nothing that hangs.

    python -m benchmarks random_scenes [--scenes 300] [--first 0] [--folder DIR] [--again]

Two to five bodies of all laws (the example plugin, too) and shapes in any scheme meet each other and obstacles of all
kinds that move, come and go with the stages, under gravity, loads and damping; `library.random_scene` draws them. Of
each, `periporo check` and a run as from the command line must end, or answer SIGTERM, within --patience seconds. A run
that ends well must not have

- gained energy: what the internal forces (with what lifts cells that forget how they were squeezed), contacts, friction
  or damping gave beyond what they had taken is at most 1 % of the energy at hand: that of the motion at the start, and
  all that gravity, loads and moving obstacles have put in so far. Velocity Verlet adds m dt^2 (a_1^2 - a_0^2)/8 in a
  step, which is the change of m (a dt)^2/8 while steps are alike: that much is borrowed, and given back when the forces
  end. What is left of the integrator's term without it comes from steps that change, and is judged like the rest;
- changed its momentum, beyond rounding, where nothing acts from outside;
- points of a body half a spacing deep in an obstacle, or inside another body that it is in contact with.

A scene that is refused, or stopped with a message and status 3, is told, but is no violation: what stops is listed by
its reason. Exit status 1 if a scene violates this. The table is docs/figures/random_scenes.csv; what is in it is not
run again.
"""

import contextlib
import io
import json
import os
import selectors
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from pathlib import Path

import numpy as np
import yaml
from mpi4py import MPI

from periporo.contact.rigid import RigidContact
from periporo.core.motion.relaxation import RelaxationError
from periporo.core.run import run as run_scene
from periporo.core.scene.check import check_scene
from periporo.core.watch.watchdog import WatchdogError, borrowed
from periporo.errors import ContactError, InputError

from . import FIGURES, ROOT, option_parser
from .library.random_scene import SPACING, draw
from .library.rows import read_rows, write_rows

TABLE = FIGURES / "random_scenes.csv"
PLUGIN = ROOT / "tests" / "plugins" / "periporo_mohr_coulomb"
GAIN = 0.01  # of the energy at hand
ROUNDING = 1e-11  # of momentum, over the sum of m |v|
DEEP = 0.5  # spacings
LOOK = 5  # steps between looks
GRACE = 10.0  # s in which a signal must be answered
COLUMNS = ("number", "verdict", "check", "gain", "where", "momentum", "depth", "steps", "seconds", "message")


class Watch:
    """Looks at a simulation every few steps; what it saw after a step that was taken back is dropped."""

    def __init__(self):
        self.sim = None
        self.seen = []  # (step, energies, momentum, sum of m |v|, J of m (a dt)^2/8)

    def __call__(self, sim):
        self.sim = sim
        while self.seen and self.seen[-1][0] >= sim.step_number:
            self.seen.pop()
        p, n = sim.particles, sim.particles.owned
        momentum = (p.mass[:, None] * p.velocity[:n]).sum(axis=0)
        size = float((p.mass * np.sqrt((p.velocity[:n] ** 2).sum(axis=1))).sum())
        self.seen.append((sim.step_number, sim.ledger.entries(), momentum, size, borrowed(sim)))

    def gain(self):
        """Largest energy from nothing over the energy at hand, and the channel that gave it."""
        start = self.sim.ledger.initial_kinetic
        table = {name: np.array([e[name] for _, e, *_ in self.seen]) for name in self.seen[0][1]}
        inputs = [table[name] for name in ("external_work", "prescribed_work", "obstacle_work") if name in table]
        hand = start + sum(np.cumsum(np.maximum(np.diff(i, prepend=0.0), 0.0)) for i in inputs)
        hand = np.maximum(hand, max(1e-3 * hand[-1], 1e-12))
        given = {
            "internal": -table["internal_energy"],
            "contact": -table["contact_energy"], "friction": -table["friction_dissipation"],
            "damping": -table["damping_dissipation"],
            "integration": table["energy_residual"] - np.array([lent for *_, lent in self.seen]),
        }  # fmt: skip
        shares = {name: float((value / hand).max()) for name, value in given.items()}
        where = max(shares, key=shares.get)
        return shares[where], where

    def momentum(self):
        """Largest change of momentum over the sum of m |v|."""
        sums = np.array([m for _, _, m, *_ in self.seen])
        largest = max(size for *_, size, _ in self.seen)
        return float(np.sqrt(((sums - sums[0]) ** 2).sum(axis=1)).max() / largest) if largest > 0.0 else 0.0

    def depth(self, scene):
        """Spacings that a point lies deep in an obstacle of the last stage, or inf if it is inside another body."""
        sim, deepest = self.sim, 0.0
        x, body = sim.particles.position[: sim.particles.owned], sim.particles.body[: sim.particles.owned]
        for contact in sim.contacts:
            if isinstance(contact, RigidContact):
                gap, _ = contact.gap(x)
                deepest = max(deepest, float(-gap.min()) / SPACING)
        touching = any(c["type"] == "bodies" and "stages" not in c for c in scene["contacts"])
        return np.inf if touching and _inside_another(x, body) else deepest


def _inside_another(x, body):
    """Whether a point is surrounded by points of one other body: their mean direction vanishes."""
    for own in np.unique(body):
        for other in np.setdiff1d(body, own):
            way = x[body == other][None] - x[body == own][:, None]
            distance = np.sqrt((way**2).sum(axis=2))
            near = (distance < 1.5 * SPACING) & (distance > 0.0)
            count = near.sum(axis=1)
            mean = np.where(near[..., None], way / np.maximum(distance, 1e-300)[..., None], 0.0).sum(axis=1)
            size = np.sqrt((mean**2).sum(axis=1)) / np.maximum(count, 1)
            if ((count >= 3 * x.shape[1]) & (size < 0.25)).any():
                return True
    return False


def judge(number: int, folder: Path) -> dict:
    """Check and run scene `number` in a folder; a row of the table."""
    folder.mkdir(parents=True, exist_ok=True)
    scene, file = draw(number, folder), folder / f"scene{number}.yaml"
    file.write_text(yaml.safe_dump(scene, sort_keys=False))
    row = dict.fromkeys(COLUMNS, "") | {"number": number}
    began = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()):
        try:
            check_scene(file, MPI.COMM_SELF)
            row["check"] = "valid"
        except InputError as error:
            row |= {"check": "refused", "verdict": "refused", "message": str(error)}
    if row["check"] == "valid":
        watch = Watch()
        row |= _run(file, folder, watch)
        if row["verdict"] == "done":
            row |= _findings(scene, watch)
        row["steps"] = watch.sim.step_number if watch.sim else 0
    row["message"] = " ".join(row["message"].split())[:200]
    return row | {"seconds": round(time.process_time() - began, 1)}


def _run(file, folder, watch):
    result = folder / f"{file.stem}.vtkhdf"
    messages = io.StringIO()
    try:
        with contextlib.redirect_stderr(messages), contextlib.redirect_stdout(messages):
            run_scene(file, result, comm=MPI.COMM_SELF, overwrite=True, quiet=True, callbacks=[(LOOK, watch)])
    except InputError as error:
        return {"verdict": "VIOLATION: check found it valid", "message": str(error)}
    except (WatchdogError, RelaxationError, ContactError) as error:
        return {"verdict": "stopped", "message": f"{type(error).__name__}: {error}"}
    if watch.sim is None or watch.sim.stage_number < len(watch.sim.stages) - 1:
        return {"verdict": "interrupted"}
    return {"verdict": "done"}


def _findings(scene, watch):
    gain, where = watch.gain()
    free = not (scene.get("gravity") or scene.get("boundaries") or any("damping" in s for s in scene["stages"]))
    free = free and all(c["type"] == "bodies" for c in scene["contacts"])
    momentum, depth = watch.momentum() if free else 0.0, watch.depth(scene)
    wrong = []
    if not gain <= GAIN:
        wrong.append(f"{where} gives energy")
    if not momentum <= ROUNDING:
        wrong.append("momentum changes")
    if not depth <= DEEP:
        wrong.append("a wall is passed")
    figures = {"gain": f"{gain:.2e}", "where": where, "momentum": f"{momentum:.1e}", "depth": f"{depth:.2f}"}
    return figures | {"verdict": f"VIOLATION: {', '.join(wrong)}" if wrong else "done"}


def with_plugin(folder: Path) -> dict:
    """Environment in which the example plugin is found as if it were installed."""
    points = tomllib.loads((PLUGIN / "pyproject.toml").read_text())["project"]["entry-points"]
    place = folder / "periporo_mohr_coulomb-1.0.dist-info"
    place.mkdir(parents=True, exist_ok=True)
    (place / "METADATA").write_text("Metadata-Version: 2.1\nName: periporo-mohr-coulomb\nVersion: 1.0\n")
    lines = [f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in named.items()) for group, named in points.items()]
    (place / "entry_points.txt").write_text("".join(lines))
    paths = [str(folder), str(PLUGIN), *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths)}


def judged(numbers: list[int], folder: Path, patience: float):
    """Rows of these scenes, from a process that is watched, and begun anew after one that had to be ended."""
    environment = with_plugin(folder / "plugin")
    left = list(numbers)
    while left:
        command = [sys.executable, "-m", "benchmarks", "random_scenes", "--worker", "--folder", str(folder)]
        part = subprocess.Popen(
            [*command, *map(str, left)], env=environment, stdout=subprocess.PIPE, text=True, cwd=ROOT
        )
        for row in _rows(part, left, patience):
            left.remove(row["number"])
            yield row
        part.wait()


def _rows(part, numbers, patience):
    """Rows as the process writes them; it gets a signal when one takes too long, and must answer."""
    selector = selectors.DefaultSelector()
    selector.register(part.stdout, selectors.EVENT_READ)
    for number in list(numbers):
        if selector.select(patience):
            line = part.stdout.readline()
        else:
            part.send_signal(signal.SIGTERM)
            answered = bool(selector.select(GRACE))
            part.kill()
            verdict = "too slow, but hears signals" if answered else "VIOLATION: hangs"
            yield dict.fromkeys(COLUMNS, "") | {"number": number, "verdict": verdict}
            return
        if not line:  # it has crashed
            yield dict.fromkeys(COLUMNS, "") | {"number": number, "verdict": "VIOLATION: crashed"}
            return
        yield json.loads(line)


def main(words=None):
    """Run what the table lacks, and sum up."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "periporo-random-scenes")
    parser.add_argument("--table", type=Path, default=TABLE)
    parser.add_argument("--again", action="store_true", help="run what was not done well again")
    parser.add_argument("--patience", type=float, default=120.0, help="s for a scene")
    parser.add_argument("--worker", action="store_true", help="judge the scenes NUMBER and write rows as JSON")
    parser.add_argument("numbers", type=int, nargs="*", metavar="NUMBER", help="of scenes, in place of all")
    arguments = parser.parse_args(words)
    if arguments.worker:
        for number in arguments.numbers:
            print(json.dumps(judge(number, arguments.folder)), flush=True)
        return
    rows = read_rows(arguments.table)
    wanted = arguments.numbers or range(arguments.first, arguments.first + arguments.scenes)
    kept = {n for n, row in rows.items() if not (arguments.again and row["verdict"] not in ("done", "refused"))}
    for row in judged([n for n in wanted if arguments.numbers or n not in kept], arguments.folder, arguments.patience):
        rows[row["number"]] = row
        write_rows(arguments.table, rows)
        told = " ".join(str(row[c]) for c in COLUMNS[1:])
        print(f"{row['number']:3d} {told}", flush=True)
    bad = [n for n, row in rows.items() if row["verdict"].startswith("VIOLATION")]
    for verdict, count in Counter(row["verdict"] for row in rows.values()).most_common():
        print(f"{count:4d} {verdict}")
    sys.exit(1 if bad else 0)
