"""Where the time of a collapse goes.

    python -m benchmarks shares [--steps 1500] [--scheme bond_projected]

The column of configs/column_collapse.yaml with 1600 and with 40 000 points, as in the middle of its fall: it is given
the velocity of a spreading deposit, half a metre per second at its edges. Laws and bond kernels against all the rest:
neighbours, contact, exchange, time step, loads and Python. Steps and spacings shrink alike, so that both move as far in
spacings.
"""

import importlib.resources

from mpi4py import MPI

from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene
from periporo.io.input.yaml_source import read_yaml

from . import option_parser
from .library.blocks import SCHEMES

KERNELS = ("strain", "material", "internal force")
SPEED, WIDTH, HEIGHT = 0.5, 0.05, 0.1  # m/s, m, m


def flowing(spacing: float, scheme: str):
    """The column in motion, in its second stage."""
    scene = read_yaml(importlib.resources.files("periporo.configs") / "column_collapse.yaml").data
    scene |= {"spacing": spacing, "boundaries": {}, "correspondence": SCHEMES[scheme]}
    scene["stages"] = [{"name": "collapse", "type": "dynamics", "duration": 1.0}]
    sim = build(parse_scene(scene), MPI.COMM_SELF)
    sim.start()
    p = sim.particles
    p.velocity[:, 0] = SPEED * p.position[:, 0] / WIDTH
    p.velocity[:, 1] = -SPEED * p.position[:, 1] / HEIGHT
    stage = sim.stages[0]
    sim.contacts, sim.loads = stage.contacts, stage.loads
    sim.apply_loads(0.0)
    return sim


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--steps", type=int, default=1500, help="of either column")
    parser.add_argument("--scheme", choices=SCHEMES, default="default")
    arguments = parser.parse_args(words)
    columns = []
    for spacing in (2.5e-3, 5e-4):
        sim = flowing(spacing, arguments.scheme)
        for _ in range(20):
            sim.step()
        sim.timing.reset()
        first, rebuilds = sim.step_number, sim.rebuild_count
        for _ in range(arguments.steps):
            sim.step()
        seconds = dict(sim.timing.seconds)
        total = sum(seconds.values())
        rest = total - sum(seconds[name] for name in KERNELS)
        parts = {name: 100 * value / total for name, value in seconds.items()}
        parts |= {"all but laws and bonds": 100 * rest / total}
        every = (sim.step_number - first) / max(1, sim.rebuild_count - rebuilds)
        cost = 1e6 * total / arguments.steps / sim.particles.owned
        columns.append((sim.particles.owned, parts, every, cost))
    print("| part, % | " + " | ".join(f"{points} points" for points, *_ in columns) + " |\n|---|---|---|")
    for name in columns[0][1]:
        print(f"| {name} | " + " | ".join(f"{parts.get(name, 0.0):.1f}" for _, parts, *_ in columns) + " |")
    print("| us per point and step | " + " | ".join(f"{cost:.2f}" for *_, cost in columns) + " |")
    print("| steps between rebuilds | " + " | ".join(f"{every:.0f}" for *_, every, _ in columns) + " |")
