"""What a scene will cost, and what looks wrong about it, before it is run."""

import time

import numpy as np

from periporo.core.motion.timestep import highest_frequency
from periporo.core.numerics import jit
from periporo.core.ranks.reductions import maximum, minimum
from periporo.core.scene.build import build, output_names, vertical_axis
from periporo.core.scene.source import naming, read_everywhere

_SOFT = 0.05  # weight over bulk modulus


def check_scene(path, comm) -> int:
    """Build the scene and say what it will cost: points, bonds, memory, time step, steps, expected run time."""
    scene = read_everywhere(path, comm)
    with naming(path):
        sim = build(scene, comm)
        output_names(scene, sim)
    if not jit.cache_is_warm() and comm.rank == 0:
        print(jit.COMPILING, flush=True)
    sim.start()
    doubts = [*without_company(sim, scene), *_step_too_long(sim), *_too_soft(sim, scene), *_doubts_of_laws(sim, scene)]
    sim.step()  # the first one measures the stable time step
    began, trials = time.perf_counter(), 20
    for _ in range(trials):
        sim.step()
    seconds = comm.allreduce((time.perf_counter() - began) / trials) / comm.size
    points, pairs = comm.allreduce(sim.particles.owned), comm.allreduce(len(sim.bonds.pairs.first))
    duration = sum(getattr(stage, "duration", 0.0) for stage in sim.stages)
    steps = duration / sim.dt
    doubts += jit.remarks
    if comm.rank == 0:
        print(f"{path}: valid")
        print(f"  points        {points:,}, pairs {pairs:,}, on {comm.size} rank(s)")
        print(f"  memory        {comm.size * state_bytes(sim) / 1e6:.1f} MB of state")
        print(f"  time step     {sim.dt:.3g} s at the start")
        print(f"  motion        {duration:g} s, about {steps:,.0f} steps or more as the soil deforms")
        cost = seconds * 1e6 / max(points, 1)
        print(f"  run time      about {steps * seconds:,.0f} s at {cost:.2f} us per point and step")
        for line in _friction(scene):
            print(f"  friction      {line}")
        for doubt in doubts:
            print(f"  doubtful      {doubt}")
    return 0


def _step_too_long(sim) -> list[str]:
    """A remark on a fixed time step beyond the stability limit of the initial state."""
    fixed = sim.time_step.fixed
    if fixed is None:
        return []
    frequency = highest_frequency(sim)
    if not fixed * frequency > 2.0:
        return []
    return [f"the fixed time step of {fixed:.3g} s is longer than the stability limit of {2.0 / frequency:.3g} s"]


def _too_soft(sim, scene) -> list[str]:
    """A remark on soil that its own weight would compress by more than `_SOFT`."""
    p, weight = sim.particles, max(map(abs, scene.gravity or (0.0,)))
    up = p.position[: p.owned, vertical_axis(scene)]
    height = maximum(sim.comm, float(up.max(initial=-np.inf))) - minimum(sim.comm, float(up.min(initial=np.inf)))
    doubts = []
    for block in sim.bonds.blocks:
        bulk, _ = block.elastic_moduli()
        softest = minimum(sim.comm, float(bulk[block.active].min(initial=np.inf)))
        strain = block.material.density * weight * height / softest
        if strain > _SOFT:
            doubts.append(
                f"the weight of {height:.3g} m of soil is {strain:.2g} of the bulk modulus, {softest:.3g} Pa, of "
                f"material '{list(scene.materials)[block.index]}'; are its moduli in Pa?"
            )
    return doubts


def without_company(sim, scene) -> list[str]:
    """A remark on each body with points that have no regular company and so bear no stress."""
    p, n = sim.particles, sim.particles.owned
    alone = p.share[:n, 1] == 0.0
    remarks = []
    for k, body in enumerate(scene.bodies):
        mine = np.array([(alone & (p.body[:n] == k)).sum(), (p.body[:n] == k).sum()])
        count, points = (int(c) for c in sim.comm.allreduce(mine))
        if count:
            remarks.append(
                f"{count:,} of the {points:,} points of body '{body.name}' bear no stress: they stand alone, in a pair "
                "or in a row; make it two points thick or more, by a smaller spacing"
            )
    return remarks


def _friction(scene) -> list[str]:
    """The angles of friction that each law has in this scene's dimension, where it can tell."""
    laws = [(name, material.create()) for name, material in scene.materials.items()]
    frictional = [(name, law) for name, law in laws if hasattr(law, "friction_angles")]
    return [f"{name}: {law.friction_angles(scene.dimension)}" for name, law in frictional]


def _doubts_of_laws(sim, scene) -> list[str]:
    """What the laws find wrong with their parameters and rows; of several ranks the lowest that has a doubt speaks."""
    doubts = []
    for name, block in zip(scene.materials, sim.bonds.blocks, strict=True):
        found = {}
        if hasattr(block.material, "doubts"):
            found = block.material.doubts(block.stress[block.active], block.state[block.active])
        merged: dict[str, str] = {}
        for mine in reversed(sim.comm.allgather(found)):
            merged |= mine
        doubts += [f"material '{name}': {text}" for text in merged.values()]
    return doubts


def state_bytes(sim) -> int:
    """Bytes of the arrays of points, rows and pairs on this rank."""
    arrays = [getattr(sim.particles, name) for name in sim.particles.fields]
    for part in (*sim.bonds.carriers, sim.bonds.pairs, sim.bonds, sim.scheme):
        arrays += [value for value in vars(part).values() if isinstance(value, np.ndarray)]
    return sum(a.nbytes for a in {id(a): a for a in arrays}.values())
