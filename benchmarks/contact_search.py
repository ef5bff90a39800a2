"""What many obstacles and a large ground cost.

    python -m benchmarks contact_search [--boxes 400] [--triangles 1000000] [--points 100000] [--steps 100]

A flowing sheet of soil over a floor, in which boxes stand that it may meet, without names and with, and a block of soil
on a ground in space, of triangles and of as many heights: shares of the processor time of steps that contacts take,
rebuilds and time steps included, from runs with and without them, in turns: medians. Reading and preparing the
triangles is timed, too.
"""

import tempfile
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene

from . import option_parser

SOIL = {"model": "drucker_prager", "density": 1800.0, "bulk_modulus": 25e6, "shear_modulus": 15e6,
        "cohesion": 0.0, "friction_angle": 30.0}  # fmt: skip
_TURN = 20  # steps, in which neighbours are found anew once or twice


def sheet(points: int, boxes: int, named: bool = False):
    """A plane sheet ten times as long as high slides over a floor; boxes stand above and before it, or tell forces."""
    spacing = 1.0 / np.sqrt(points / 10.0)
    x = np.linspace(0.1, 9.9, boxes // 2) if boxes else []
    stands = [[a, 1.2] for a in x] + [[10.3 + 0.05 * k, 0.3] for k in range(boxes // 2)]
    blocks: list[dict] = [{"type": "box", "lower": [a, b], "upper": [a + 0.02, b + 0.02], "friction": 0.3}
                          for a, b in stands]  # fmt: skip
    if named:
        blocks = [block | {"name": f"box_{k}"} for k, block in enumerate(blocks)]
    return scene(2, spacing, [0, 0], [10, 1], [floor(2), *blocks], [1.0, 0.0])


def slab(points: int, ground):
    """A slab of soil in space slides over a ground."""
    side = (points / 10.0) ** 0.5
    spacing = 10.0 / side
    return scene(3, spacing, [10.0, 10.0, 0.0], [20.0, 20.0, 10.0 * spacing], [ground], [1.0, 0.3, 0.0])


def floor(dimension):
    up = [0.0] * (dimension - 1) + [1.0]
    return {"type": "plane", "point": [0.0] * dimension, "normal": up, "friction": 0.3}


def scene(dimension, spacing, lower, upper, contacts, velocity):
    shape = {"type": "box", "lower": list(map(float, lower)), "upper": list(map(float, upper))}
    return {
        "dimension": dimension, "spacing": float(spacing), "gravity": [0.0] * (dimension - 1) + [-9.81],
        "materials": {"soil": SOIL}, "contacts": contacts,
        "bodies": [{"name": "soil", "material": "soil", "shape": shape, "velocity": velocity}],
        "stages": [{"name": "slide", "type": "dynamics", "duration": 10.0}],
    }  # fmt: skip


def wavy(n: int):
    """Heights (n, n) m, and their places, of a ground 30 m wide that the slab just touches."""
    x, y = np.meshgrid(*[np.linspace(0.0, 30.0, n)] * 2)
    return x, y, -0.001 * (2.0 + np.sin(x) + np.cos(y))


def cells(folder: Path, count: int) -> dict:
    """That ground of so many heights."""
    n = int(count**0.5)
    file = folder / "ground.npy"
    np.save(file, wavy(n)[2])
    meaning = {"corner": [0.0, 0.0], "cell": [30.0 / (n - 1)] * 2, "first_row": "south", "registration": "corner"}
    return {"type": "terrain", "ground": {"file": str(file)} | meaning, "friction": 0.3}


def triangles(folder: Path, count: int) -> dict:
    """That ground of so many triangles."""
    n = int((count / 2) ** 0.5) + 1
    x, y, z = wavy(n)
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    corners = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    table = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    table["corners"] = np.stack([x.ravel(), y.ravel(), z.ravel()], 1)[corners]
    file = folder / "ground.stl"
    file.write_bytes(b" " * 80 + np.uint32(len(corners)).tobytes() + table.tobytes())
    return {"type": "terrain", "ground": str(file), "friction": 0.3}


def started(data):
    """The simulation, and the processor time of building it."""
    began = time.process_time()
    sim = build(parse_scene(data, "."), MPI.COMM_SELF)
    building = time.process_time() - began
    sim.start()
    stage = sim.stages[0]
    sim.contacts, sim.loads = stage.contacts, stage.loads
    sim.apply_loads(0.0)
    return sim, building


def share(plain, full, steps):
    """How much of the processor time of a step of `full` goes beyond one of `plain`, %: the median of turns."""
    seconds = np.zeros((1 + max(steps // _TURN, 1), 2))
    for turn in seconds:
        for k, sim in enumerate((plain, full)):
            began = time.process_time()
            for _ in range(_TURN):
                sim.step()
            turn[k] = time.process_time() - began
    return 100.0 * float(np.median(1.0 - seconds[1:, 0] / seconds[1:, 1]))  # the first turn compiles


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--boxes", type=int, default=400)
    parser.add_argument("--triangles", type=int, default=1_000_000)
    parser.add_argument("--points", type=int, default=100_000)
    parser.add_argument("--steps", type=int, default=100)
    arguments = parser.parse_args(words)
    points, steps = arguments.points, arguments.steps
    if arguments.boxes:
        plain, _ = started(sheet(points, 0))
        for named, kind in ((False, "boxes"), (True, "boxes with names")):
            full, _ = started(sheet(points, arguments.boxes, named))
            part = share(plain, full, steps)
            print(f"{arguments.boxes} {kind}: {part:.1f} % of a step of {plain.particles.owned} points")
    if not arguments.triangles:
        return
    plain, without = started(slab(points, floor(3)))
    for ground in (triangles, cells):
        with tempfile.TemporaryDirectory() as folder:
            full, building = started(slab(points, ground(Path(folder), arguments.triangles)))
        print(f"{arguments.triangles} {ground.__name__}: read and prepared in {building - without:.1f} s, and "
              f"{share(plain, full, steps):.1f} % of a step of {plain.particles.owned} points beyond what a plane takes"
        )  # fmt: skip
