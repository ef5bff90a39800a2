"""Force on a pile that is pushed into undrained clay, against its bearing capacity.

    python -m benchmarks pile [--points 4 6]

The scene configs/pile.yaml with that many points of radius: the force less the weight of the clay that the pile has
displaced, over base and undrained strength, in the mean over a third of a spacing of the way about depths over the
radius. At the surface the factor is 5.69 for a smooth base (Shield 1955); Skempton (1951) gives
6 (1 + 0.2 depth/diameter) for piles of circular base as they go deeper.
"""

import importlib.resources

import numpy as np

from periporo import Simulation
from periporo.io.input.yaml_source import read_yaml

from . import option_parser

SURFACE = 5.69
DEPTHS = (0.1, 0.2, 0.3, 0.6, 0.9)  # over the radius


def skempton(depth):
    """Factor at a depth (over the radius)."""
    return 6.0 * (1.0 + 0.1 * np.asarray(depth))


def push(points: int, deepest: float = 1.0) -> np.ndarray:
    """Depths over the radius, and factors, (steps, 2)."""
    scene = read_yaml(importlib.resources.files("periporo.configs") / "pile.yaml").data
    clay, pile = scene["materials"]["clay"], scene["contacts"][1]
    radius, strength = pile["upper"][0], float(clay["cohesion"])
    spacing = radius / points
    scene["spacing"] = spacing
    scene["boundaries"]["far"]["where"]["lower"] = [5.0 * radius - spacing, None]
    scene["boundaries"]["base"]["where"]["upper"] = [None, spacing - 5.0 * radius]
    scene["stages"][0]["duration"] = 0.1 + deepest * radius / 0.15
    sim = Simulation.from_scene(scene)
    (part,) = (part for part in sim.reactions if getattr(part, "name", "") == "pile")
    rows = []

    def look(sim):
        told = part.histories(sim)
        depth = -told["pile_displacement_y"]
        weight = np.pi * radius**2 * depth * float(clay["density"]) * 9.81
        rows.append((depth / radius, (told["pile_force_y"] - weight) / (np.pi * radius**2 * strength)))

    sim.call_every(5, look)
    sim.run()
    return np.array(rows)


def factors(history: np.ndarray, points: int, depths=DEPTHS) -> list[float]:
    """Mean factors about the `depths`."""
    near = [np.abs(history[:, 0] - depth) < 0.5 / points / 3.0 for depth in depths]
    return [float(history[rows, 1].mean()) for rows in near]


def main(words=None):
    """Print the table."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--points", type=int, nargs="+", default=[4, 6], help="of the radius")
    arguments = parser.parse_args(words)
    print("| depth / radius | " + " | ".join(f"{d:g}" for d in DEPTHS) + " |\n" + "|---" * (len(DEPTHS) + 1) + "|")
    print("| Skempton | " + " | ".join(f"{n:.2f}" for n in skempton(DEPTHS)) + " |")
    for points in arguments.points:
        found = factors(push(points), points)
        print(f"| {points} points | " + " | ".join(f"{n:.2f}" for n in found) + " |", flush=True)
