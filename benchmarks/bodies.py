"""Bodies that touch: restitution, friction, sliding on an incline, rest for 10 s, and what contact does to the step.

    python -m benchmarks bodies [--only stack]

Each row is a figure, and what it must be. Discs of soft elastic soil meet at a speed that is slow against their waves,
head on and along a line at 30 degrees to their lattice; with friction they slide throughout, so that the impulse along
the faces is friction times that across them, as for rigid discs. A block slides down an incline whose lattice is along
the axes, so that its surface is a stair of points. Two bricks and one across their joint settle and stand for 10 s.
The bars of `python -m benchmarks restitution` have a table of their own. Ten minutes on one core.
"""

from collections.abc import Iterator

import numpy as np
from mpi4py import MPI

from periporo import Simulation

from . import option_parser

H = 0.025
SOFT = {"model": "elastic", "density": 1760.0, "bulk_modulus": 2.5e6, "shear_modulus": 1.5e6}
WAVE = np.sqrt(4.5e6 / 1760.0)


def scene(shapes, velocities=((0.0, 0.0), (0.0, 0.0)), friction=0.0, safety=0.8, duration=1.0, **keys) -> dict:
    """Bodies a, b, ... which may all touch."""
    bodies = [
        {"name": name, "material": "soil", "shape": shape, "velocity": list(velocity)}
        for name, shape, velocity in zip("abc", shapes, [*velocities, (0.0, 0.0)], strict=False)
    ]
    return {
        "dimension": 2, "spacing": H, "materials": {"soil": SOFT}, "bodies": bodies,
        "time_step": {"safety": safety}, "contacts": [{"type": "bodies", "between": "all", "friction": friction}],
        "stages": [{"name": "go", "type": "dynamics", "duration": duration}],
    } | keys  # fmt: skip


def simulation(scene: dict) -> Simulation:
    return Simulation.from_scene(scene, MPI.COMM_SELF)


def mean_velocity(sim, body: int) -> np.ndarray:
    p = sim.particles
    return p.velocity[p.body == body].mean(axis=0)


def met_discs(points, safety, along, velocity, friction) -> Simulation:
    """Disc b of `points` per radius has hit disc a, at rest, with `velocity` where their line is `along`."""
    radius = points * H
    discs = [{"type": "disc", "center": (k * (2.0 * radius + 0.01 * H) * along).tolist(), "radius": radius}
             for k in (0, 1)]  # fmt: skip
    sim = simulation(scene(discs, ((0.0, 0.0), velocity), friction, safety, 24.0 * radius / WAVE))
    sim.run()
    return sim


def restitution() -> Iterator[tuple[str, float, str, bool]]:
    """Of discs."""
    for points in (10, 20):
        for safety in (0.4, 0.8):
            for degrees in (0.0, 30.0):
                along = np.array([np.sin(np.radians(degrees)), np.cos(np.radians(degrees))])
                sim = met_discs(points, safety, along, -0.25 * along, 0.0)
                e = float((mean_velocity(sim, 1) - mean_velocity(sim, 0)) @ along / 0.25)
                what = f"restitution of discs: R/{points}, safety {safety}, along {degrees:.0f} degrees"
                yield what, e, "1.00 +- .02", abs(e - 1.0) <= 0.02


def friction() -> Iterator[tuple[str, float, str, bool]]:
    """In oblique impacts, against rigid discs."""
    along, across = np.array([0.0, 1.0]), np.array([1.0, 0.0])
    for coefficient, degrees in ((0.1, 30.0), (0.5, 75.0)):
        velocity = -0.02 * (along + np.tan(np.radians(degrees)) * across)
        impulse = mean_velocity(met_discs(20, 0.8, along, velocity, coefficient), 0)
        share = float(impulse @ across / (impulse @ along)) / coefficient
        yield f"impulse along over across faces, over friction {coefficient}", share, "1 +- .05", abs(share - 1) <= 0.05


def incline() -> Iterator[tuple[str, float, str, bool]]:
    """Impulse along over that across an incline, of a block on points along the axes, from .1 s on."""
    for degrees, coefficient in ((25.0, 0.2), (35.0, 0.5)):
        angle = np.radians(degrees)
        down, out = np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])
        corners = ([-down, down, down - 0.12 * out, -down - 0.12 * out],
                   [-0.15 * down, 0.15 * down, 0.15 * down + 0.1 * out, -0.15 * down + 0.1 * out])  # fmt: skip
        shapes = [{"type": "polygon", "vertices": [c.tolist() for c in of_one]} for of_one in corners]
        keys = {"gravity": [0.0, -9.81], "boundaries": {"fast": {"where": {"body": "a"}, "fix": ["x", "y"]}}}
        slope = scene(shapes, friction=coefficient, duration=0.3, **keys)
        slope["contacts"][0]["damping"] = 0.3
        slope["stages"][0]["boundaries"] = ["fast"]
        sim, seen = simulation(slope), []
        sim.call_every(1, lambda sim, seen=seen: seen.append((sim.time, *mean_velocity(sim, 1))))
        sim.run()
        seen = np.array(seen)
        change = seen[-1] - seen[np.searchsorted(seen[:, 0], 0.1)]
        impulse = change[1:] + np.array([0.0, 9.81]) * change[0]  # over the mass, of the contact
        share = float(-(impulse @ down) / (impulse @ out)) / coefficient
        yield (
            f"impulses on a block down {degrees:.0f} degrees, over {coefficient}",
            share,
            "1 +- .03",
            abs(share - 1) < 0.03,
        )


def stack() -> Iterator[tuple[str, float, str, bool]]:
    """Creep of three soft bricks."""
    h = 0.1
    boxes = [{"type": "box", "lower": low, "upper": high}
             for low, high in (([0, 0], [0.4, 0.3]), ([0.4, 0], [0.8, 0.3]), ([0.2, 0.3], [0.6, 0.6]))]  # fmt: skip
    bricks = scene(boxes, friction=0.5, spacing=h, gravity=[0.0, -9.81],
                   initial_stress={"type": "geostatic", "K0": 0.3})  # fmt: skip
    bricks["materials"] = {"soil": SOFT | {"bulk_modulus": 4e5, "shear_modulus": 2.4e5}}
    bricks["contacts"].append({"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.5})
    bricks["stages"] = [{"name": "settle", "type": "relax", "tolerance": 1e-6},
                        {"name": "stand", "type": "dynamics", "duration": 10.0}]  # fmt: skip
    sim, places = simulation(bricks), {}
    sim.call_every(1, lambda sim: places.setdefault(sim.stage_number, sim.particles.position.copy()))
    sim.run()
    way = float(np.abs(sim.particles.position - places[1]).max()) / h
    yield "way of a stack in 10 s, spacings", way, "<= 1e-4", way <= 1e-4


def step() -> Iterator[tuple[str, float, str, bool]]:
    """Of two blocks in contact over that of one alone."""
    boxes = [{"type": "box", "lower": [0, low], "upper": [0.2, low + 0.2]} for low in (0.0, 0.2)]
    sims = [simulation(scene(boxes[:1], contacts=[])), simulation(scene(boxes, friction=0.5))]
    for sim in sims:
        sim.start()
    share = sims[1].dt / sims[0].dt
    yield "step in contact over that without", share, ">= .90", share >= 0.9


PARTS = {part.__name__: part for part in (restitution, friction, incline, stack, step)}


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--only", choices=PARTS, help="one of the parts")
    arguments = parser.parse_args(words)
    print("| figure | found | must be | |\n|---|---|---|---|")
    missed = 0
    for name, part in PARTS.items():
        for what, found, target, met in part() if arguments.only in (None, name) else ():
            print(f"| {what} | {found:.4g} | {target} | {'met' if met else 'MISSED'} |", flush=True)
            missed += not met
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
