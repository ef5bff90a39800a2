"""Scaling: what ranks send each other, how evenly the work is divided, and how long a step takes.

    mpirun -n 4 python benchmarks/scaling.py count --side 120           # messages and bytes against the model
    mpirun -n 4 python benchmarks/scaling.py collapse                   # balance while a column spreads fivefold
    mpirun -n 2 python benchmarks/scaling.py time --side 200            # 40 000 points in the plane
    mpirun -n 2 python benchmarks/scaling.py time --side 39 --dimension 3
    python benchmarks/scaling.py memory --side 2000                     # 4 million points: set up and step

Only `time` measures time, and means something with a core for each rank. The rest is counted, so that ranks may share
cores. Strong scaling keeps --side, weak scaling lets it grow with the square (cubic) root of the ranks.
"""

import argparse
import resource
import time

import numpy as np
from mpi4py import MPI

from periporo.core.scene import build
from periporo.io.schema import parse_scene

COMM = MPI.COMM_WORLD
ELASTIC = {"model": "elastic", "density": 1760.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
SAND = {"model": "drucker_prager", "density": 1600.0, "bulk_modulus": 2e5, "shear_modulus": 1e5,
        "friction_angle": 15.0, "cohesion": 0.0}  # fmt: skip
# numbers that a ghost receives in each step, bond-projected scheme in the plane and in space (core/halo.py):
# position, velocity, volume; share, shape, gradient and the averages of stress and state; flux
PLANE, SPACE = (2 + 2 + 1) + (2 + 3 + 4 + 5) + 4, (3 + 3 + 1) + (2 + 6 + 9 + 7) + 9
EXCHANGES = 3  # messages to each neighbour in a step


def block(dimension, side, material=ELASTIC, **keys):
    """A square or cube of side**dimension points that drifts and shakes."""
    scene = {
        "dimension": dimension, "spacing": 1.0, "materials": {"soil": material},
        "bodies": [{"name": "block", "material": "soil", "velocity": [1.0] * dimension,
                    "shape": {"type": "box", "lower": [0.0] * dimension, "upper": [float(side)] * dimension}}],
        "stages": [{"name": "free", "type": "dynamics", "duration": 1.0}],
    }  # fmt: skip
    sim = build(parse_scene(scene | keys), COMM)
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


def ghosts_of_a_box(sim, dimension, side):
    """Ghosts of a rank in the model: a layer as thick as the reach around a box with its share of the points."""
    edges = np.full(dimension, float(side))
    for _ in range(int(np.log2(COMM.size))):
        edges[np.argmax(edges)] /= 2.0
    inner = edges < side  # faces inside the block; a box of two ranks along an axis has one
    faces = np.where(inner, np.where(edges * 2 < side, 2, 1), 0)
    return float(np.prod(edges + faces * sim.ghost_reach) - np.prod(edges))


def count(arguments):
    d, side = arguments.dimension, arguments.side
    sim = block(d, side)
    sim.step()
    sim.time_step.fixed = sim.dt  # no Lanczos iterations among the steps that are counted
    sim.halo.reset_counters()
    rebuilds, steps = sim.rebuild_count, arguments.steps
    for _ in range(steps):
        sim.step()
    rebuilt = sim.rebuild_count - rebuilds
    ghosts = COMM.allgather(sim.particles.total - sim.particles.owned)
    neighbours = COMM.allgather(len(sim.halo.sends))
    uneven = imbalance(sim)
    sent = np.array(COMM.allgather((sim.halo.messages_sent, sim.halo.bytes_sent)))
    if COMM.rank == 0:
        model = ghosts_of_a_box(sim, d, side)
        numbers = PLANE if d == 2 else SPACE
        print(f"{COMM.size:3d} ranks {side**d:9,d} points  imbalance {uneven:.3f}  rebuilds/step {rebuilt / steps:.4f}"
              f"  neighbours max {max(neighbours)}  messages/step max {sent[:, 0].max() / steps:.1f}"
              f" (model {EXCHANGES * max(neighbours)})  ghosts max {max(ghosts):,} (model {model:,.0f})  kB/step max "
              f"{sent[:, 1].max() / steps / 1e3:.1f} (model {8e-3 * numbers * model:.1f})", flush=True)  # fmt: skip


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
    if COMM.rank == 0:
        print(f"{COMM.size} ranks: spread {width:.2f}-fold in {sim.step_number} steps, {rebuilds} rebuilds, divided "
              f"anew {divided} times; imbalance mean {np.mean(seen):.3f}, 99 % {np.quantile(seen, 0.99):.3f}, largest "
              f"{max(seen):.3f}", flush=True)  # fmt: skip


def measure(arguments):
    sim = block(arguments.dimension, arguments.side)
    for _ in range(5):
        sim.step()
    figures = []
    for _ in range(5):
        COMM.Barrier()
        began = time.perf_counter()
        for _ in range(arguments.steps):
            sim.step()
        COMM.Barrier()
        figures.append((time.perf_counter() - began) / arguments.steps)
    if COMM.rank == 0:
        points = arguments.side**arguments.dimension
        print(f"{COMM.size} ranks {points:,} points: {np.median(figures) * 1e3:.3f} ms per step "
              f"(smallest {min(figures) * 1e3:.3f})", flush=True)  # fmt: skip


def memory(arguments):
    from periporo.core.run import _memory

    began = time.perf_counter()
    sim = block(arguments.dimension, arguments.side)
    ready = time.perf_counter() - began
    for _ in range(3):
        sim.step()
    state = COMM.allreduce(_memory(sim))
    peak = COMM.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
    if COMM.rank == 0:
        points = arguments.side**arguments.dimension
        print(f"{COMM.size} ranks {points:,} points: ready after {ready:.1f} s; state {state / points:.0f} B "
              f"per point, peak of the processes {peak / 1e9:.2f} GB, {peak / points:.0f} B per point")  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("count", "collapse", "time", "memory"))
    parser.add_argument("--dimension", type=int, default=2, choices=(2, 3))
    parser.add_argument("--side", type=int, default=100, help="points along each axis")
    parser.add_argument("--steps", type=int, default=100)
    arguments = parser.parse_args()
    {"count": count, "collapse": collapse, "time": measure, "memory": memory}[arguments.what](arguments)


if __name__ == "__main__":
    main()
