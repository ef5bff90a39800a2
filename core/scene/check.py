"""What a scene will cost, and what looks wrong about it, before it is run."""

import time

import numpy as np

from periporo.core.bonds.bonds import RefusedStep
from periporo.core.numerics import jit
from periporo.core.scene.build import build, output_names
from periporo.core.scene.doubts import doubts_about
from periporo.core.scene.fields import ParameterFields
from periporo.core.scene.source import naming, read_everywhere
from periporo.errors import SCREEN_LINES, SCREEN_WIDTH, ContactError
from periporo.io.output.terminal import say
from periporo.io.schema.stages import STILL

_TRIALS = 20  # steps


def check_scene(path, comm) -> int:
    """Build the scene and say what it will cost: points, bonds, memory, time step, steps, expected run time.

    The exit status: 0, or 3 if a contact ends the first steps, as it would end a run.
    """
    scene = read_everywhere(path, comm)
    with naming(path):
        sim = build(scene, comm)
        output_names(scene, sim)
        if not jit.cache_is_warm() and comm.rank == 0:
            say(jit.COMPILING)
        sim.start()
    doubts, fields = doubts_about(scene, sim), _fields(sim)
    sim.rate_independent = all(stage.type in STILL for stage in scene.stages)
    seconds, ended, refused = _try_steps(sim)
    points, pairs = comm.allreduce(sim.particles.owned), comm.allreduce(len(sim.bonds.pairs.first))
    slow = sum(stage.duration for stage in scene.stages if stage.type == "quasi_static")
    duration = sum(getattr(stage, "duration", 0.0) for stage in sim.stages) - slow
    steps = duration / sim.dt
    if comm.rank == 0:
        cost = seconds * 1e6 / max(points, 1)
        facts = [
            ("points", f"{points:,}, pairs {pairs:,}, on {comm.size} rank(s)"),
            ("memory", f"{comm.size * state_bytes(sim) / 1e6:.1f} MB of state"),
            ("time step", f"{sim.dt:.3g} s at the start"),
            *_flow_and_motion(slow, duration, steps),
            ("run time", f"about {steps * seconds:,.0f} s at {cost:.2f} us per point and step"),
            *(("friction", line) for line in _friction(scene, sim.materials)),
            *(("field", line) for line in fields),
        ]
        say("\n".join([f"{path}: valid", *_screen(facts, [*ended, *refused, *doubts])]))
    return 3 if ended else 0


def _try_steps(sim) -> tuple[float, list[str], list[str]]:
    """Time of a step, s, over ranks; what ends a run within the first ones; what laws refuse; the same on all ranks."""
    done, began, ended, refused = 0, time.perf_counter(), [], []
    try:
        sim.step()  # measures the stable time step
        began = time.perf_counter()
        while done < _TRIALS:
            sim.step()
            done += 1
    except RefusedStep as refusal:  # a run takes it back; what is left of the state is not looked at any more
        refused = [f"a law refuses step {sim.step_number} ({refusal.reason}): a run tries half of it"]
    except ContactError as error:
        ended = [f"a run ends after {sim.step_number} steps: {error}"]
    seconds = (time.perf_counter() - began) / max(done, 1)
    return sim.comm.allreduce(seconds) / sim.comm.size, ended, refused


def _flow_and_motion(slow, duration, steps) -> list[tuple[str, str]]:
    """What the stages take in which water flows in equilibrium, and those of motion."""
    flow = [("equilibrium", f"{slow:g} s of flow, in increments of its accuracy; they are not in the run time")]
    motion = [("motion", f"{duration:g} s, about {steps:,.0f} steps or more as the soil deforms")]
    return (flow if slow > 0.0 else []) + (motion if duration > 0.0 or slow == 0.0 else [])


def _screen(facts, doubts) -> list[str]:
    """The facts, and as many doubts, of which the first are the worst, as one screen holds."""
    lines = [f"  {name:14s}{text}" for name, text in facts]
    room = SCREEN_LINES - 1 - sum(map(_height, lines))
    for shown, doubt in enumerate(doubts):
        line = f"  {'doubtful':14s}{doubt}"
        room -= _height(line)
        if shown and room < 1:
            return [*lines, f"  and {len(doubts) - shown} more doubts"]
        lines.append(line)
    return lines


def _height(line: str) -> int:
    """Lines of a screen that a line of text takes."""
    return -(-len(line) // SCREEN_WIDTH)


def _fields(sim) -> list[str]:
    """The range of each parameter that varies; collective."""
    processes = [process for process in sim.point_processes if isinstance(process, ParameterFields)]
    found = [entry for process in processes for entry in process.ranges(sim)]
    return [f"{material}, {name}: {low:.4g} to {high:.4g} at {n:,} points" for material, name, low, high, n in found]


def _friction(scene, laws) -> list[str]:
    """The angles of friction that each of the laws has in this scene's dimension, where it can tell."""
    named = zip(scene.materials, laws, strict=True)
    d = 3 if scene.axisymmetric else scene.dimension
    return [f"{name}: {law.friction_angles(d)}" for name, law in named if hasattr(law, "friction_angles")]


def state_bytes(sim) -> int:
    """Bytes of the arrays of points, rows and pairs on this rank."""
    arrays = [a for name in sim.particles.fields if (a := getattr(sim.particles, name)).flags.writeable]
    for part in (*sim.bonds.carriers, sim.bonds.pairs, sim.bonds, sim.scheme):
        arrays += [value for value in vars(part).values() if isinstance(value, np.ndarray)]
    return sum(a.nbytes for a in {id(a): a for a in arrays}.values())
