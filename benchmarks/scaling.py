"""Scaling: what ranks send each other, how evenly the work is divided, and how long a step takes.

    python -m benchmarks scaling sweep --dimension 2 --points 400 --weak   # 1 ... 16 ranks, as many points on each
    python -m benchmarks scaling sweep --dimension 3 --points 13824        # the same number of points on all of them
    mpirun -n 4 python -m benchmarks scaling collapse                      # balance while a column spreads fivefold
    mpirun -n 2 python -m benchmarks scaling speedup --side 200            # 40 000 points in the plane, 1 and 2 ranks
    mpirun -n 2 python -m benchmarks scaling speedup --side 40 --dimension 3   # 64 000 points in space
    mpirun -n 2 python -m benchmarks scaling speedup --scene configs/column_collapse.yaml --after 4000   # in its fall
    mpirun -n 2 python -m benchmarks scaling parts --side 200              # where the time of a step goes
    mpirun -n 2 python -m benchmarks scaling machine                       # what two cores have in common
    python -m benchmarks scaling memory --side 2000                        # 4 million points: set up and step

Only `speedup`, `parts` and `machine` measure time, and mean something with a core for each rank. The rest is counted,
so that ranks may share cores. `sweep` starts `count` by mpirun, which takes the same words.
"""

import json
import resource
import time

import numpy as np
from mpi4py import MPI

from periporo import Simulation
from periporo.core.scene.build import build
from periporo.core.scene.check import state_bytes
from periporo.io.input.load import parse_scene

from . import option_parser
from .library.ranks import start
from .roofline import multiply_add, triad

COMM = MPI.COMM_WORLD
ELASTIC = {"model": "elastic", "density": 1760.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
SAND = {"model": "drucker_prager", "density": 1600.0, "bulk_modulus": 2e5, "shear_modulus": 1e5,
        "friction_angle": 15.0, "cohesion": 0.0}  # fmt: skip
# fields that ghosts receive in each step with the default scheme, one message each
EXCHANGES = (("position", "velocity"), ("share", "gradient"), ("link", "seen"), ("flux",))
RANKS = (1, 2, 4, 8, 16)


def block(counts, material=ELASTIC, comm=COMM, **keys):
    """A block of `counts` points along each axis that drifts and shakes."""
    d = len(counts)
    scene = {
        "dimension": d, "spacing": 1.0, "materials": {"soil": material},
        "bodies": [{"name": "block", "material": "soil", "velocity": [1.0] * d,
                    "shape": {"type": "box", "lower": [0.0] * d, "upper": [float(n) for n in counts]}}],
        "stages": [{"name": "free", "type": "dynamics", "duration": 1.0}],
    }  # fmt: skip
    sim = build(parse_scene(scene | keys), comm)
    sim.start()
    return sim


def column():
    """A column 100 points high and 30 wide, of loose sand that spreads over a smooth floor."""
    return {
        "dimension": 2, "spacing": 0.01, "gravity": [0.0, -9.81], "materials": {"sand": SAND},
        "bodies": [{"name": "column", "material": "sand",
                    "shape": {"type": "box", "lower": [-0.15, 0.0], "upper": [0.15, 1.0]}}],
        "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.05}],
        "stages": [{"name": "fall", "type": "dynamics", "duration": 1.0}],
    }  # fmt: skip


def imbalance(sim):
    """Largest number of pairs of a rank over the mean."""
    pairs = COMM.allgather(len(sim.bonds.pairs.first))
    return max(pairs) / np.mean(pairs)


def model(counts, ranks, reach):
    """What the model says of the rank with the most neighbours: (neighbours, ghosts, pairs over its share).

    The longest side of a box is halved until there are as many boxes as ranks. What lies within `reach` (spacings) of
    a box is a ghost. A pair that crosses a face is listed on both sides of it.
    """
    edges = np.array(counts, float)
    for _ in range(int(np.log2(ranks))):
        edges[np.argmax(edges)] /= 2.0
    boxes = np.round(np.array(counts) / edges)
    faces = np.minimum(boxes - 1, 2)
    neighbours = int(np.prod(faces + 1) - 1)
    ghosts = np.prod(edges + faces * reach) - np.prod(edges)
    return neighbours, float(ghosts), float(1.0 + 0.5 * (faces * mean_crossing(len(counts), reach) / edges).sum())


def mean_crossing(dimension, reach):
    """Pairs within `reach` (spacings) that cross a plane between two rows, over pairs per row of points."""
    offsets = np.stack(np.meshgrid(*[np.arange(-3, 4)] * dimension), axis=-1).reshape(-1, dimension)
    near = offsets[((offsets**2).sum(axis=1) < reach**2) & (offsets != 0).any(axis=1)]
    return np.abs(near[:, 0]).sum() / len(near)


def count(arguments):
    """Messages, bytes, ghosts and balance of some steps; rank 0 prints them as JSON."""
    counts = arguments.counts or [arguments.side] * arguments.dimension
    sim = block(counts)
    sim.step()
    sim.time_step.fixed = sim.dt  # no Lanczos iterations among the steps that are counted
    sim.halo.reset_counters()
    rebuilds, steps, ghosts = sim.rebuild_count, arguments.steps, 0
    for _ in range(steps):
        sim.step()
        ghosts += sim.particles.total - sim.particles.owned
    ghosts = max(COMM.allgather(ghosts)) / steps
    neighbours = max(COMM.allgather(len(sim.halo.sends)))
    pairs = COMM.allgather(len(sim.bonds.pairs.first))
    owned = sim.particles.owned
    first, second = sim.bonds.pairs.first, sim.bonds.pairs.second
    shared = COMM.allreduce(int(((first >= owned) | (second >= owned)).sum()))
    sim.halo.close()
    sent = np.array(COMM.allgather((sim.halo.messages_sent, sim.halo.bytes_sent, state_bytes(sim)))).max(axis=0)
    numbers = sum(sim.particles.fields[name].columns or 1 for names in EXCHANGES for name in names)
    if COMM.rank == 0:
        m_neighbours, m_ghosts, m_pairs = model(counts, COMM.size, sim.ghost_reach)
        found = {
            "ranks": COMM.size, "points": int(np.prod(counts)), "rebuilds": (sim.rebuild_count - rebuilds) / steps,
            "imbalance": max(pairs) / np.mean(pairs), "pairs": max(pairs) * COMM.size / (sum(pairs) - shared / 2),
            "pairs_model": m_pairs, "neighbours": neighbours, "messages": sent[0] / steps,
            "messages_model": len(EXCHANGES) * m_neighbours, "ghosts": ghosts, "ghosts_model": m_ghosts,
            "kB": sent[1] / steps / 1e3, "kB_model": 8e-3 * numbers * m_ghosts, "numbers": numbers,
            "state": float(sent[2] * COMM.size / np.prod(counts)),
        }  # fmt: skip
        print(json.dumps(found), flush=True)


def sweep(arguments):
    """`count` on 1 to 16 ranks, as rows of a table: strong scaling, or weak with --points on each rank."""
    print("| ranks | points | neighbours | messages | ghosts | kB | imbalance | work | rebuilds | state |\n"
          "|---|---|---|---|---|---|---|---|---|---|")  # fmt: skip
    for ranks in arguments.ranks:
        side = round(arguments.points ** (1 / arguments.dimension))
        counts = [side] * arguments.dimension
        for k in range(int(np.log2(ranks)) if arguments.weak else 0):
            counts[k % len(counts)] *= 2
        f = json.loads(start(ranks, "scaling", "count", "--steps", arguments.steps, "--counts", *counts))
        print(f"| {ranks} | {f['points']:,} | {f['neighbours']} | {f['messages']:.1f} ({f['messages_model']}) | "
              f"{f['ghosts']:,.0f} ({f['ghosts_model']:,.0f}) | {f['kB']:.1f} ({f['kB_model']:.1f}) | "
              f"{f['imbalance']:.3f} | {f['pairs']:.3f} ({f['pairs_model']:.3f}) | {f['rebuilds']:.3f} | "
              f"{f['state']:,.0f} |", flush=True)  # fmt: skip


def collapse(arguments):
    """Divided anew whenever the pairs get uneven: largest imbalance after a rebuild while the column spreads."""
    sim = build(parse_scene(column()), COMM)
    sim.start()
    p, divided, domain, seen, rebuilds = sim.particles, 0, sim.domain, [], sim.rebuild_count
    while True:
        sim.step()
        if sim.domain is not domain:
            divided, domain = divided + 1, sim.domain
        if sim.rebuild_count != rebuilds:
            rebuilds = sim.rebuild_count
            seen.append(imbalance(sim))
        if sim.step_number % 50 == 0:
            width = COMM.allreduce(float(np.abs(p.position[: p.owned, 0]).max(initial=0.0)), MPI.MAX) / 0.15
            if width >= 5.0 or sim.step_number >= arguments.steps:
                break
    sim.halo.close()
    if COMM.rank == 0:
        print(f"{COMM.size} ranks: spread {width:.2f}-fold in {sim.step_number} steps, {rebuilds} rebuilds, divided "
              f"anew {divided} times; imbalance mean {np.mean(seen):.3f}, 99 % {np.quantile(seen, 0.99):.3f}, largest "
              f"{max(seen):.3f}", flush=True)  # fmt: skip


def speedup(arguments):
    """Time of a step alone and on all ranks, in turns; and alone on every rank at once, which share the memory.

    Machines slow down and recover within seconds, so every round has all three, and ratios are those of a round.
    """
    shared, alone = (_begun(arguments, comm) for comm in (COMM, MPI.COMM_SELF))
    for sim in (shared, alone):
        timed(sim, arguments.after)
    figures = []
    for _ in range(arguments.rounds):
        single = timed(alone, arguments.steps) if COMM.rank == 0 else 0.0
        sleep_until_all_arrive()
        together = timed(alone, arguments.steps)
        COMM.Barrier()
        figures.append((single, together, timed(shared, arguments.steps)))
        COMM.Barrier()
    shared.halo.close()
    figures = np.max(COMM.allgather(figures), axis=0)
    if COMM.rank == 0:
        single, together, divided = figures.T
        print("per round, ms per step alone / alone on every rank at once / divided among the ranks: "
              + ", ".join(" / ".join(f"{t * 1e3:.2f}" for t in row) for row in figures))  # fmt: skip
        p = alone.particles
        print(f"{p.owned:,} points in {p.dimension}D: {COMM.size} ranks are {np.median(single / divided):.2f} "
              f"times as fast as one (rounds {(single / divided).min():.2f} to {(single / divided).max():.2f}), by "
              f"the quickest tenth of the rounds {np.divide(*np.quantile(figures[:, [0, 2]], 0.1, axis=0)):.2f}; "
              f"without the memory they share {np.median(together / divided):.2f}", flush=True)  # fmt: skip


def _begun(arguments, comm):
    """The simulation of a scene file, or a block."""
    if arguments.scene is None:
        return block(arguments.counts or [arguments.side] * arguments.dimension, comm=comm)
    sim = Simulation.from_scene(arguments.scene, comm)
    sim.start()
    return sim


def machine(arguments):
    """How much slower each rank is when all work at once, each for itself: in registers, caches, memory; and in steps.

    What slows work in registers is no memory: cores that are halves of one, or a clock that falls.
    """
    x, wide = np.ones(2048), [np.ones(8_000_000) for _ in range(3)]
    near = [array[:20_000].copy() for array in wide]
    small = block([20, 20], comm=MPI.COMM_SELF)
    large = block([arguments.side] * arguments.dimension, comm=MPI.COMM_SELF)
    loads = {
        "multiply-adds in registers": lambda: multiply_add(x, 0.999, 0.001, 1000),
        "sums in the second cache": lambda: triad(*near, 400), "sums in memory": lambda: triad(*wide, 1),
        "steps of 400 points": lambda: timed(small, 40),
        f"steps of {large.particles.owned:,} points": lambda: timed(large, arguments.steps),
    }  # fmt: skip
    for name, load in loads.items():
        load()
        figures = []
        for _ in range(arguments.rounds):
            began = time.perf_counter()
            if COMM.rank == 0:
                load()
            single = time.perf_counter() - began
            sleep_until_all_arrive()
            COMM.Barrier()
            began = time.perf_counter()
            load()
            figures.append((single, time.perf_counter() - began))
            COMM.Barrier()
        figures = np.array(COMM.bcast(figures))
        if COMM.rank == 0:
            single, together = figures.T
            print(f"{name}: {np.median(together / single):.2f} times as long on {COMM.size} ranks at once (rounds "
                  f"{(together / single).min():.2f} to {(together / single).max():.2f})", flush=True)  # fmt: skip


def timed(sim, steps):
    """Seconds of a step."""
    began = time.perf_counter()
    for _ in range(steps):
        sim.step()
    return (time.perf_counter() - began) / steps


def sleep_until_all_arrive():
    """A barrier that leaves the processor to the others."""
    request = COMM.Ibarrier()
    while not request.Test():
        time.sleep(1e-3)


def parts(arguments):
    """Time of each part of a step on every rank, us per step: the sum, the largest, and what waits for others."""
    sim = block(arguments.counts or [arguments.side] * arguments.dimension)
    for _ in range(5):
        sim.step()
    sim.timing.reset()
    for _ in range(arguments.steps):
        sim.step()
    sim.halo.close()
    everyone = COMM.gather(sim.timing.seconds)
    if COMM.rank == 0:
        for name in everyone[0]:
            times = [seconds[name] / arguments.steps * 1e6 for seconds in everyone]
            print(f"{name:16s} {' '.join(f'{t:10.1f}' for t in times)}")
        print(f"{'sum':16s} {' '.join(f'{sum(s.values()) / arguments.steps * 1e6:10.1f}' for s in everyone)}")


def memory(arguments):
    """Set up, and step until neighbours were found three times; state and peak of the processes."""
    counts = arguments.counts or [arguments.side] * arguments.dimension
    block([8] * arguments.dimension).step()  # Python and kernels, which every scene needs
    needed = COMM.allreduce(peak())
    began = time.perf_counter()
    sim = block(counts)
    ready = time.perf_counter() - began
    while sim.rebuild_count < 3:
        sim.step()
    state, highest = COMM.allreduce(state_bytes(sim)), COMM.allreduce(peak())
    if COMM.rank == 0:
        points = np.prod(counts)
        print(f"{COMM.size} ranks {points:,} points: ready after {ready:.1f} s; state {state / points:.0f} B "
              f"per point, at the peak {(highest - needed) / points:.0f} B per point beyond the {needed / 1e9:.2f} GB "
              f"of a scene of {8**arguments.dimension} points")  # fmt: skip


def peak():
    """Largest memory of this process so far, bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


ACTIONS = {"count": count, "sweep": sweep, "collapse": collapse, "speedup": speedup, "parts": parts,
           "machine": machine, "memory": memory}  # fmt: skip


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("what", choices=ACTIONS)
    parser.add_argument("--dimension", type=int, default=2, choices=(2, 3))
    parser.add_argument("--side", type=int, default=100, help="points along each axis")
    parser.add_argument("--counts", type=int, nargs="+", help="points along each axis, in place of --side")
    parser.add_argument("--scene", help="of speedup, a file, in place of a block")
    parser.add_argument("--after", type=int, default=5, help="steps before the time of speedup is taken")
    parser.add_argument("--points", type=int, default=1600, help="of sweep")
    parser.add_argument("--weak", action="store_true", help="sweep with --points on each rank")
    parser.add_argument("--ranks", type=int, nargs="+", default=RANKS, help="of sweep, powers of two")
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=9, help="of speedup and machine")
    arguments = parser.parse_args(words)
    ACTIONS[arguments.what](arguments)
