"""What water costs: memory, steps, and 10 000 points through Terzaghi's consolidation.

    python -m benchmarks water_cost [--side 100]

- Memory of the arrays of points, pairs and rows, for each point, dry and with flowing water, shut in or with a
  boundary that it passes.
- Processor time of steps of an elastic square that moves, with full pores, over that of the dry one: medians of blocks
  of steps that all kinds take in turn, and the ratio of the quickest tenths of the blocks.
- A layer of side x side points that drains at its faces until T = 1 in a `quasi_static` stage: processor time,
  increments, iterations of conjugate gradients, and the time of an iteration against that of its kernels and against
  what one core of this machine can do (`python -m benchmarks roofline`).
"""

import time

import numpy as np
from mpi4py import MPI

from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene

from . import option_parser, roofline
from .library.blocks import MATERIALS
from .library.verification_cases import consolidation
from .library.verification_cases.seepage import terzaghi
from .skip import STEP, STEPS

SOIL = MATERIALS["elastic"]
WATER = {"suction": 0, "porosity": 0.4, "bulk_modulus": 1e8}
KINDS = {  # name -> pore water; the conductivities take an explicit step, and some stages
    "dry": None, "drained, constant suction": WATER | {"suction": 500.0},
    "undrained": WATER | {"drainage": "undrained"},
    "flowing, a step": WATER | {"drainage": "flowing", "conductivity": 1e-9},
    "flowing, stages": WATER | {"drainage": "flowing", "conductivity": 1e-3},
}  # fmt: skip
_BLOCK = 20  # steps
_IN_AN_ITERATION = [name for name in roofline.FLOPS if name != "material"]


def square(side, water, **more):
    """A square of elastic soil that moves freely, started."""
    stage = {"name": "motion", "type": "dynamics", "duration": STEPS * STEP / side}
    scene = {
        "dimension": 2, "spacing": 1.0 / side, "materials": {"soil": SOIL}, "time_step": {"fixed": STEP / side},
        "bodies": [{"name": "square", "material": "soil", "velocity": [1.0, 0.0],
                    "shape": {"type": "box", "lower": [0.0, 0.0], "upper": [1.0, 1.0]}}],
        "stages": [stage],
    } | ({} if water is None else {"pore_water": water}) | more  # fmt: skip
    sim = build(parse_scene(scene), MPI.COMM_SELF)
    sim.start()
    return sim


def memory(sim) -> float:
    """Bytes of the arrays of points, pairs and rows, for each point."""
    p, pairs = sim.particles, sim.bonds.pairs
    arrays = [getattr(p, name) for name in p.fields]
    for part in (pairs, *sim.bonds.carriers):
        arrays += [value for value in vars(part).values() if isinstance(value, np.ndarray)]
    own = {id(a): a.nbytes for a in arrays}
    return sum(own.values()) / p.owned


def step_ratios(side, blocks):
    """Processor time (blocks,) s of `_BLOCK` steps of each of the `KINDS`, which take their blocks in turn."""
    sims = {name: square(side, water) for name, water in KINDS.items()}
    times = {name: [] for name in KINDS}
    for block in range(blocks + 1):
        for name, sim in sims.items():
            began = time.process_time()
            for _ in range(_BLOCK):
                sim.step()
            if block:  # the first one compiles
                times[name].append(time.process_time() - began)
    return {name: np.array(found) for name, found in times.items()}


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--side", type=int, default=100, help="points along an edge")
    parser.add_argument("--blocks", type=int, default=40, help="of steps, of each kind of water")
    arguments = parser.parse_args(words)
    side = arguments.side
    dry, undrained, flowing = (memory(square(side, KINDS[name])) for name in ("dry", "undrained", "flowing, a step"))
    passed, rained = (
        memory(square(side, KINDS["flowing, a step"], gravity=[0, -9.81],
                      boundaries={"open": {"where": {"body": "square"}, "water": kind}}))
        for kind in ({"pressure": 0}, {"rain": 1e-6})
    )  # fmt: skip
    print(f"memory: {dry:.0f} bytes a point dry, {undrained / dry:.3f} times that undrained, {flowing / dry:.3f} "
          f"flowing, {passed / dry:.3f} with a boundary that it passes, {rained / dry:.3f} in rain\n")  # fmt: skip
    print("| water | step over the dry one, median | quickest tenth |\n|---|---|---|")
    times = step_ratios(side, arguments.blocks)
    dry_times, tenth = times.pop("dry"), max(1, arguments.blocks // 10)
    for name, found in times.items():
        quickest = np.sort(found)[:tenth].mean() / np.sort(dry_times)[:tenth].mean()
        print(f"| {name} | {np.median(found / dry_times):.2f} | {quickest:.2f} |", flush=True)
    consolidate(side)


def consolidate(side):
    """Take a layer of side x side points to T = 1."""
    consolidation.layer(4, 1e3, consolidation.DEFAULT, 4).run()  # compiles
    sim = consolidation.layer(side // 2, 1e3, consolidation.DEFAULT, side)
    sim.start()

    def look(s):
        return s.particles.pore_pressure.mean() / 1e3

    began = time.process_time()
    moments, pressure = consolidation.Increments(look).follow(sim)
    took = time.process_time() - began
    late = moments > 0.05
    error = np.abs(1.0 - pressure - terzaghi(moments)[1])[late].max()
    iterations, points = sim.stages[0].settling.iterations, sim.particles.owned
    each = took / iterations / points
    flops, cache, main_memory = roofline.machine()
    work = moved = kernels = 0.0
    for name, (function, items, size) in roofline.kernels(sim).items():
        if name in _IN_AN_ITERATION:
            kernels += roofline.quickest(function) / points
            work += roofline.FLOPS[name][0] * items / points
            moved += size * items / points
    print(f"\n{points} points to T = 1: {took:.1f} s of processor, {sim.stages[0].increments} increments, "
          f"{sim.step_number} moves, {iterations} iterations; largest error of the degree {error:.4f}")  # fmt: skip
    print(f"an iteration: {each * 1e9:.0f} ns a point, its kernels {kernels * 1e9:.0f} ns, {work:.0f} flops and "
          f"{moved:.0f} bytes; at the peak of {flops / 1e9:.1f} Gflop/s {work / flops * 1e9:.0f} ns, from the second "
          f"cache ({cache / 1e9:.0f} GB/s) {moved / cache * 1e9:.0f} ns, from memory ({main_memory / 1e9:.0f} GB/s) "
          f"{moved / main_memory * 1e9:.0f} ns")  # fmt: skip
