"""Earth pressure on smooth walls against Rankine, from the histories of their forces.

    python -m benchmarks retaining_wall [--points 10 20] [--floors 0.6 0]

The scene configs/retaining_wall.yaml with that many points of height: the force on each wall, in the mean over the last
third of its way, over gamma H^2/2 K_a and K_p. With --floors the active wall alone, 2 m of sand before a wall that
stands, on floors of that friction: the points in the corner of the wedge stand on the floor, which takes about
friction gamma H times half a spacing of the thrust. With 10 points of height that is 0.856 against 1.042 on a smooth
floor; the deviation falls with the spacing.
"""

import importlib.resources

import numpy as np
from mpi4py import MPI

from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene
from periporo.io.input.yaml_source import read_yaml

from . import option_parser

G, HEIGHT = 9.81, 1.0


def _scene() -> dict:
    return read_yaml(importlib.resources.files("periporo.configs") / "retaining_wall.yaml").data


def active(points: int, floor: float) -> float:
    """Measured over Rankine's force of the active wall alone, on a floor of that friction."""
    scene = _scene()
    scene["bodies"][0]["shape"]["upper"][0] = 2.0
    scene["contacts"][0]["friction"] = floor
    scene["contacts"][2] = {"type": "plane", "point": [2, 0], "normal": [-1, 0], "friction": 0, "name": "passive"}
    return _measured(scene, points)["active"]


def thrusts(points: int) -> dict[str, float]:
    """Measured over Rankine's force of each wall."""
    return _measured(_scene(), points)


def _measured(scene, points):
    sim = build(parse_scene(scene | {"spacing": HEIGHT / points}), MPI.COMM_SELF)
    times, forces = [], {"active": [], "passive": []}

    def watch(sim):
        times.append(sim.time)
        for part in sim.reactions:
            if getattr(part, "name", None) in forces:
                forces[part.name].append(abs(part.histories(sim)[f"{part.name}_force_x"]))

    sim.call_every(5, watch)
    sim.run()
    sand = scene["materials"]["sand"]
    friction = np.radians(float(sand["friction_angle"]))
    weight = 0.5 * float(sand["density"]) * G * HEIGHT**2
    late = np.array(times) > 2.0 / 3.0 * times[-1]
    sign = {"active": -1.0, "passive": 1.0}
    exact = {name: weight * np.tan(0.25 * np.pi + 0.5 * s * friction) ** 2 for name, s in sign.items()}
    return {name: float(np.mean(np.array(forces[name])[late]) / exact[name]) for name in forces}


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--points", type=int, nargs="+", default=[10, 20], help="of height")
    parser.add_argument("--floors", type=float, nargs="+", help="frictions of floors below the active wall alone")
    arguments = parser.parse_args(words)
    if arguments.floors:
        print("| points of height | floor | active, / Rankine |\n|---|---|---|")
        for points in arguments.points:
            for floor in arguments.floors:
                print(f"| {points} | {floor:g} | {active(points, floor):.3f} |", flush=True)
        return
    print("| points of height | active, / Rankine | passive, / Rankine |\n|---|---|---|")
    for points in arguments.points:
        found = thrusts(points)
        print(f"| {points} | {found['active']:.3f} | {found['passive']:.3f} |", flush=True)
