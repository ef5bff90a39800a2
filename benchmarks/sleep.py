"""What it saves, and what it costs in accuracy, to let points at rest sleep: processor time against front and force.

    python -m benchmarks sleep                                        # the gallery's column, one draw
    python -m benchmarks sleep --scene slide --speeds 1e-3 1e-2 --seeds 0 1 2
    python -m benchmarks sleep --scene slide --speeds 1e-2 --spacing 2.5e-3 --until 0.04   # its begin, with many points

`column` is `column_collapse` of the gallery. In `slide` a column of dry sand beside a wall collapses on a bed of firm
soil, of which nine tenths stay at rest, against a second wall. Each row is a run: the bound `speed` (0: nobody sleeps),
the seed, processor time of the stage over that of the same seed without sleep, steps, the time at its end, mean share
of points asleep, run-out and height, kinetic energy set aside over the energy turned over, and for `slide` the impulse
and the largest force on the far wall, and the mean force on the plane behind column and bed. A seed other than 0 shakes
the lattice by 1e-9 m: what it changes is the scatter of a flow.
"""

import time

import numpy as np

import periporo
from periporo.io.input.examples import example_texts
from periporo.io.input.yaml_source import parse_yaml

from . import option_parser

SOIL = {
    "model": "drucker_prager", "density": 1800.0, "bulk_modulus": 25e6, "shear_modulus": 15e6, "cohesion": 0.0,
    "friction_angle": 30.0, "dilation_angle": 0.0,
}  # fmt: skip
BED, WALL = 0.1, 0.14  # m: depth of the bed, and place of the far wall
_HEAD = (
    "| speed, m/s | seed | time | steps | end, s | asleep | run-out, m | height, m | set aside | impulse, N s "
    "| force, N | behind, N |"
)


def slide(spacing: float = 5e-3) -> dict:
    """The column on its bed."""

    def body(name, material, lower, upper):
        return {"name": name, "material": material, "shape": {"type": "box", "lower": lower, "upper": upper}}

    wall = {"type": "box", "lower": [WALL, BED], "upper": [WALL + 0.05, BED + 0.3], "friction": 0.3}
    return {
        "dimension": 2, "spacing": spacing, "gravity": [0, -9.81],
        "materials": {"sand": SOIL, "firm": SOIL | {"cohesion": 5e3}},
        "bodies": [body("bed", "firm", [0.0, 0.0], [1.0, BED]), body("column", "sand", [0.0, BED], [0.08, BED + 0.12])],
        "initial_stress": {"type": "geostatic", "K0": 0.5},
        "boundaries": {"gate": {"where": {"lower": [0.075, BED], "body": "column"}, "fix": ["x"]}},
        "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.5},
                     {"type": "plane", "point": [0, 0], "normal": [1, 0], "friction": 0.0},
                     {"type": "plane", "point": [1, 0], "normal": [-1, 0], "friction": 0.0}, wall],
        "stages": [{"name": "settle", "type": "relax", "boundaries": ["gate"]},
                   {"name": "slide", "type": "dynamics", "duration": 0.6, "stop_when_at_rest": 1e-6}],
    }  # fmt: skip


def column(spacing: float = 2.5e-3) -> dict:
    """The gallery's column."""
    return parse_yaml(example_texts()["column_collapse"]).data | {"spacing": spacing}


SCENES = {"column": column, "slide": slide}


class Watch:
    """Sums of what happens in the last stage."""

    def __init__(self):
        self.asleep = self.impulse = self.force = self.behind = self.began = self.last = 0.0
        self.steps = 0

    def look(self, sim) -> None:
        """After every step."""
        if sim.stage_number == 0:
            self.began, self.last = time.process_time(), sim.time
            return
        p, n = sim.particles, sim.particles.owned
        self.steps += 1
        self.asleep += 1.0 - p.awake / n
        near = p.position[:n, 0] > WALL - 0.05
        push = -float(p.contact_force[:n][near & (p.position[:n, 1] > BED), 0].sum())
        self.impulse += push * (sim.time - self.last)
        self.behind += float(p.contact_force[:n][p.position[:n, 0] < sim.spacing, 0].sum()) * (sim.time - self.last)
        self.force, self.last = max(self.force, push), sim.time


def run(scene: dict, seed: int):
    """Run a scene; its watch, processor time (s) of the last stage, simulation."""
    sim = periporo.Simulation.from_scene(scene)
    n, watch = sim.particles.owned, Watch()
    if seed:
        sim.particles.position[:n] += 1e-9 * np.random.default_rng(seed).uniform(-1, 1, (n, 2))
    sim.call_every(1, watch.look)
    sim.run()
    return watch, time.process_time() - watch.began, sim


def main(words=None) -> None:
    """Print the table."""
    options = option_parser(__name__, __doc__)
    options.add_argument("--scene", choices=SCENES, default="column")
    options.add_argument("--speeds", type=float, nargs="+", default=[1e-3, 3e-3, 1e-2, 3e-2], help="m/s")
    options.add_argument("--spacing", type=float, nargs=1, default=[], help="m (default: 2.5e-3 and 5e-3)")
    options.add_argument("--until", type=float, default=None, help="s, of the last stage (default: all of it)")
    options.add_argument("--seeds", type=int, nargs="+", default=[0])
    chosen = options.parse_args(words)
    print(_HEAD + "\n" + "|---" * (_HEAD.count("|") - 1) + "|", flush=True)
    warm = SCENES[chosen.scene](*chosen.spacing) | {"sleep": {"speed": chosen.speeds[0]}}
    warm["stages"][-1] |= {"duration": 1e-4}
    run(warm, 0)  # compiles
    for seed in chosen.seeds:
        whole = 0.0
        for speed in (0.0, *chosen.speeds):
            scene = SCENES[chosen.scene](*chosen.spacing) | ({"sleep": {"speed": speed}} if speed else {})
            scene["stages"][-1] |= {"duration": chosen.until} if chosen.until else {}
            watch, seconds, sim = run(scene, seed)
            whole = whole or seconds
            p, n, entries = sim.particles, sim.particles.owned, sim.ledger.entries()
            moved = p.position[:n][p.body[:n] == p.body[:n].max()]  # the column, or all
            set_aside = entries.get("set_aside_energy", 0.0) / entries["external_work"]
            print(
                f"| {speed:g} | {seed} | {seconds / whole:.3f} | {watch.steps} | {sim.time:.3f} "
                f"| {watch.asleep / watch.steps:.2f} "
                f"| {np.quantile(np.abs(moved[:, 0]), 0.99):.4f} | {np.quantile(moved[:, 1], 0.99):.4f} "
                f"| {set_aside:.1e} | {watch.impulse:.4f} | {watch.force:.1f} "
                f"| {watch.behind / sim.time:.2f} |", flush=True,
            )  # fmt: skip
