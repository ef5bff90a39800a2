"""What a rank sends and keeps to divide space, find its neighbours and hand points over, on up to 256 ranks.

    python -m benchmarks many_ranks --ranks 4 16 64 256
    python -m benchmarks many_ranks begin --ranks 256          # processor time of a rank until its first step

Each rank has 36 points of a square grid. They are divided, all move by a spacing along both axes, are handed over, and
find their ghosts; then as much again where division and neighbours' boxes are known. Counted is the most that a rank
sends, so ranks may share cores. Reductions over all ranks are the library's own, and counted apart. `begin` runs a
tiny scene for one step, from the command line, after a run on one rank that compiles what is lacking.
"""

import json
import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

from periporo.core.points.particles import Particles
from periporo.core.ranks.domain import bisect
from periporo.core.ranks.halo import Halo

from . import option_parser
from .library.ranks import command, start

SIDE, REACH = 6, 2.4  # points along the edge of a rank's part; spacings


class Counting(MPI.Intracomm):
    """A communicator that counts messages, bytes and reductions."""

    messages = sent = reductions = 0

    def _count(self, buffer):
        self.messages += 1
        self.sent += buffer.nbytes

    def Send(self, buffer, *rest):
        self._count(buffer)
        super().Send(buffer, *rest)

    def Isend(self, buffer, *rest):
        self._count(buffer)
        return super().Isend(buffer, *rest)

    def Send_init(self, buffer, *rest):
        self._count(buffer)  # each is started once here
        return super().Send_init(buffer, *rest)

    def Allreduce(self, *arguments):
        self.reductions += 1
        super().Allreduce(*arguments)

    def allreduce(self, *arguments):
        self.reductions += 1
        return super().allreduce(*arguments)

    def counted(self, action):
        """What an action returns, and the messages, bytes and reductions that it took."""
        before = self.messages, self.sent, self.reductions
        result = action()
        return result, np.array([self.messages - before[0], self.sent - before[1], self.reductions - before[2]])


def grid(comm):
    """Every P-th point of the grid by field: neighbours on the grid begin on other ranks."""
    d = int(round(np.sqrt(comm.size))) * SIDE
    particles, ids = Particles(2), np.arange(comm.rank, d * d, comm.size)
    fields = {f.name: np.zeros((len(ids),) if f.columns is None else (len(ids), f.columns), f.dtype)
              for f in particles.migrating()}  # fmt: skip
    fields |= {"id": ids, "position": np.stack([ids % d, ids // d], axis=1).astype(float)}
    particles.replace(fields, 0)
    return particles


def longest(thing, seen=None) -> int:
    """Length of the longest array, list, tuple or dictionary that an object holds."""
    seen = set() if seen is None else seen
    if id(thing) in seen or isinstance(thing, (str, type, MPI.Comm, MPI.Request)):
        return 0
    seen.add(id(thing))
    if isinstance(thing, np.ndarray):
        return thing.size
    if isinstance(thing, (list, tuple, dict)):
        parts = thing.values() if isinstance(thing, dict) else thing
        return max([len(thing), *(longest(part, seen) for part in parts)])
    return max([0, *(longest(part, seen) for part in vars(thing).values())]) if hasattr(thing, "__dict__") else 0


def count():
    """The actions, and what they took on the rank with the most; rank 0 prints it as JSON."""
    began = time.perf_counter()
    comm = Counting(MPI.COMM_WORLD)
    halo, particles, found = Halo(comm), grid(comm), {}

    def rebuild(domain, words):
        owner, asked = comm.counted(lambda: domain.owner(particles.position[: particles.owned]))
        owned, moved = comm.counted(lambda: halo.migrate(particles, owner))
        _, ghosts = comm.counted(lambda: halo.rebuild(particles, domain, owned, REACH))
        found.update({f"{words}: owners": asked, f"{words}: points": moved, f"{words}: ghosts": ghosts})

    domain, cut = comm.counted(lambda: bisect(comm, particles.position[: particles.owned], np.ones(particles.owned)))
    found["divide"] = cut
    rebuild(domain, "first")
    particles.position[: particles.owned] += 1.0
    rebuild(domain, "again")
    found = {name: np.max(comm.allgather(counts), axis=0).tolist() for name, counts in found.items()}
    found["neighbours"] = max(comm.allgather(len(halo.sends)))
    found["longest"] = max(comm.allgather(longest(domain)))
    halo.close()
    if comm.rank == 0:
        print(json.dumps(found | {"seconds": time.perf_counter() - began}))


SCENE = """
dimension: 2
spacing: 0.01
materials:
  soil: {model: drucker_prager, density: 1800, bulk_modulus: 25e6, shear_modulus: 15e6, cohesion: 0, friction_angle: 30}
bodies: [{name: column, material: soil, shape: {type: box, lower: [0, 0], upper: [1, 0.5]}}]
contacts: [{type: plane, point: [0, 0], normal: [0, 1], friction: 0.5}]
stages: [{name: fall, type: dynamics, duration: 1e-9}]
"""


def begin(ranks):
    """Processor time of a rank of a run that takes one step, in Python and in the system, and the time on the clock."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "tiny.yaml").write_text(SCENE)
        for count in (1, ranks):
            before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            words, variables = command(count, "-m", "periporo.core.cli", "tiny.yaml", "--overwrite", "--no-plot")
            subprocess.run(words, check=True, cwd=folder, env=os.environ | variables, stdout=subprocess.DEVNULL)
            took, used = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    user, system = (used.ru_utime - before.ru_utime) / ranks, (used.ru_stime - before.ru_stime) / ranks
    print(f"{ranks} ranks: {user + system:.2f} s of processor time each, {system:.2f} s of it in the system; "
          f"{took:.0f} s on {os.cpu_count()} cores", flush=True)  # fmt: skip


def main(words):
    """Start `count` on each number of ranks, or be one of them."""
    if words == ["count"]:
        count()
        return
    parser = option_parser(__name__, __doc__)
    parser.add_argument("what", nargs="?", choices=("send", "begin"), default="send")
    parser.add_argument("--ranks", type=int, nargs="+", default=[4, 16, 64], help="squares of whole numbers")
    arguments = parser.parse_args(words)
    for ranks in arguments.ranks:
        if arguments.what == "begin":
            begin(ranks)
            continue
        began = time.perf_counter()
        found = json.loads(start(ranks, "many_ranks", "count"))
        took = time.perf_counter() - began
        print(f"\n{ranks} ranks: {found.pop('neighbours')} neighbours at most, the longest list of the division has "
              f"{found.pop('longest')} entries; {took:.0f} s, {found.pop('seconds'):.1f} s after the start\n")
        print("| | messages | kB | reductions |\n|---|---|---|---|")
        for name, (messages, sent, reductions) in found.items():
            print(f"| {name} | {messages} | {sent / 1e3:.1f} | {reductions} |", flush=True)
