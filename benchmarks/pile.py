"""Force on a pile, or a cone, that is pushed into undrained clay, against its bearing capacity.

    python -m benchmarks pile [--points 4 6 8] [--sharp] [--cone]

The scene configs/pile.yaml with that many points of radius: the force less the weight of the clay that the pile has
displaced, over strength and base, as wide as that is in the clay, in the mean over a third of a spacing of the way
about depths over the radius. At the surface the factor is 5.69 for a smooth base (Shield 1955); Skempton (1951) gives
6 (1 + 0.2 depth/diameter) for piles of circular base that are in place, as they lie deeper.

With --sharp the edge of the base is not round: a ring of points that passes it is carried by the base until its middle
has passed, so that the base acts as if it were half a spacing wider.

With --cone a smooth cone of 60 degrees goes 13 radii deep, in clay 24 radii wide and deep; means are over a radius of
the way. Far below the surface theory gives (1.67 + G/s_u/1500) (1 + ln(G/s_u)), 9.73 here (Teh & Houlsby 1991).
"""

import importlib.resources

import numpy as np

from periporo import Simulation
from periporo.io.input.yaml_source import read_yaml

from . import option_parser

SURFACE, DEEP_CONE = 5.69, 9.73
DEPTHS = (0.1, 0.2, 0.3, 0.6, 0.9)  # over the radius
CONE_DEPTHS = (2.0, 4.0, 6.0, 8.0, 10.0, 12.0)
SPEED, RAMP = 0.15, 0.2  # m/s; s, in which the scene gets up to it


def skempton(depth):
    """Factor at a depth (over the radius)."""
    return 6.0 * (1.0 + 0.1 * np.asarray(depth))


def push(points: int, deepest: float = 1.0, sharp: bool = False) -> np.ndarray:
    """Depths over the radius of the pile of the scene, and factors, (steps, 2)."""
    scene = _scene()
    vertices = np.array(scene["contacts"][1]["vertices"], float)
    radius = float(vertices[:, 0].max())
    edge = 0.0 if sharp else float(vertices[vertices[:, 0] == radius, 1].min())
    if sharp:
        scene["contacts"][1] |= {"type": "box", "lower": [-radius, 0.0], "upper": [radius, 2.0]}
        del scene["contacts"][1]["vertices"]

    def wide(depth):  # of the base
        missing = np.maximum(edge - depth, 0.0)
        return radius - edge + np.sqrt(edge**2 - missing**2)

    return _factors(_prepared(scene, points, radius, deepest, clay=5.0), radius, wide)


def push_cone(points: int, deepest: float = 13.0, clay: float = 24.0) -> np.ndarray:
    """The same of a cone of 60 degrees, with the radius of the pile, in clay so many radii wide and deep."""
    scene, radius = _scene(), 0.3
    scene["contacts"][1] |= {"type": "wedge", "tip": [0, 0], "width": 2.0 * radius, "angle": 60.0, "length": 6.0}
    del scene["contacts"][1]["vertices"]
    scene["contacts"][1]["velocity"]["y"]["values"] = [0.0, -2.0 * SPEED]
    return _factors(_prepared(scene, points, radius, 0.5 * deepest, clay), radius, lambda depth: radius)


def _scene() -> dict:
    return read_yaml(importlib.resources.files("periporo.configs") / "pile.yaml").data


def _prepared(scene, points, radius, deepest, clay):
    """The scene with `points` of the radius, clay so many radii wide and deep, and a way of `deepest` radii."""
    spacing, size = radius / points, clay * radius
    scene["spacing"] = spacing
    scene["bodies"][0]["shape"] |= {"lower": [0, -size], "upper": [size, 0]}
    scene["boundaries"]["far"]["where"]["lower"] = [size - spacing, None]
    scene["boundaries"]["base"]["where"]["upper"] = [None, spacing - size]
    scene["stages"][0]["duration"] = 0.5 * RAMP + deepest * radius / SPEED
    return scene


def _factors(scene, radius, wide):
    clay = scene["materials"]["clay"]
    sim = Simulation.from_scene(scene)
    (part,) = (part for part in sim.reactions if getattr(part, "name", "") == "pile")
    rows = []

    def look(sim):
        told = part.histories(sim)
        rows.append((-told["pile_displacement_y"], told["pile_force_y"]))

    sim.call_every(5, look)
    sim.run()
    depth, force = np.array(rows).T
    base = np.pi * wide(depth) ** 2
    weight = base * depth * float(clay["density"]) * 9.81
    return np.column_stack([depth / radius, (force - weight) / (base * float(clay["cohesion"]))])


def factors(history: np.ndarray, depths, width: float) -> list[float]:
    """Mean factors over a `width` about the `depths`, all over the radius."""
    near = [np.abs(history[:, 0] - depth) < 0.5 * width for depth in depths]
    return [float(history[rows, 1].mean()) for rows in near]


def main(words=None):
    """Print the table."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--points", type=int, nargs="+", default=[4, 6], help="of the radius")
    parser.add_argument("--sharp", action="store_true", help="a base with a sharp edge")
    parser.add_argument("--cone", action="store_true", help="a cone of 60 degrees")
    arguments = parser.parse_args(words)
    depths = CONE_DEPTHS if arguments.cone else DEPTHS
    print("| depth / radius | " + " | ".join(f"{d:g}" for d in depths) + " |\n" + "|---" * (len(depths) + 1) + "|")
    if not arguments.cone:
        print("| Skempton | " + " | ".join(f"{n:.2f}" for n in skempton(depths)) + " |")
    for points in arguments.points:
        if arguments.cone:
            found = factors(push_cone(points), depths, 1.0)
        else:
            found = factors(push(points, sharp=arguments.sharp), depths, 1.0 / points / 3.0)
        print(f"| {points} points | " + " | ".join(f"{n:.2f}" for n in found) + " |", flush=True)
