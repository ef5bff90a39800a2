"""Flows whose answers are known: layers on rough slopes, a dam of nearly frictionless soil, clay between plates.

    python -m benchmarks flow_truths                # all, and the cost; a few minutes
    python -m benchmarks flow_truths --only slope --rows 16 32
    python -m benchmarks flow_truths --only cost --rows 14 --thick 4  # in space

*slope*: a layer of sand (friction 30 degrees, no dilation) on a rough plane of 35 degrees. A layer that shears at
constant volume bears tau/sigma = sin(phi) (Davis 1968), so that all of it is accelerated by g (sin(35) - cos(35)
sin(30)). The figure is the acceleration of the middle third, which its ends do not reach in the time, over that.

*dam*: soil of 1 degree and four heights long lets go at once on a smooth floor. Figures are the places where the depth
is .6, .4 and .2 of the first over those of Ritter (1892), (2 - 3 sqrt(h/H)) sqrt(gH) t, in dam heights from the dam,
their difference; the front over 2 sqrt(gH) t; and the area over the first.

*endless*: the same layer, periodic along the slope, in the time that takes it 20 depths down. Figures are its mean way
over that, its area and the sum of its volumes over the first, their first and last percentile, and the scatter of the
stress across the layer.

*clay*: a block of clay that keeps its volume, pressed between rough plates to .52 of its height: area and volumes.

*cost*: processor time per step of a collapsing column with `regular` over that without, the two in turns, and the ratio
of their steps for the same time.
"""

import time

import numpy as np

import periporo
from periporo.core.points import fields

from . import option_parser
from .flow import column
from .library.deposits import connected, covered_area, profile, scatter

GRAVITY = 9.81
_SAND = {
    "model": "drucker_prager", "density": 1800.0, "bulk_modulus": 2.5e6, "shear_modulus": 1.5e6, "cohesion": 0.0,
    "dilation_angle": 0.0,
}  # fmt: skip
_ROUGH = {"normal": [0, 1], "friction": 1.0}


def _simulation(spacing, upper, gravity, contacts, duration, *, soil, **scene):
    return periporo.Simulation.from_scene({
        "dimension": 2, "spacing": spacing, "gravity": gravity,
        "materials": {"soil": _SAND | soil},
        "bodies": [{"name": "soil", "material": "soil", "shape": {"type": "box", "lower": [0, 0], "upper": upper}}],
        "contacts": [{"type": "plane", "point": [0, 0], "damping": 0.2} | contact for contact in contacts],
        "stages": [{"name": "flow", "type": "dynamics", "duration": duration}],
    } | scene)  # fmt: skip


def _down(angle):
    """Gravity on a slope of `angle` degrees, and the acceleration of a layer of sand that shears on it; m/s^2."""
    along, across = GRAVITY * np.sin(np.radians(angle)), GRAVITY * np.cos(np.radians(angle))
    return [along, -across], along - 0.5 * across


def slope(rows: int, angle: float = 35.0, depth: float = 0.1, start: float = 0.1, duration: float = 0.25) -> float:
    """Acceleration of a layer of `rows` points of `depth` m on a slope of `angle` degrees over the exact one.

    It is that between `start` and `duration` s: at first the layer settles, since it begins without stress.
    """
    length, (gravity, exact) = 10.0 * depth, _down(angle)
    sim = _simulation(depth / rows, [length, depth], gravity, [_ROUGH], duration, soil={"friction_angle": 30.0})
    p, n = sim.particles, sim.particles.owned
    middle = p.id[:n][np.abs(p.position[:n, 0] - 0.5 * length) < length / 6.0]
    rate = []

    def look(sim):
        if sim.time >= start:
            rate.append((sim.time, p.velocity[:n][np.isin(p.id[:n], middle), 0].mean()))

    sim.call_every(20, look)
    sim.run()
    return float(np.polyfit(*np.array(rate).T, 1)[0] / exact)


def endless(rows: int, angle: float = 35.0, depth: float = 0.1, depths: float = 20.0) -> dict[str, float]:
    """Figures of a layer of `rows` points of `depth` m on an endless slope, which should go so many `depths`."""
    length, (gravity, exact) = 2.0 * depth, _down(angle)
    sim = _simulation(
        depth / rows, [length, depth], gravity, [_ROUGH], np.sqrt(2.0 * depths * depth / exact),
        soil={"friction_angle": 30.0}, periodic={"lower": [0.0, None], "upper": [length, None]},
    )  # fmt: skip
    sim.run()
    p, n = sim.particles, sim.particles.owned
    images = p.position[:n] + np.array([-length, 0.0, length])[:, None, None] * [1.0, 0.0]
    x, height = profile(images.reshape(-1, 2), sim.spacing)
    share = p.present_volume()[:n] / p.volume[:n]
    return {
        "way": (p.position[:n] - p.initial_position[:n])[:, 0].mean() / (depths * depth),
        "area": height[(x > 0.0) & (x < length)].mean() / depth,
        "volumes": share.mean(), "1 %": np.quantile(share, 0.01), "99 %": np.quantile(share, 0.99),
        "scatter": scatter(p.position[:n], fields.values(sim, ["stress"])["stress"][:, 1], sim.spacing,
                           np.ones(n, bool), 100.0 * depth * GRAVITY),
    }  # fmt: skip


def clay(rows: int, height: float = 0.1, left: float = 0.52, speed: float = 0.5) -> dict[str, float]:
    """Area and volumes over the first of clay pressed at `speed` m/s until so much of its `height` (m) is left."""
    lid = {"point": [0.0, height], "normal": [0.0, -1.0], "friction": 0.5, "velocity": [0.0, -speed]}
    sim = _simulation(
        height / rows, [height, height], [0.0, 0.0], [{"normal": [0.0, 1.0], "friction": 0.5}, lid],
        (1.0 - left) * height / speed, soil={"friction_angle": 0.0, "cohesion": 1e3},
    )  # fmt: skip
    sim.run()
    p, n = sim.particles, sim.particles.owned
    share = p.present_volume()[:n] / p.volume[:n]
    area = covered_area(p.position[:n], sim.spacing) / p.volume[:n].sum()
    return {"area": area, "volumes": share.mean(), "1 %": np.quantile(share, 0.01), "99 %": np.quantile(share, 0.99)}


def dam(rows: int, height: float = 0.1, length: float = 4.0, heights: float = 3.0) -> dict[str, float]:
    """Figures of a dam `length` heights long after `heights` times sqrt(H/g)."""
    spacing, speed = height / rows, np.sqrt(GRAVITY * height)
    duration = heights * np.sqrt(height / GRAVITY)
    contacts = [{"normal": [0, 1], "friction": 0.0}, {"normal": [1, 0], "friction": 0.0}]
    sim = _simulation(
        spacing, [length * height, height], [0.0, -GRAVITY], contacts, duration, soil={"friction_angle": 1.0}
    )
    area = sim.particles.volume[: sim.particles.owned].sum()
    sim.run()
    position = sim.particles.position[: sim.particles.owned]
    own = connected(position, spacing)
    mirrored = np.vstack([position[own], position[own] * [-1, 1]])
    x, depth = profile(mirrored, spacing)
    figures = {}
    for part in (0.6, 0.4, 0.2):
        reached = 0.5 * (depth >= part * height).sum() * (x[1] - x[0])  # of both sides; no lone grain counts
        place = (reached / height - length) / heights
        figures[f"{part:g} H"] = place - (2.0 - 3.0 * np.sqrt(part))
    figures["front"] = (position[own, 0].max() + 0.5 * spacing - length * height) / (2.0 * speed * duration)
    figures["area"] = covered_area(mirrored, spacing) / (2.0 * area)
    return figures


def cost(rows: int, until: float = 0.15, thick: int = 0) -> tuple[float, float]:
    """Processor time per step, and steps until `until` s, of a column with `regular` over those without.

    With `thick` it is a slab in space, so many points wide.
    """
    sims, spent = [], [0.0, 0.0]
    for regular in (True, False):
        scheme = {"scheme": "point_state", "sharpened": True, "regular": regular}
        sims.append(periporo.Simulation.from_scene(column(0.1, rows, until, bulk=2.5e6, scheme=scheme, thick=thick)))
        sims[-1].start()
        sims[-1].step()  # all kernels are compiled
    while sims[0].time < until or sims[1].time < until:
        for k, sim in enumerate(sims):
            if sim.time < until:
                began = time.process_time()
                for _ in range(50):
                    sim.step()
                spent[k] += time.process_time() - began
    steps = [sim.step_number - 1 for sim in sims]
    return spent[0] / steps[0] / (spent[1] / steps[1]), steps[0] / steps[1]


def main(words=None) -> None:
    """Print the tables."""
    options = option_parser(__name__, __doc__)
    options.add_argument("--only", choices=["slope", "endless", "dam", "clay", "cost"])
    options.add_argument("--rows", type=int, nargs="+", default=[16], help="points of depth")
    options.add_argument("--thick", type=int, default=0, help="cost: points across a slab in space; default: the plane")
    chosen = options.parse_args(words)
    if chosen.only in (None, "slope"):
        print("| rows | acceleration of the slope flow, over the exact one |\n|---|---|", flush=True)
        for rows in chosen.rows:
            print(f"| {rows} | {slope(rows):.3f} |", flush=True)
    for name, flow in (("endless", endless), ("dam", dam), ("clay", clay)):
        if chosen.only in (None, name):
            for k, rows in enumerate(chosen.rows):
                figures = flow(rows)
                if k == 0:
                    print(f"| {name}, rows | {' | '.join(figures)} |\n" + "|---" * (1 + len(figures)) + "|")
                print(f"| {rows} | " + " | ".join(f"{value:.3f}" for value in figures.values()) + " |", flush=True)
    if chosen.only in (None, "cost"):
        print("| rows | time per step, over that without `regular` | steps, over theirs |\n|---|---|---|", flush=True)
        for rows in chosen.rows:
            print(f"| {rows} | " + " | ".join(f"{ratio:.2f}" for ratio in cost(rows, thick=chosen.thick)) + " |")
