"""V21, W10: stability of a vertical cut in clay without drainage, and of an infinite slope of sand, dry or wet.

Both are left to their weight with viscous damping; what falls freely gets to the speed g/rate. A body fails if it
still moves at a given share of that at the end; it stands if it has come to rest. Each limit is bracketed by
bisection, and both sides of the bracket are figures.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from periporo.core.loads.boundary import Motion
from periporo.core.water.pore_water import DrainedWater

from .common import BULK, DEFAULT, DENSITY, GRAVITY, SHEAR, Figure, box, owned, simulation
from .footing import OTHERS, flowing

HEIGHT = 2.0  # of the cut, m
STABILITY = 3.776  # gamma H / c at which a vertical cut fails (limit analysis, Martin 2011)
ANGLE = 30.0  # of friction, degrees
WEIGHT, PORES = 1000.0 * GRAVITY, 0.4  # of water, N/m^3; 1
_WATER = {
    "along": {"suction": 0, "porosity": PORES},
    "submerged": {"water_table": 100.0, "free_water": {"level": 100.0}, "porosity": PORES},
}
HELD = 3  # rows of points that are the ground below the slope


def bisect(fails, stands, fallen, width):
    """Bracket of the least number at which `fails(number)` is true, from `stands` to `fallen`, to `width` of it."""
    if fails(stands) or not fails(fallen):
        raise ValueError(f"the limit does not lie between {stands} and {fallen}")
    while fallen - stands > width * stands:
        middle = 0.5 * (stands + fallen)
        stands, fallen = (stands, middle) if fails(middle) else (middle, fallen)
    return stands, fallen


def cut(number, rows, scheme, duration=2.0, rate=20.0):
    """Simulation of a vertical cut `rows` points high with gamma H / c = `number`, and its damping in 1/s."""
    c = DENSITY * GRAVITY * HEIGHT / number
    clay = {"model": "drucker_prager", "density": DENSITY, "bulk_modulus": 5000.0 * c, "shear_modulus": 1000.0 * c,
            "cohesion": c, "friction_angle": 0.0}  # fmt: skip
    spacing, left, right, low = HEIGHT / rows, -HEIGHT, 1.5 * HEIGHT, -0.5 * HEIGHT
    vertices = [[left, low], [right, low], [right, HEIGHT], [0.0, HEIGHT], [0.0, 0.0], [left, 0.0]]
    return simulation(
        spacing, {"type": "polygon", "vertices": vertices}, scheme=scheme, material=clay,
        gravity=[0.0, -GRAVITY], initial_stress={"type": "geostatic", "K0": 1.0},
        boundaries={"base": {"where": {"upper": [None, low + 2.0 * spacing]}, "fix": ["x", "y"]},
                    "left": {"where": {"upper": [left + 2.0 * spacing, None]}, "fix": ["x"]},
                    "right": {"where": {"lower": [right - 2.0 * spacing, None]}, "fix": ["x"]}},
        stages=[{"name": "weight", "type": "dynamics", "duration": duration, "damping": {"viscous": rate},
                 "boundaries": ["base", "left", "right"]}],
    ), rate  # fmt: skip


def infinite_slope(angle, dilation, rows, scheme, duration=3.0, rate=3.0, water=None):
    """Simulation of a layer 1 m thick on a slope of `angle` degrees, in axes along and across it, and its damping.

    It starts without stress and is 12 points long; points of the same depth are tied, as if it went on forever. `water`
    flows "along" it up to its surface, or the slope is "submerged" in water at rest.
    """
    spacing, slope = 1.0 / rows, np.radians(angle)
    sand = {"model": "drucker_prager", "density": DENSITY, "bulk_modulus": BULK / 10.0, "shear_modulus": SHEAR / 10.0,
            "cohesion": 0.0, "friction_angle": ANGLE, "dilation_angle": dilation}  # fmt: skip
    sim = simulation(
        spacing, box([0.0, -HELD * spacing], [12 * spacing, 1.0]), scheme=scheme, material=sand,
        gravity=[GRAVITY * np.sin(slope), -GRAVITY * np.cos(slope)],
        stages=[{"name": "weight", "type": "dynamics", "duration": duration, "damping": {"viscous": rate}}],
        **({} if water is None else {"pore_water": _WATER[water]}),
    )  # fmt: skip
    sim.stages[0].prescribed_motions.append(_TiedRows(sim))
    for process in sim.point_processes:
        if water == "along" and isinstance(process, DrainedWater):
            process.profile = _AlongSlope(WEIGHT * np.cos(slope))
    return sim, rate


@dataclass(frozen=True)
class _AlongSlope:
    """Pressure of water that flows along the slope: it grows across it by `gradient` Pa/m, from the surface on."""

    gradient: float
    varies = True

    def at(self, position, time=0.0):
        return self.gradient * np.maximum(1.0 - position[:, 1], 0.0)


class _TiedRows(Motion):
    """Gives all points of the same height at the start their mean velocity; the lowest rows stand still."""

    def __init__(self, sim):
        height = owned(sim, "position")[:, 1]
        self.row = np.zeros(sim.particles.id.max() + 1, int)
        self.row[sim.particles.id] = np.rint((height - height.min()) / sim.spacing)

    def apply(self, p, time, dt, closing_step):
        """Overwrite the velocities."""
        row = self.row[p.id[: p.owned]]
        count = np.bincount(row)
        for axis in range(p.dimension):
            mean = np.bincount(row, weights=p.velocity[: p.owned, axis]) / count
            mean[:HELD] = 0.0
            p.velocity[: p.owned, axis] = mean[row]


def moves(make, share, number):
    """Whether the fastest point of make(number) = (simulation, rate) ends faster than `share` of g/rate."""
    sim, rate = make(number)
    sim.start()
    sim.run()
    return bool(np.sqrt((owned(sim, "velocity") ** 2).sum(axis=1).max()) > share * GRAVITY / rate)


def _bracket(name, found, exact, bounded=True):
    """Figures of the two sides of a bracket over the exact limit."""
    stands, fails = (number / exact for number in found)
    return [
        Figure(f"{name}: stands at, / exact", stands, at_least=0.92 if bounded else None),
        Figure(f"{name}: fails at, / exact", fails, at_most=1.08 if bounded else None),
    ]


def vertical_cut(full=False, scheme=DEFAULT):
    """V21: vertical cut in undrained clay, weight over strength gamma H / c at failure: 3.776."""
    figures = []
    for rows in (10, 20, 30) if full else (10,):
        make = partial(cut, rows=rows, scheme=flowing(scheme))
        found = bisect(partial(moves, make, 1e-4), 3.4, 4.6, 0.01 if full else 0.03)
        figures += _bracket(f"{rows} points high", found, STABILITY)
    if full:
        for name, other in OTHERS:
            found = bisect(partial(moves, partial(cut, rows=20, scheme=other), 1e-4), 3.4, 6.0, 0.01)
            figures += _bracket(f"20 points high, {name}", found, STABILITY, bounded=False)
    return figures


def sand_slope(full=False, scheme=DEFAULT):
    """V21: infinite slope of sand, friction 30 degrees, tan(slope) at failure: tan(30), or sin(30) without dilation."""
    figures, rows = [], 24 if full else 12
    for dilation, name, exact in ((ANGLE, "associated flow", np.tan), (0.0, "no dilation", np.sin)):
        make = partial(infinite_slope, dilation=dilation, rows=rows, scheme=flowing(scheme))
        limit = float(exact(np.radians(ANGLE)))
        found = bisect(partial(_slides, make), 0.8 * limit, 1.3 * limit, 0.01 if full else 0.04)
        figures += _bracket(name, found, limit)
    return figures


def wet_slope(full=False, scheme=DEFAULT):
    """W10: infinite slope of sand without dilation, with water along it, or submerged, tan(slope) at failure."""
    figures, rows = [], 24 if full else 12
    saturated = (DENSITY + 1000.0 * PORES) * GRAVITY
    for water, part in (("along", 1.0 - WEIGHT / saturated), ("submerged", 1.0)):
        make = partial(infinite_slope, dilation=0.0, rows=rows, scheme=flowing(scheme), water=water)
        limit = part * float(np.sin(np.radians(ANGLE)))
        found = bisect(partial(_slides, make), 0.8 * limit, 1.3 * limit, 0.01 if full else 0.08)
        figures += _bracket({"along": "water along it"}.get(water, water), found, limit)
    return figures


def _slides(make, tangent):
    return moves(make, 2e-3, np.degrees(np.arctan(tangent)))
