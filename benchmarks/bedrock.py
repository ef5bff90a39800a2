"""Sand over rock that is a hundred times as stiff: what may be taken for the rock, so that steps are the sand's.

    python -m benchmarks bedrock
    python -m benchmarks bedrock --seeds 0 1 2 --rocks "as it is" "density x 16"

The rock sets the step of the whole scene, ten times shorter than the sand's. A column of sand collapses on a slab of
it. Each row is a run with another rock: processor time and steps over those with the rock as it is and the same seed,
the 99th percentiles of the sand's distance and height at the end, the energy that its weight gave, and how far the
rock's surface gave way under the column at most. A seed other than 0 shakes the lattice by 1e-9 m: what it changes is
the scatter.
"""

import time

import numpy as np

import periporo

from . import option_parser

SAND = {
    "model": "drucker_prager", "density": 1800.0, "bulk_modulus": 2.5e6, "shear_modulus": 1.5e6, "cohesion": 0.0,
    "friction_angle": 30.0, "dilation_angle": 0.0,
}  # fmt: skip
ROCK = {"model": "elastic", "density": 2200.0, "bulk_modulus": 250e6, "shear_modulus": 150e6}
SLAB, WIDTH, HEIGHT = 0.05, 0.1, 0.1  # m: depth of the rock, and the column
VARIANTS = {
    "as it is": {}, "moduli / 4": {"softer": 4.0}, "moduli / 16": {"softer": 16.0}, "moduli / 50": {"softer": 50.0},
    "density x 4": {"heavier": 4.0}, "density x 16": {"heavier": 16.0}, "density x 50": {"heavier": 50.0},
    "moduli / 4, density x 4": {"softer": 4.0, "heavier": 4.0},
    "moduli / 2, density x 16": {"softer": 2.0, "heavier": 16.0},
    "added inertia, 2 rounds": {"rounds": 2}, "rigid": {"rigid": True},
}  # fmt: skip


def rock(softer: float = 1.0, heavier: float = 1.0) -> dict:
    """The rock with other moduli and another density."""
    moduli = {name: ROCK[name] / softer for name in ("bulk_modulus", "shear_modulus")}
    return ROCK | moduli | {"density": heavier * ROCK["density"]}


def box(name, material, lower, upper) -> dict:
    """A body."""
    return {"name": name, "material": material, "shape": {"type": "box", "lower": lower, "upper": upper}}


def column(rigid: bool = False, rounds: int = 0, **other) -> dict:
    """A column that collapses on the slab, or on the rough plane of its surface."""
    scene = {
        "dimension": 2, "spacing": 5e-3, "gravity": [0, -9.81], "materials": {"sand": SAND},
        "bodies": [box("column", "sand", [-WIDTH / 2, 0.0], [WIDTH / 2, HEIGHT])],
        "initial_stress": {"type": "geostatic", "K0": 0.5},
        "contacts": [{"type": "plane", "point": [0, -(0 if rigid else SLAB)], "normal": [0, 1], "friction": 0.577}],
        "stages": [{"name": "collapse", "type": "dynamics", "duration": 0.35}],
        "time_step": {"added_inertia": rounds},
    }  # fmt: skip
    if not rigid:
        scene["materials"]["rock"] = rock(**other)
        scene["bodies"].append(box("slab", "rock", [-0.25, -SLAB], [0.25, 0.0]))
    return scene


def run(scene: dict, seed: int) -> list[float]:
    """Seconds, steps, and what sand and rock did."""
    sim = periporo.Simulation.from_scene(scene)
    p, n = sim.particles, sim.particles.owned
    p.position[:n] += 1e-9 * np.random.default_rng(seed).uniform(-1, 1, (n, 2)) * bool(seed)
    sim.start()
    began = time.process_time()
    sim.run()
    seconds, sand = time.process_time() - began, p.body[:n] == 0
    x, way = p.position[:n], (p.position[:n] - p.initial_position[:n])[:, 1]
    given = -9.81 * float((p.mass[:n] * way)[sand].sum())
    sunk = -float(way[~sand].min(initial=0.0))
    quantiles = [float(np.quantile(values, 0.99)) for values in (np.abs(x[sand, 0]), x[sand, 1])]
    return [seconds, sim.step_number, *quantiles, given, sunk]


def main(words=None) -> None:
    """Print the table."""
    options = option_parser(__name__, __doc__)
    options.add_argument("--seeds", type=int, nargs="+", default=[0])
    options.add_argument("--rocks", nargs="+", choices=VARIANTS, default=list(VARIANTS), metavar="NAME")
    chosen = options.parse_args(words)
    print("| rock | seed | time | steps | run-out, m | height, m | J/m | sinks, m |\n" + "|---" * 8 + "|", flush=True)
    for seed in chosen.seeds:
        first = None
        for name in chosen.rocks:
            seconds, steps, *found = run(column(**VARIANTS[name]), seed)
            first = first or (seconds, steps)
            shown = " | ".join(f"{value:.4g}" for value in found)
            print(f"| {name} | {seed} | {seconds / first[0]:.3f} | {steps / first[1]:.3f} | {shown} |", flush=True)
