"""Are volumes true and stress smooth where soil flows: columns of sand from lattice to rest.

    python -m benchmarks flow                       # three columns, H/dx = 20 and 40, one draw each; an hour
    python -m benchmarks flow --rows 20 --heights 0.1 --seeds 1 2 3 4
    python -m benchmarks flow --scheme '{"scheme": "point_state", "sharpened": true}'

A column of `--heights` (m) and a width of .1 m of isochoric, cohesionless Drucker-Prager sand (phi 30) collapses on a
rough floor. A row of the table is one output: area that the connected deposit covers over its first (a filled
outline), sum of its points' volumes over the first, first and last percentile of the points' volumes, scatter of the
vertical stress in soil that flows (shear rate above 3 1/s) and rests (below .3 1/s), run-out and height. A seed other
than 0 shakes the lattice by 1e-9 m: what it changes is the scatter that a chaotic flow has.
"""

import json
import math

import numpy as np

import periporo
from periporo.core.points import fields

from . import option_parser
from .library.deposits import connected, covered_area, scatter

WIDTH, DENSITY = 0.1, 1800.0
FLOWING, RESTING = 3.0, 0.3  # 1/s
_HEAD = "| H, m | H/dx | seed | t, s | steps | area | volumes | 1 % | 99 % | flow | rest | run-out | height | loose |"


def column(height: float, rows: int, duration: float, *, psi: float = 0.0, scheme=None) -> dict:
    """The scene of a column, m and s."""
    sand = {
        "model": "drucker_prager", "density": DENSITY, "bulk_modulus": 25e6, "shear_modulus": 15e6, "cohesion": 0.0,
        "friction_angle": 30.0, "dilation_angle": psi,
    }  # fmt: skip
    box = {"type": "box", "lower": [-0.5 * WIDTH, 0.0], "upper": [0.5 * WIDTH, height]}
    scene = {
        "dimension": 2, "spacing": height / rows, "gravity": [0, -9.81], "materials": {"sand": sand},
        "bodies": [{"name": "column", "material": "sand", "shape": box}],
        "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.5}],
        "stages": [{"name": "collapse", "type": "dynamics", "duration": duration}],
    }  # fmt: skip
    return scene | ({"correspondence": scheme} if scheme else {})


def measure(sim, height: float) -> dict[str, float]:
    """The figures of the present state of a column on this rank alone."""
    p, n = sim.particles, sim.particles.owned
    position, volume = p.position[:n], p.present_volume()
    own = connected(position, sim.spacing)
    share = volume[own] / p.volume[:n][own]
    stress = fields.values(sim, ["stress"])["stress"][:, 1]
    g = p.gradient[:n].reshape(-1, 2, 2)
    rate = np.hypot(g[:, 0, 0] - g[:, 1, 1], g[:, 0, 1] + g[:, 1, 0])
    least = 0.1 * DENSITY * 9.81 * height
    scatters = [
        scatter(position, stress, sim.spacing, own & chosen, least) for chosen in (rate > FLOWING, rate < RESTING)
    ]
    front = np.quantile(np.abs(position[own, 0]), 0.99)
    return {
        "time": sim.time, "steps": sim.step_number,
        "area": covered_area(position[own], sim.spacing) / p.volume[:n][own].sum(),
        "volumes": volume[own].sum() / p.volume[:n][own].sum(),
        "least volume": np.quantile(share, 0.01), "largest volume": np.quantile(share, 0.99),
        "scatter in flow": scatters[0], "scatter at rest": scatters[1],
        "run-out": (front - 0.5 * WIDTH) / (0.5 * WIDTH), "height": np.quantile(position[own, 1], 0.99) / height,
        "loose": int((~own).sum()),
    }  # fmt: skip


def collapse(scene: dict, height: float, times, seed: int = 0):
    """Run the column and yield its figures at `times` (s) and at the end; the simulation with them."""
    sim = periporo.Simulation.from_scene(scene)
    if seed:
        n = sim.particles.owned
        sim.particles.position[:n] += 1e-9 * np.random.default_rng(seed).uniform(-1, 1, (n, 2))
    left, found = list(times), []

    def look(sim):
        if left and sim.time >= left[0]:
            left.pop(0)
            found.append(measure(sim, height))

    sim.call_every(10, look)
    sim.run()
    found.append(measure(sim, height))
    return sim, found


def row(height: float, rows: int, seed: int, figures: dict) -> str:
    """A line of the table."""
    f = figures
    numbers = " | ".join(
        "" if math.isnan(f[name]) else f"{f[name]:.3f}"
        for name in ("area", "volumes", "least volume", "largest volume", "scatter in flow", "scatter at rest",
                     "run-out", "height")
    )  # fmt: skip
    return f"| {height:g} | {rows} | {seed} | {f['time']:.2f} | {f['steps']} | {numbers} | {f['loose']} |"


def main(words=None) -> None:
    """Print the table."""
    options = option_parser(__name__, __doc__)
    options.add_argument("--heights", type=float, nargs="+", default=[0.05, 0.1, 0.2], help="m")
    options.add_argument("--rows", type=int, nargs="+", default=[20, 40], help="points over the height")
    options.add_argument("--seeds", type=int, nargs="+", default=[0])
    options.add_argument("--psi", type=float, default=0.0, help="angle of dilation, degrees")
    options.add_argument("--scheme", type=json.loads, help="correspondence, as JSON; by default the program's")
    options.add_argument("--duration", type=float, default=0.6, help="s")
    chosen = options.parse_args(words)
    print(_HEAD + "\n" + "|---" * (_HEAD.count("|") - 1) + "|", flush=True)
    for height in chosen.heights:
        for rows in chosen.rows:
            for seed in chosen.seeds:
                scene = column(height, rows, chosen.duration, psi=chosen.psi, scheme=chosen.scheme)
                _, found = collapse(scene, height, (0.1, 0.2, 0.3), seed)
                for figures in found:
                    print(row(height, rows, seed, figures), flush=True)
