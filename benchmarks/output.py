"""How long an output takes, against a plain file of as many bytes on the disk; and what it costs the steps.

    python -m benchmarks output disk --points 4000000                             # one file
    mpirun -n 2 python -m benchmarks output disk --points 4000000 --parts 2       # a file of each rank
    python -m benchmarks output steps                                             # a column that writes often

`disk` gives a made-up state of the plane, 152 B per point with place and id, to the writer of results, and writes as
many bytes to a plain file, in turns; each is on the disk (fsync) when its time is taken, and behind the ones before,
for blocks that are used again are quicker. `steps` runs a block that writes every so many steps, in the background and
waiting for each output, in turns.
"""

import contextlib
import os
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from mpi4py import MPI

from periporo.core.points import fields
from periporo.io.output.writer import ResultWriter

from . import option_parser
from .scaling import block

COMM = MPI.COMM_WORLD
FIELDS = {"displacement": (2, "m"), "velocity": (2, "m/s"), "stress": (4, "Pa"), "volumetric_strain": (1, "1"),
          "material": (1, ""), "body": (1, "")}  # fmt: skip
STORED = 8 * (1 + 3 + 3 + 3 + 6 + 1 + 1 + 1)  # B per point: id, place, and the fields with the zeros of plane strain


def disk(arguments, folder):
    """Outputs by the writer and plain files in turns; prints the ratio of each round."""
    mine = np.arange(COMM.rank, arguments.points, COMM.size)
    random = np.random.default_rng(COMM.rank)
    values = {name: random.random((len(mine), columns)) for name, (columns, _) in FIELDS.items()}
    place, plain = random.random((len(mine), 2)), random.random((len(mine), STORED // 8))
    ratios = []
    with ResultWriter(folder / "run.vtkhdf", COMM, dimension=2, fields=FIELDS, parts=arguments.parts) as writer:
        writer.write(0.0, 0, mine, place, values)  # with the connectivity, which the others share
        writer.sync()
        writer.flush()
        for k in range(1, arguments.rounds + 1):
            took = [timed(lambda: raw(folder / f"plain_{COMM.rank}", plain)),
                    timed(lambda k=k: written(writer, k, mine, place, values))]  # fmt: skip
            ratios.append(took[1] / took[0])
            if COMM.rank == 0:
                size = STORED * arguments.points
                print(f"output {took[1]:.2f} s, plain file {took[0]:.2f} s ({size / took[0] / 1e6:.0f} MB/s): "
                      f"{ratios[-1]:.2f}", flush=True)  # fmt: skip
    if COMM.rank == 0:
        print(f"{arguments.points:,} points, {COMM.size} ranks, parts {arguments.parts}: an output takes "
              f"{np.median(ratios):.2f} times a plain file of its bytes", flush=True)  # fmt: skip


def written(writer, k, ids, place, values):
    """An output, on the disk."""
    writer.write(float(k), k, ids, place, values)
    writer.sync()
    writer.flush()


def raw(path, rows):
    """As many bytes behind those of a plain file, on the disk."""
    with open(path, "ab", buffering=0) as file:
        left = memoryview(rows).cast("B")
        while left:
            left = left[file.write(left) :]
        os.fsync(file.fileno())


def timed(action):
    """Seconds that an action takes on all ranks."""
    COMM.Barrier()
    began = time.perf_counter()
    action()
    COMM.Barrier()
    return time.perf_counter() - began


def steps(arguments, folder):
    """A block steps and writes, in the background and waiting, in turns; prints the shares of time in writing."""
    side = round(arguments.points**0.5)
    sim = block([side, side])
    names = ("displacement", "velocity", "stress", "volumetric_strain", "equivalent_shear_strain", "material", "body")
    declared = {n: (f.columns, f.unit) for n, f in fields.available(sim).items() if n in names}
    shares = {"waiting": [], "in the background": []}
    with ResultWriter(folder / "run.vtkhdf", COMM, dimension=2, fields=declared, parts=arguments.parts) as writer:
        for _ in range(arguments.rounds):
            for how, share in shares.items():
                began, lost = time.perf_counter(), 0.0
                for _ in range(arguments.outputs):
                    for _ in range(arguments.every):
                        sim.step()
                    lost += timed(lambda how=how: output(sim, writer, declared, how == "waiting"))
                lost += timed(writer.flush)
                share.append(lost / (time.perf_counter() - began))
    sim.halo.close()
    if COMM.rank == 0:
        for how, share in shares.items():
            print(f"{side**2:,} points, an output every {arguments.every} steps, {how}: "
                  f"{np.median(share):.3f} of the time is writing ({min(share):.3f} to {max(share):.3f})", flush=True)


def output(sim, writer, names, wait):
    """Write the state of a simulation, and wait until it is on the disk."""
    p, n = sim.particles, sim.particles.owned
    writer.write(sim.time, sim.step_number, p.id[:n], p.position[:n], fields.values(sim, names))
    if wait:
        writer.flush()


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("what", choices=("disk", "steps"))
    parser.add_argument("--points", type=int, default=40_000)
    parser.add_argument("--parts", type=int, help="files that are written side by side")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--every", type=int, default=10, help="steps between outputs")
    parser.add_argument("--outputs", type=int, default=5, help="of a round of steps")
    parser.add_argument("--folder", help="on the disk to be measured, by default that of temporary files")
    arguments = parser.parse_args(words)
    with TemporaryDirectory(dir=arguments.folder) if COMM.rank == 0 else contextlib.nullcontext() as name:
        {"disk": disk, "steps": steps}[arguments.what](arguments, Path(COMM.bcast(name)))
        COMM.Barrier()
