"""What a rank sends and keeps to divide space, find its neighbours and hand points over, on up to 256 ranks.

    python -m benchmarks many_ranks --ranks 4 16 64 256

Each rank has 36 points of a square grid. They are divided, all move by a spacing along both axes, are handed over, and
find their ghosts; then as much again where division and neighbours' boxes are known. Counted is the most that a rank
sends, so ranks may share cores. Reductions over all ranks are the library's own, and counted apart.
"""

import json
import time

import numpy as np
from mpi4py import MPI

from periporo.core.points.particles import Particles
from periporo.core.ranks.domain import bisect
from periporo.core.ranks.halo import Halo

from . import option_parser
from .library.ranks import start

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


def main(words):
    """Start `count` on each number of ranks, or be one of them."""
    if words == ["count"]:
        count()
        return
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--ranks", type=int, nargs="+", default=[4, 16, 64], help="squares of whole numbers")
    for ranks in parser.parse_args(words).ranks:
        began = time.perf_counter()
        found = json.loads(start(ranks, "many_ranks", "count"))
        took = time.perf_counter() - began
        print(f"\n{ranks} ranks: {found.pop('neighbours')} neighbours at most, the longest list of the division has "
              f"{found.pop('longest')} entries; {took:.0f} s, {found.pop('seconds'):.1f} s after the start\n")
        print("| | messages | kB | reductions |\n|---|---|---|---|")
        for name, (messages, sent, reductions) in found.items():
            print(f"| {name} | {messages} | {sent / 1e3:.1f} | {reductions} |", flush=True)
