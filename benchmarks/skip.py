"""What optional features cost, and that they cost nothing when they are off.

    python -m benchmarks skip [--side 100]

A square of Cam-Clay under its own stress is run for the same steps with and without each feature, in turn; the median
ratio of the processor times is its cost. "Off" is the time that the steps of a bare scene spend in its place in the
loop, in per cent of the step: nothing is tested for there, so this is what going through an empty list costs. Bare
is a scene that has none of the features, nor what every scene has if it does not say otherwise: the repulsion of
points that come too close, and the strains in the results. These two have rows of their own.

A second table is of what every step does to see trouble, or to keep the ledger, on a floor with contact: the shortest
of many calls, over the shortest step.
"""

import time
from functools import partial

import numpy as np
from mpi4py import MPI

from periporo.contact.repulsion import Repulsion
from periporo.core.motion.integrator import first_kick
from periporo.core.motion.pace import kick_within
from periporo.core.motion.rebuilds import neighbours_are_stale, refuse_breaches
from periporo.core.points.fields import StrainMeasures
from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene

from . import option_parser
from .library.blocks import MATERIALS

SOIL = MATERIALS["cam_clay"]
STEPS, STEP = 200, 0.5 / 160.0  # of the spacing over the wave speed
FLOOR = {"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.5}
FAR = {"type": "plane", "point": [-5, 0], "normal": [1, 0], "friction": 0.5}
HELD = {"base": {"where": {"upper": [None, 0.02]}, "fix": ["x", "y"]}}
FEATURES = {  # name -> (change of the input, the part of the step where it is at work)
    "gravity": ({"gravity": [0, -9.81]}, "loads"),
    "floor in contact": ({"contacts": [FLOOR]}, "contact"),
    "wall out of reach": ({"contacts": [FAR]}, "contact"),
    "fixed boundary": ({"boundaries": HELD}, "integration"),
    "pore water": ({"pore_water": {"suction": 500.0, "retention": {"set": "fitted"}}}, "point processes"),
    "water that flows": (
        {"pore_water": {"suction": 0, "drainage": "flowing", "conductivity": 1e-9}},
        "point processes",
    ),
    "viscous soil": ({"materials": {"soil": SOIL | {"viscosity": 1e9}}}, "material"),
    "dissipation in the ledger": ({"materials": {"soil": SOIL | {"report_dissipation": True}}}, "point processes"),
    "viscous damping": ({"stages": [{"damping": {"viscous": 1.0}}]}, "loads"),
    "inertia between neighbours": ({"time_step": {"added_inertia": 2}}, "added inertia"),
    "points that may sleep, and do not": ({"sleep": {"speed": 1e-9}}, "rebuild"),
}


EVERYWHERE = {  # name -> (class, the part of the step)
    "repulsion of close points": (Repulsion, "contact"),
    "strains in the results": (StrainMeasures, "point processes"),
}
GUARDS = {  # what a step does, and what it would do instead
    "look ahead where points are fast": (
        lambda sim: kick_within(sim, 0.0),
        lambda sim: first_kick(sim.particles, sim.forces, 0.0),
    ),
    "updates that laws refuse, or fail in": (
        lambda sim: (sim.bonds.refusals(), sim.bonds.failures(sim.particles.owned)),
        lambda sim: None,
    ),
    "points that moved far, or passed an obstacle": (
        lambda sim: (neighbours_are_stale(sim), refuse_breaches(sim)),
        lambda sim: None,
    ),
    "work of loads on faces": (
        lambda sim: (sim.forces.book_moments(0.0), sim.forces.book_moments(0.0)),
        lambda sim: None,
    ),
}


def square(side: int, change: dict) -> dict:
    """The input of the square, with a feature."""
    stage = {"name": "motion", "type": "dynamics", "duration": STEPS * STEP / side}
    scene = {
        "dimension": 2, "spacing": 1.0 / side, "materials": {"soil": SOIL},
        "bodies": [{"name": "square", "material": "soil",
                    "shape": {"type": "box", "lower": [0.0, 0.0], "upper": [1.0, 1.0]}}],
        "initial_stress": {"type": "uniform", "components": {"xx": -500.0, "yy": -800.0, "zz": -500.0}},
        "stages": [stage],
    } | change  # fmt: skip
    scene["time_step"] = {"fixed": STEP / side} | change.get("time_step", {})
    scene["stages"] = [stage | scene["stages"][0]]
    return scene


def run(scene: dict, without: tuple = ()) -> tuple[float, dict]:
    """Processor time of the stage, and the parts of its steps; parts of the classes `without` are taken out."""
    sim = build(parse_scene(scene), MPI.COMM_SELF)
    for parts in (sim.point_processes, sim.stages[0].contacts):
        parts[:] = [part for part in parts if not isinstance(part, without)]
    sim.start()
    sim.timing.reset()
    began = time.process_time()
    sim.run()
    return time.process_time() - began, sim.timing.seconds


def shortest(call, times: int = 300) -> float:
    """Seconds of the shortest of so many calls, which other work on the machine disturbs least."""
    seconds = []
    for _ in range(times):
        began = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - began)
    return min(seconds)


def guards(side: int) -> None:
    """Print what each guard takes of a step."""
    sim = build(parse_scene(square(side, {"gravity": [0, -9.81], "contacts": [FLOOR]})), MPI.COMM_SELF)
    sim.start()
    step = shortest(sim.step)
    print("\n| guard | % of the step |\n|---|---|")
    for name, both in GUARDS.items():
        cost, instead = (shortest(partial(call, sim)) for call in both)
        print(f"| {name} | {100 * (cost - instead) / step:.2f} |", flush=True)


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--side", type=int, default=100, help="points along an edge of the square")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--guards", action="store_true", help="only the second table")
    arguments = parser.parse_args(words)
    if not arguments.guards:
        features(arguments)
    guards(arguments.side)


def features(arguments) -> None:
    """Print what each feature costs."""
    plain = square(arguments.side, {})
    run(plain)
    rows = {name: (square(arguments.side, change), (), part) for name, (change, part) in FEATURES.items()}
    rows |= {name: (plain, kind, part) for name, (kind, part) in EVERYWHERE.items()}
    everywhere = tuple(kind for kind, _ in EVERYWHERE.values())
    print("| feature | on, % of the step | off, % |\n|---|---|---|")
    for name, (scene, taken_out, part) in rows.items():
        run(scene)  # compiles
        ratios, off = [], []
        for _ in range(arguments.repeats):
            without = run(plain, taken_out)[0]
            ratios.append(run(scene)[0] / without)
            parts = run(plain, everywhere)[1]
            off.append(parts.get(part, 0.0) / sum(parts.values()))
        always = part in ("integration", "material", "rebuild")
        idle = "part of the step" if always else f"{100 * np.median(off):.2f}"
        print(f"| {name} | {100 * (np.median(ratios) - 1.0):+.1f} | {idle} |", flush=True)
