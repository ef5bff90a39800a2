"""Forces of flows on walls: sand on a chute against its thrust at rest, and mud against the theory of bores.

    python -m benchmarks flow_on_wall [--points 12] [--spacing M]

*chute*: the scene configs/flow_on_wall.yaml. The wall is smooth, so that the chute bears W cos(a), and friction f on it
is at most f times that: at rest the wall bears from W (sin(a) - f cos(a)) to W (sin(a) + f cos(a)). Figures are the
force in the mean over the last 0.2 s and the largest one, over W sin(a), and these bounds.

*bore*: nearly frictionless soil, h deep, that moves at sqrt(g h) on a smooth floor from the start on against a wall. It
piles up to the depth H, and its front runs back as a bore; mass and momentum (Stoker 1957) give

    (H - h)^2 (H + h) / (2 h H) = v^2 / (g h),  force = rho g H^2 / 2.

Figures are the force in the mean from 2 to 4.5 sqrt(h/g), and over all of the time before, over it.
"""

import importlib.resources

import numpy as np
from scipy.optimize import brentq

from periporo import Simulation
from periporo.io.input.yaml_source import read_yaml

from . import option_parser

GRAVITY, DENSITY, DEPTH, LENGTH = 9.81, 1800.0, 0.1, 1.4
MUD = {"model": "drucker_prager", "density": DENSITY, "bulk_modulus": 2.5e6, "shear_modulus": 1.5e6, "cohesion": 0.0,
       "friction_angle": 1.0, "dilation_angle": 0.0}  # fmt: skip


def force_history(sim: Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) s of a whole run, and forces (n,) N on the obstacle `wall` in x."""
    wall = next(part for part in sim.reactions if part.name == "wall")
    rows = []
    sim.call_every(5, lambda sim: rows.append((sim.time, wall.histories(sim)["wall_force_x"])))
    sim.run()
    return tuple(np.array(rows).T)


def chute(spacing: float | None = None) -> dict[str, float]:
    """Figures of the scene, at another `spacing` (m) if one is given."""
    scene = read_yaml(importlib.resources.files("periporo.configs") / "flow_on_wall.yaml").data
    sim = Simulation.from_scene(scene if spacing is None else scene | {"spacing": spacing})
    weight = sim.particles.mass.sum() * np.hypot(*scene["gravity"])
    time, force = force_history(sim)
    downhill, friction = weight * np.sin(np.pi / 4), float(scene["contacts"][0]["friction"])
    late = force[time > time[-1] - 0.2].mean() / downhill
    return {"at rest": late, "lower bound": 1.0 - friction, "upper bound": 1.0 + friction,
            "largest": force.max() / downhill}  # fmt: skip


def bore_depth(froude: float) -> float:
    """H/h of the bore that a flow of that Froude number leaves behind."""
    return brentq(lambda r: (r - 1.0) ** 2 * (r + 1.0) / (2.0 * r) - froude**2, 1.0 + 1e-9, 100.0)


def bore(points: int) -> dict[str, float]:
    """Figures of a flow of as many points in depth, of Froude number 1."""
    unit = np.sqrt(DEPTH / GRAVITY)
    shape = {"type": "box", "lower": [0.0, 0.0], "upper": [LENGTH, DEPTH]}
    sim = Simulation.from_scene({
        "dimension": 2, "spacing": DEPTH / points, "gravity": [0.0, -GRAVITY], "materials": {"mud": MUD},
        "bodies": [{"name": "mud", "material": "mud", "shape": shape, "velocity": [np.sqrt(GRAVITY * DEPTH), 0.0]}],
        "initial_stress": {"type": "geostatic", "K0": 1.0},
        "contacts": [
            {"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.0, "damping": 0.2},
            {"type": "plane", "name": "wall", "point": [LENGTH, 0], "normal": [-1, 0], "friction": 0.0, "damping": 0.2},
        ],
        "stages": [{"name": "flow", "type": "dynamics", "duration": float(4.5 * unit)}],
    })  # fmt: skip
    time, force = force_history(sim)
    exact = 0.5 * DENSITY * GRAVITY * (bore_depth(1.0) * DEPTH) ** 2
    late = time > 2.0 * unit
    return {"late": force[late].mean() / exact, "all": force.mean() / exact}


def main(words=None):
    """Print both tables."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--points", type=int, nargs="+", default=[12], help="of the depth of the bore")
    parser.add_argument("--spacing", type=float, help="m, of the points on the chute")
    arguments = parser.parse_args(words)
    print("| points of depth | force of the bore, late, over the exact one | in the mean of all times |\n|---|---|---|")
    for points in arguments.points:
        print(f"| {points} | " + " | ".join(f"{value:.3f}" for value in bore(points).values()) + " |", flush=True)
    figures = chute(arguments.spacing)
    print("| chute: " + " | ".join(figures) + " |" + "\n" + "|---" * len(figures) + "|")
    print("| " + " | ".join(f"{value:.3f}" for value in figures.values()) + " |")
