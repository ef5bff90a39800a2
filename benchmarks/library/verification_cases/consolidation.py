"""W1 to W4 in equilibrium: consolidation by increments of physical time."""

import numpy as np

from periporo.core.loads.boundary import Motion
from periporo.core.watch.observers import Observer
from periporo.core.water.flow import FlowingWater

from .common import BULK, DEFAULT, DENSITY, P_MODULUS, SHEAR, Figure, box, owned, simulation
from .seepage import PORES, terzaghi

STIFF = 2e3  # of the water, over the skeleton
_RAMP = 0.02  # time factor in which large loads come
_NEW = 0.05  # time factor up to which a front is thinner than the points can show


class Increments(Observer):
    """Keeps what function(sim) returns after every increment in which time went on, with the time in front."""

    def __init__(self, function):
        self.function = function
        self.rows = []

    def after_increment(self, sim):
        """Record."""
        if sim.time > 0.0:
            self.rows.append((sim.time, *np.atleast_1d(self.function(sim))))

    def run(self, sim):
        """Start a simulation and follow it."""
        sim.start()
        return self.follow(sim)

    def follow(self, sim):
        """Run a simulation that was started; time, and each recorded quantity, as arrays."""
        sim.observers.append(self)
        sim.run()
        return np.array(self.rows).T


def flowing(modulus, mobility=None):
    """Pore water as stiff as `STIFF` skeletons of `modulus` Pa; by default T = t for a length of 1 m."""
    mobility = (1.0 + 1.0 / STIFF) / modulus if mobility is None else mobility
    return {"suction": 0, "drainage": "flowing", "porosity": PORES, "bulk_modulus": STIFF * PORES * modulus,
            "permeability": 1e-5, "viscosity": 1e-5 / mobility}  # fmt: skip


def stage(boundaries, duration=1.0, **keys):
    """The quasi-static stage."""
    return {"name": "wait", "type": "quasi_static", "duration": duration, "boundaries": list(boundaries), **keys}


def layer(rows, load, scheme, across=4, duration=1.0, jitter=0.0):
    """A layer of thickness 2, `across` points wide, between drains at its loaded faces, which nothing holds."""
    spacing = 1.0 / rows
    boundaries = {"sides": {"where": {"lower": [None, -2.0]}, "fix": ["x"]}}
    for name, side, pressed, where in (
        ("below", "y-", load, {"upper": [None, spacing - 1.0]}),
        ("above", "y+", -load, {"lower": [None, 1.0 - spacing]}),
    ):  # fmt: skip
        boundaries[f"load {name}"] = {"where": where, "traction": {"stress": [0.0, pressed], "side": side}}
        boundaries[f"drain {name}"] = {"where": where, "water": {"pressure": 0, "side": side}}
    return simulation(
        spacing, box([0.0, -1.0], [across * spacing, 1.0]), scheme=scheme, pore_water=flowing(P_MODULUS),
        boundaries=boundaries, stages=[stage(boundaries, duration)], jitter=jitter,
    )  # fmt: skip


def one_way(full=False, scheme=DEFAULT):
    """W1: a layer that drains at its faces in at most 60 increments of equilibrium, against Terzaghi's series."""
    rows, load = 40 if full else 10, 1e3
    sim = layer(rows, load, scheme)

    def look(s):
        y, pressure = owned(s, "initial_position")[:, 1], owned(s, "pore_pressure") / load
        return pressure[np.abs(y) < s.spacing].mean(), 1.0 - pressure.mean()

    time, middle, degree = Increments(look).run(sim)
    exact_middle, exact_degree = terzaghi(time, depth=1.0 - 0.5 / rows)
    late = time > (0.002 if full else _NEW)
    balance = next(p for p in sim.point_processes if isinstance(p, FlowingWater)).histories()
    return [
        Figure("pressure in the middle, over the load", np.abs(middle - exact_middle)[late].max(), at_most=0.01),
        Figure("degree of consolidation", np.abs(degree - exact_degree)[late].max(), at_most=0.01),
        Figure("increments", float(len(time)), at_most=60),
        Figure("water not accounted for, over what left", abs(balance["water_balance"]) / balance["water_outflow"],
               at_most=1e-6),
    ]  # fmt: skip


def large_strain(full=False, scheme=DEFAULT):
    """W2: a layer whose drains suck with half its modulus and with all of it, against the exact solution.

    True stress is proportional to logarithmic strain, and permeability goes as the square of the volume; then the
    volume obeys the linear equation of diffusion (Gibson, England & Hussey 1967). Porosity is so close to 1 that Kozeny
    and Carman's formula is that square. Pressures are less the load, which bears on all alike. The drains reach theirs
    in T = .02: a jump would be thinner than the points can show.
    """
    rows, figures, soft = 40 if full else 20, [], {"model": "elastic", "density": DENSITY, "bulk_modulus": BULK / 100,
                                                   "shear_modulus": SHEAR / 100}  # fmt: skip
    modulus, spacing = P_MODULUS / 100, 1.0 / rows
    water = flowing(modulus) | {"porosity": 0.9999, "kozeny_carman": True, "bulk_modulus": STIFF * modulus}
    for relative in (0.5, 1.0) if full else (0.5,):
        sucked = {"times": [0.0, _RAMP], "values": [0.0, -relative * modulus]}
        boundaries = {"sides": {"where": {"lower": [None, -2.0]}, "fix": ["x"]},
                      "below": {"where": {"upper": [None, spacing - 1.0]}, "water": {"pressure": sucked, "side": "y-"}},
                      "above": {"where": {"lower": [None, 1.0 - spacing]}, "water": {"pressure": sucked, "side": "y+"}}}
        sim = simulation(
            spacing, box([0.0, -1.0], [4 * spacing, 1.0]), scheme=scheme, material=soft, pore_water=water,
            boundaries=boundaries, stages=[stage(boundaries)],
        )  # fmt: skip
        start = owned(sim, "initial_position")[:, 1]

        def look(s, start=start, load=relative * modulus):
            y, way = owned(s, "position")[:, 1], np.ptp(start) - np.ptp(owned(s, "position")[:, 1])
            ends = [owned(s, "pore_dilation")[np.argmin(y)], owned(s, "pore_dilation")[np.argmax(y)]]
            pressure = 1.0 + owned(s, "pore_pressure") / load
            return pressure[np.abs(start) < s.spacing].mean(), 0.5 * way + 0.25 * s.spacing * (2.0 - sum(ends))

        time, middle, settled = Increments(look).run(sim)
        exact, way = sucked_layer(time, relative, 1.0 - 0.5 * spacing)
        late = time > _NEW
        figures += [
            Figure(f"pressure in the middle, load {relative:g} M", np.abs(middle - exact)[late].max(), at_most=0.02),
            Figure(f"settlement over the last one, load {relative:g} M",
                   np.abs(settled - way)[late].max() / (1.0 - np.exp(-relative)), at_most=0.02),
            Figure(f"increments, load {relative:g} M", float(len(time))),
        ]  # fmt: skip
    return figures


def sucked_layer(time, relative, depth):
    """Pressure above that of the drains, over the load, at a `depth`, and settlement of the half layer, by `time`s.

    The load is `relative` to the modulus and comes in the time `_RAMP`; its parts are superposed (Duhamel).
    """
    edges = np.linspace(0.0, _RAMP, 201)
    parts = -np.diff(np.exp(-relative * edges / _RAMP))
    left, way = np.zeros(len(time)), np.zeros(len(time))
    for moment, part in zip(0.5 * (edges[1:] + edges[:-1]), parts, strict=True):
        series, degree = terzaghi(np.maximum(time - moment, 0.0), depth)
        left, way = left + part * (1.0 - series), way + part * degree
    return 1.0 + np.log(1.0 - left) / relative, way


class Plate(Motion):
    """A smooth rigid plate: points of a row move alike along an axis, with the mean of what they would do."""

    def __init__(self, rows, axis):
        self.rows = rows
        self.axis = axis

    def apply(self, p, time, dt, closing_step):
        """Overwrite the velocity."""
        self.hold_zero(p, p.velocity)

    def foresee(self, p, time, dt, velocity):
        """As `apply`."""

    def hold_zero(self, p, free):
        """Take the mean."""
        free[self.rows, self.axis] = free[self.rows, self.axis].mean()


def mandel(time, ratio, place=0.0):
    """Pressure over its start at a `place` x/a, of a slab of Poisson's `ratio` between smooth plates."""
    slope = (1.0 - ratio) / (0.5 - ratio)
    roots = []
    for k in range(200):
        low, high = k * np.pi + 1e-9, (k + 0.5) * np.pi - 1e-12
        for _ in range(100):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if np.tan(middle) > slope * middle else (middle, high)
        roots.append(0.5 * (low + high))
    b = np.array(roots)
    part = np.sin(b) / (b - np.sin(b) * np.cos(b)) * (np.cos(b * place) - np.cos(b))
    return 2.0 * np.exp(-np.outer(np.atleast_1d(time), b * b)) @ part


def slab(full=False, scheme=DEFAULT):
    """W3: pressure in the middle of a slab squeezed between smooth rigid plates rises first (Mandel 1953)."""
    rows, load, figures = 40 if full else 10, 1e3, []
    for ratio in (0.0, 0.2) if full else (0.0,):
        bulk = 2.0 * SHEAR * (1.0 + ratio) / (3.0 * (1.0 - 2.0 * ratio))
        soil = {"model": "elastic", "density": DENSITY, "bulk_modulus": bulk, "shear_modulus": SHEAR}
        spacing = 1.0 / rows
        height = 8 * spacing
        top, base = {"lower": [None, height - spacing]}, {"upper": [None, spacing]}
        boundaries = {"right": {"where": {"body": "body0"}, "water": {"pressure": 0, "side": "x+"}},
                      "left": {"where": {"body": "body0"}, "water": {"pressure": 0, "side": "x-"}},
                      "above": {"where": top, "traction": {"stress": [0, -load], "side": "y+"}},
                      "below": {"where": base, "traction": {"stress": [0, load], "side": "y-"}}}  # fmt: skip
        sim = simulation(
            spacing, box([-1.0, 0.0], [1.0, height]), scheme=scheme, material=soil,
            pore_water=flowing(bulk + 4.0 / 3.0 * SHEAR), boundaries=boundaries, stages=[stage(boundaries)],
        )  # fmt: skip
        y = owned(sim, "position")[:, 1]
        for end in (y.min(), y.max()):
            sim.stages[0].prescribed_motions.append(Plate(np.flatnonzero(np.abs(y - end) < 0.1 * spacing), 1))

        def look(s):
            near = np.abs(owned(s, "initial_position")[:, 0]) < s.spacing
            return owned(s, "pore_pressure")[near].mean() / (0.5 * load)

        time, middle = Increments(look).run(sim)
        exact, late = mandel(time, ratio, 0.5 / rows), time > 0.01
        figures += [
            Figure(f"pressure in the middle, nu = {ratio:g}", np.abs(middle - exact)[late].max(), at_most=0.01),
            Figure(f"its peak less the exact one, nu = {ratio:g}", abs(middle.max() - exact[late].max()), at_most=0.01),
        ]
    return figures


def sphere(full=False, scheme=DEFAULT):
    """W4: pressure in the middle of a sphere that is loaded and drains at its surface rises first (Cryer 1963)."""
    rows, load, figures = 20 if full else 10, 1e3, []
    peaks = {0.0: (1.5754, 0.0627), 0.25: (1.3075, 0.0494), 1.0 / 3.0: (1.2090, 0.0442)}
    for ratio, (peak, _) in peaks.items() if full else [(0.25, peaks[0.25])]:
        bulk = 2.0 * SHEAR * (1.0 + ratio) / (3.0 * (1.0 - 2.0 * ratio))
        soil = {"model": "elastic", "density": DENSITY, "bulk_modulus": bulk, "shear_modulus": SHEAR}
        spacing = 2.0 / rows
        # pressures less the load, which bears on the surface alike: what drains is under suction
        boundaries = {"drain": {"where": {"body": "body0"}, "water": {"pressure": -load}}}
        sim = simulation(
            spacing, {"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 1.0}, dimension=3, scheme=scheme,
            material=soil, pore_water=flowing(bulk + 4.0 / 3.0 * SHEAR), boundaries=boundaries,
            stages=[stage(boundaries, 0.1)],
        )  # fmt: skip

        def look(s):
            near = (owned(s, "initial_position") ** 2).sum(axis=1) < s.spacing**2
            return 1.0 + owned(s, "pore_pressure")[near].mean() / load

        _, middle = Increments(look).run(sim)
        figures.append(Figure(f"peak over the exact one, less 1, nu = {ratio:.3g}", abs(middle.max() / peak - 1.0),
                              at_most=0.03 if full else 0.06))  # fmt: skip
    return figures
