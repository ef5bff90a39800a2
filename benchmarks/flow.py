"""Are volumes true and stress smooth where soil flows: columns of sand from lattice to rest.

    python -m benchmarks flow                       # three columns, H/dx = 20 and 40, one draw each; an hour
    python -m benchmarks flow --rows 20 --heights 0.1 --seeds 1 2 3 4
    python -m benchmarks flow --scheme '{"scheme": "point_state", "sharpened": true}'
    python -m benchmarks flow --rows 20 --heights 0.1 --turned 30 --at 500000 4000000
    python -m benchmarks flow --rows 20 40 80 --heights 0.1 --bulk 2.5e6 --figure docs/figures/flow.png
    python -m benchmarks flow --rows 20 --heights 0.1 --bulk 2.5e6 --thick 4  # in space
    python -m benchmarks flow --rows 20 40 80 --heights 0.2 --bulk 2.5e6 --energies

A column of `--heights` (m) and a width of .1 m of isochoric, cohesionless Drucker-Prager sand (`--phi` 30 degrees)
collapses on a rough floor. A row is one output: area that the connected deposit covers over its first (a filled
outline); *inside*: the area of Voronoi cells more than 2.5 spacings beneath that outline over their volume; sum of the
points' volumes over the first; first and last percentile of the points' volumes; scatter of the vertical stress in soil
that flows (shear rate above 3 1/s) and rests (below .3 1/s); run-out and height. A seed other than 0 shakes the lattice
by 1e-9 m: what it changes is the scatter that a chaotic flow has. With `--thick` the column is a slab in space, so many
points thick, between planes of symmetry: it should do what plane strain does. Areas are those of its points seen from
the side.

Run-out is how far beyond the column the cells of 99 % of all its soil reach, over the half-width, and height is the top
of the cells of 99 % of the connected soil. *core* is the area over the first of soil that has sheared by .1 to .5, told
by the lattice's neighbours. Loose grains at the front are soil, too: a coarse front comes apart into
more of them. *internal* is the least internal energy so far over the potential energy of the column. With `--energies`
a row is what motion has, and what viscosity, exchange, rearrangement and friction on the floor have taken, over that.
"""

import json
import math
import tempfile
from pathlib import Path

import numpy as np

import periporo
from periporo.core.points import fields

from . import option_parser
from .library.deposits import cells, connected, covered_area, grown, profile, scatter

WIDTH, DENSITY = 0.1, 1800.0
FLOWING, RESTING = 3.0, 0.3  # 1/s
CORE = 0.1, 0.5  # shear strain of soil that still has its neighbours
_UPRIGHT = np.eye(2)
_HEAD = (
    "| H, m | H/dx | seed | t, s | steps | area | inside | core | volumes | 1 % | 99 % | flow | rest | run-out "
    "| height | loose | internal |"
)
_ENERGIES = (
    "kinetic_energy", "viscous_dissipation", "exchange_dissipation", "rearrangement_work", "friction_dissipation",
)  # fmt: skip


def column(
    height: float, rows: int, duration: float, *, bulk: float = 25e6, thick: int = 0, scheme=None, **law
) -> dict:
    """The scene of a column, m and s, of sand with a `bulk` modulus in Pa; `law` holds more of its parameters.

    In plane strain, or as a slab in space that is `thick` points wide, between planes of symmetry.
    """
    sand = {
        "model": "drucker_prager", "density": DENSITY, "bulk_modulus": bulk, "shear_modulus": 0.6 * bulk,
        "cohesion": 0.0, "friction_angle": 30.0, "dilation_angle": 0.0, "match": "plane_strain",
    } | law  # fmt: skip
    across, width = ([0.0], [thick * height / rows]) if thick else ([], [])
    box = {"type": "box", "lower": [-0.5 * WIDTH, 0.0, *across], "upper": [0.5 * WIDTH, height, *width]}
    scene = {
        "dimension": 2 + len(across), "spacing": height / rows, "gravity": [0.0, -9.81, *across],
        "materials": {"sand": sand}, "bodies": [{"name": "column", "material": "sand", "shape": box}],
        "contacts": [{"type": "plane", "point": [0.0, 0.0, *across], "normal": [0.0, 1.0, *across], "friction": 0.5}],
        "stages": [{"name": "collapse", "type": "dynamics", "duration": duration}],
    }  # fmt: skip
    if thick:
        scene["symmetry"] = {"lower": [None, None, 0.0], "upper": [None, None, *width]}
    return scene | ({"correspondence": scheme} if scheme else {})


def turned(scene: dict, rotation: np.ndarray, place, folder: str) -> dict:
    """The scene turned by `rotation` (2, 2) about the middle of its floor, which then is at `place` (2,) m.

    A lattice is level, so the points are written to `folder`.
    """
    (body,), (floor,), spacing = scene["bodies"], scene["contacts"], scene["spacing"]
    lower, upper = (np.array(body["shape"][end]) for end in ("lower", "upper"))
    axes = (np.arange(k) for k in np.rint((upper - lower) / spacing).astype(int))
    points = lower + (np.stack(np.meshgrid(*axes), -1).reshape(-1, 2) + 0.5) * spacing
    file = Path(folder) / "points.csv"
    np.savetxt(file, points @ rotation.T + place, delimiter=",", header="x,y", comments="", fmt="%.17g")
    return scene | {
        "gravity": (rotation @ scene["gravity"]).tolist(),
        "bodies": [body | {"shape": {"type": "points", "file": str(file)}}],
        "contacts": [floor | {"point": list(place), "normal": (rotation @ floor["normal"]).tolist()}],
    }


def seen(sim, rotation, place) -> np.ndarray:
    """Positions (n, d) m in axes that were `turned` with the scene."""
    shift = np.array(sim.origin)
    shift[:2] -= place
    position = sim.particles.position[: sim.particles.owned] + shift
    position[:, :2] = position[:, :2] @ rotation
    return position


def measure(sim, height: float, rotation=_UPRIGHT, place=(0.0, 0.0)) -> dict[str, float]:
    """The figures of the present state of a column on this rank alone, which was `turned`."""
    p, n = sim.particles, sim.particles.owned
    position, volume = seen(sim, rotation, place), p.present_volume()
    thickness = 1.0 if p.dimension == 2 else np.ptp(p.initial_position[:n, 2]) + sim.spacing
    own = connected(position, sim.spacing)
    share = volume[own] / p.volume[:n][own]
    up, tensor = rotation[:, 1], fields.values(sim, ["stress"])["stress"]
    stress = tensor[:, 0] * up[0] ** 2 + tensor[:, 1] * up[1] ** 2 + 2.0 * tensor[:, 3] * up[0] * up[1]
    g = p.gradient[:n].reshape(-1, p.dimension, p.dimension)
    rate = np.hypot(g[:, 0, 0] - g[:, 1, 1], g[:, 0, 1] + g[:, 1, 0])
    least = 0.1 * DENSITY * 9.81 * height
    inside = np.nan
    if p.dimension == 2:
        area = cells(position[own], sim.spacing)
        within = np.isfinite(area)
        inside = area[within].sum() / volume[own][within].sum() if within.any() else np.nan
    strain = p.equivalent_shear_strain[:n]
    core = grown(p.initial_position[:n], p.position[:n], sim.spacing)[(strain > CORE[0]) & (strain < CORE[1])]
    core = core[np.isfinite(core)]
    scatters = [
        scatter(position, stress, sim.spacing, own & chosen, least) for chosen in (rate > FLOWING, rate < RESTING)
    ]
    front = np.quantile(np.abs(position[:, 0]), 0.99) + 0.5 * sim.spacing
    top = np.quantile(position[own, 1], 0.99) + 0.5 * sim.spacing
    return {
        "time": sim.time, "steps": sim.step_number,
        "area": covered_area(position[own, :2], sim.spacing) * thickness / p.volume[:n][own].sum(),
        "inside": inside,
        "core": core.mean() if len(core) else np.nan,
        "volumes": volume[own].sum() / p.volume[:n][own].sum(),
        "least volume": np.quantile(share, 0.01), "largest volume": np.quantile(share, 0.99),
        "scatter in flow": scatters[0], "scatter at rest": scatters[1],
        "run-out": (front - 0.5 * WIDTH) / (0.5 * WIDTH), "height": top / height,
        "loose": int((~own).sum()),
    }  # fmt: skip


def collapse(scene: dict, height: float, times, seed: int = 0, rotation=_UPRIGHT, place=(0.0, 0.0)):
    """Run the column and yield its figures at `times` (s) and at the end; the simulation with them."""
    if not np.array_equal(rotation, _UPRIGHT) or any(place):
        with tempfile.TemporaryDirectory() as folder:
            sim = periporo.Simulation.from_scene(turned(scene, rotation, place, folder))
    else:
        sim = periporo.Simulation.from_scene(scene)
    if seed:
        n = sim.particles.owned
        sim.particles.position[:n] += 1e-9 * np.random.default_rng(seed).uniform(-1, 1, (n, sim.particles.dimension))
    left, found, least = list(times), [], [0.0]
    p = sim.particles  # below: J, or J/m, potential energy of the column
    fallen = 0.5 * DENSITY * 9.81 * height * p.volume[: p.owned].sum()

    def note():
        energies = {name: energy / fallen for name, energy in sim.ledger.entries().items()}
        found.append(energies | measure(sim, height, rotation, place) | {"least internal energy": least[0] / fallen})

    def look(sim):
        least[0] = min(least[0], sim.ledger.rough_entries()["internal_energy"])
        if left and sim.time >= left[0]:
            left.pop(0)
            note()

    sim.call_every(10, look)
    sim.run()
    note()
    return sim, found


def row(height: float, rows: int, seed: int, figures: dict) -> str:
    """A line of the table."""
    f = figures
    numbers = " | ".join(
        "" if math.isnan(f[name]) else f"{f[name]:.3f}"
        for name in ("area", "inside", "core", "volumes", "least volume", "largest volume", "scatter in flow",
                     "scatter at rest", "run-out", "height")
    )  # fmt: skip
    head = f"| {height:g} | {rows} | {seed} | {f['time']:.2f} | {f['steps']} |"
    return f"{head} {numbers} | {f['loose']} | {f['least internal energy']:.1e} |"


def energies(height: float, rows: int, seed: int, figures: dict) -> str:
    """A line of the table of energies."""
    numbers = " | ".join(f"{figures.get(name, 0.0):.4f}" for name in _ENERGIES)  # some schemes have not all of them
    return f"| {height:g} | {rows} | {seed} | {figures['time']:.2f} | {numbers} |"


def draw(path: Path, deposits) -> None:
    """Surfaces of `deposits`, (label, positions (n, 2) m, spacing m) each, and how much of their soil lies farther out.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4.4), layout="constrained")
    shape, tail = figure.subplots(2, 1, sharex=True)
    for label, position, spacing in deposits:
        shape.plot(*profile(position[connected(position, spacing)], spacing), label=label)
        out = np.sort(np.abs(position[:, 0]) + 0.5 * spacing)[::-1]
        tail.plot(out, np.arange(1, len(out) + 1) / len(out), label=label)
    shape.set(ylabel="height, m", xlim=(0.0, None))
    tail.set(ylabel="part of the soil farther out", xlabel="distance from the middle, m", yscale="log")
    shape.legend(fontsize="small")
    figure.savefig(path, dpi=150)


def main(words=None) -> None:
    """Print the table, and draw."""
    options = option_parser(__name__, __doc__)
    options.add_argument("--heights", type=float, nargs="+", default=[0.05, 0.1, 0.2], help="m")
    options.add_argument("--rows", type=int, nargs="+", default=[20, 40], help="points over the height")
    options.add_argument("--seeds", type=int, nargs="+", default=[0])
    options.add_argument("--bulk", type=float, default=25e6, help="bulk modulus, Pa")
    options.add_argument("--phi", type=float, default=30.0, help="angle of friction, degrees")
    options.add_argument("--psi", type=float, default=0.0, help="angle of dilation, degrees")
    options.add_argument("--largest-dilation", type=float, help="volumetric strain at which dilation ends")
    options.add_argument("--turned", type=float, default=0.0, help="degrees by which the scene is turned")
    options.add_argument("--at", type=float, nargs=2, default=[0.0, 0.0], help="where the scene is, m")
    options.add_argument("--thick", type=int, default=0, help="points across a slab in space; default: plane strain")
    options.add_argument("--scheme", type=json.loads, help="correspondence, as JSON; by default the program's")
    options.add_argument("--duration", type=float, default=0.6, help="s")
    options.add_argument("--energies", action="store_true", help="a table of energies")
    options.add_argument("--figure", type=Path, help="draw the deposits")
    chosen = options.parse_args(words)
    turn = math.radians(chosen.turned)
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    if chosen.thick and (turn or any(chosen.at)):
        options.error("--thick goes with neither --turned nor --at")
    law = {"friction_angle": chosen.phi, "dilation_angle": chosen.psi, "largest_dilation": chosen.largest_dilation}
    deposits = []
    head, line, times = _HEAD, row, (0.1, 0.2, 0.3)
    if chosen.energies:
        head, line, times = f"| H, m | H/dx | seed | t, s | {' | '.join(_ENERGIES)} |", energies, (0.1, 0.15, 0.2, 0.3)
    print(head + "\n" + "|---" * (head.count("|") - 1) + "|", flush=True)
    for height in chosen.heights:
        for rows in chosen.rows:
            for seed in chosen.seeds:
                scene = column(
                    height, rows, chosen.duration, bulk=chosen.bulk, thick=chosen.thick, scheme=chosen.scheme, **law
                )
                sim, found = collapse(scene, height, times, seed, rotation, chosen.at)
                deposits.append((f"H/dx = {rows}", seen(sim, rotation, chosen.at), sim.spacing))
                for figures in found:
                    print(line(height, rows, seed, figures), flush=True)
    if chosen.figure:
        draw(chosen.figure, deposits)
