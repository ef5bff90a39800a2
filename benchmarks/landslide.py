"""What a large landslide on natural ground takes: the shipped scene, at a spacing that gives many points.

    python -m benchmarks landslide [--points 200000] [--steps 200] [--ranks 1 2]

For each number of ranks: time until the first step, memory of all ranks at its peak, the length of a step, and time of
a step: on the clock, and of the processor on the busiest rank, which is what to look at while others use the machine.
The estimates are of all steps until the slide rests, by either. Its steps get shorter as soil deforms, and dearer as it
flows: by what they did in a whole run of 19 620 points, 6400 steps in 242 s of processor time.
"""

import importlib.resources
import json
import resource
import time

from mpi4py import MPI

from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene
from periporo.io.input.yaml_source import read_yaml

from . import option_parser
from .library.ranks import start

SPACING, POINTS = 15.0, 2212  # of the scene
REST = 69.0  # s, when the scene has come to rest
SHORTER, DEARER = 1.53, 1.5  # the first steps over the mean of all, and processor time of a step of all over the first


def scene(points: int) -> tuple[dict, str]:
    """The shipped scene with about so many points, and the folder of its files."""
    folder = importlib.resources.files("periporo.configs")
    data = read_yaml(folder / "landslide_3d.yaml").data
    return data | {"spacing": SPACING * (POINTS / points) ** (1.0 / 3.0)}, str(folder)


def count(points: int, steps: int) -> None:
    """Run some steps on these ranks; rank 0 prints the figures as JSON."""
    comm = MPI.COMM_WORLD
    began = time.perf_counter()
    data, folder = scene(points)
    sim = build(parse_scene(data, folder), comm)
    sim.start()
    stage = sim.stages[0]
    sim.contacts, sim.loads = stage.contacts, stage.loads
    sim.apply_loads(0.0)
    sim.step()
    ready = time.perf_counter() - began
    clock, processor, moved = time.perf_counter(), time.process_time(), sim.time
    for _ in range(steps):
        sim.step()
    processor = comm.allreduce(time.process_time() - processor, MPI.MAX) / steps
    clock = (time.perf_counter() - clock) / steps
    sim.halo.close()
    memory = comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
    owned = comm.allreduce(sim.particles.owned)
    if comm.rank == 0:
        print(json.dumps({"points": owned, "ready": ready, "clock": clock, "processor": processor, "memory": memory,
                          "step": (sim.time - moved) / steps}))  # fmt: skip


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--points", type=int, default=200_000)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--here", action="store_true", help="on the ranks that run this, in place of starting some")
    arguments = parser.parse_args(words)
    if arguments.here:
        count(arguments.points, arguments.steps)
        return
    heads = ("ranks", "points", "ready after, s", "memory, GB", "step, ms", "clock, s", "to rest, h", "processor, s",
             "to rest, h")  # fmt: skip
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}", flush=True)
    for ranks in arguments.ranks:
        words = ["--points", arguments.points, "--steps", arguments.steps, "--here"]
        f = json.loads(start(ranks, "landslide", *words).splitlines()[-1])
        hours = REST / f["step"] * SHORTER * DEARER / 3600.0  # per second of a step
        print(f"| {ranks} | {f['points']:,} | {f['ready']:.0f} | {f['memory'] / 1e9:.2f} | {1e3 * f['step']:.2f} | "
              f"{f['clock']:.3f} | {hours * f['clock']:.1f} | {f['processor']:.3f} | {hours * f['processor']:.1f} |",
              flush=True)  # fmt: skip
