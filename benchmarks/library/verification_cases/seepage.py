"""W1, W5: consolidation of a column by its own water, and infiltration into unsaturated ground."""

import numpy as np

from periporo.core.water.flow import FlowingWater

from .common import BULK, DEFAULT, DENSITY, P_MODULUS, P_SPEED, SHEAR, Figure, Recorder, box, owned, simulation

PORES, GAMMA, GRAVITY = 0.4, 9810.0, 9.81
SOIL = {"model": "elastic", "density": DENSITY, "bulk_modulus": BULK, "shear_modulus": SHEAR}
STANDSTILL = {"where": {"lower": [None, -1.0]}, "fix": ["x", "y"]}


def terzaghi(time, depth=1.0):
    """Excess pressure over the load at a `depth` (of the drained column) and time factor, and the mean degree U."""
    m = (2.0 * np.arange(400) + 1.0) * np.pi / 2.0
    decay = np.exp(-np.outer(np.atleast_1d(time), m**2))
    return decay @ (2.0 / m * np.sin(m * depth)), 1.0 - decay @ (2.0 / m**2)


def _column(rows, scheme, stiffness, crossings, damping, **keys):
    """A layer of thickness 2 between drains whose water carries what the skeleton did not take of a load at once.

    The water is `stiffness` times as stiff as the skeleton; T = 1 comes after `crossings` of a drained wave through the
    half of it; in such a crossing waves decay by exp(-`damping`/2). Returns the simulation, the time of T = 1, s, and
    the pressure at the start, Pa.
    """
    spacing, load = 1.0 / rows, 1e3
    last = crossings / P_SPEED
    mobility = (1.0 + 1.0 / stiffness) / (last * P_MODULUS)
    bulk = stiffness * PORES * P_MODULUS
    water = {"suction": 0, "drainage": "flowing", "porosity": PORES, "bulk_modulus": bulk, "permeability": 1e-5,
             "viscosity": 1e-5 / mobility}  # fmt: skip
    ends = {"y-": {"upper": [None, spacing - 1.0]}, "y+": {"lower": [None, 1.0 - spacing]}}
    boundaries = {"sides": {"where": {"lower": [None, -2.0]}, "fix": ["x"]}}
    for side, where in ends.items():
        name = "below" if side == "y-" else "above"
        pressed = load if side == "y-" else -load
        boundaries[f"load {name}"] = {"where": where, "traction": {"stress": [0.0, pressed], "side": side}}
        boundaries[f"drain {name}"] = {"where": where, "water": {"pressure": 0, "side": side}}
    stage = {"name": "wait", "type": "dynamics", "duration": last, "damping": {"viscous": damping * P_SPEED},
             "boundaries": list(boundaries)}  # fmt: skip
    sim = simulation(
        spacing, box([0.0, -1.0], [4 * spacing, 1.0]), scheme=scheme, pore_water=water, boundaries=boundaries,
        stages=[stage], **keys,
    )  # fmt: skip
    p, carried = sim.particles, load * stiffness / (1.0 + stiffness)  # by the water
    strain = -(load - carried) / P_MODULUS
    lateral = (BULK - 2.0 / 3.0 * SHEAR) * strain
    sim.bonds.initial_stress = lambda x: np.tile([lateral, carried - load, lateral, 0.0], (len(x), 1))
    p.pore_pressure[:] = carried
    p.water_content[:] = p.exchanged_water[:, 0] = PORES * p.volume * (1.0 + carried / bulk)
    return sim, last, carried


def consolidation(full=False, scheme=DEFAULT):
    """W1: a layer that drains at its faces, against Terzaghi's series; the load is carried by the water at first."""
    rows = 20 if full else 10  # from a drain to the middle
    crossings, damping = (200.0, 0.8) if full else (40.0, 0.3)
    sim, last, carried = _column(rows, scheme, stiffness=10.0, crossings=crossings, damping=damping)
    sim.start()

    def look(s):
        y, pressure = owned(s, "initial_position")[:, 1], owned(s, "pore_pressure") / carried
        return pressure[np.abs(y) < s.spacing].mean(), 1.0 - pressure.mean()

    record = Recorder(look, interval=10)
    sim.observers.append(record)
    sim.run()
    time, middle, degree = record.columns()
    exact_middle, exact_degree = terzaghi(time / last, depth=1.0 - 0.5 / rows)
    late = time > (0.05 if full else 0.15) * last
    balance = next(p for p in sim.point_processes if isinstance(p, FlowingWater)).histories()
    return [
        Figure("pressure in the middle, over the load", np.abs(middle - exact_middle)[late].max(), at_most=0.01),
        Figure("degree of consolidation", np.abs(degree - exact_degree)[late].max(), at_most=0.01),
        Figure("water not accounted for, over what left", abs(balance["water_balance"]) / balance["water_outflow"],
               at_most=1e-6),
    ]  # fmt: skip


def infiltration(full=False, scheme=DEFAULT):
    """W5: rain of 0.9 K_s on steadily wet ground of 0.1 K_s, K and S_e exponential (Srivastava & Yeh 1991)."""
    rows, length, alpha = 80 if full else 40, 10.0, 1.0  # m, 1/m
    first, second, conductivity, residual = 0.1, 0.9, 1e-3, 0.2
    spacing = length / rows
    unit = PORES * (1.0 - residual) / (alpha * conductivity)  # of time
    curve = {"exponential": {"alpha": alpha / GAMMA * 1e3, "residual": residual}}
    water = {"suction": 0, "drainage": "flowing", "porosity": PORES, "bulk_modulus": 1e9, "retention": curve,
             "conductivity": conductivity}  # fmt: skip
    boundaries = {
        "all": STANDSTILL,
        "rain": {"where": {"lower": [None, length - spacing]}, "water": {"flux": second * conductivity, "side": "y+"}},
        "base": {"where": {"upper": [None, spacing]}, "water": {"head": 0.0, "side": "y-"}},
    }
    stage = {"name": "rain", "type": "dynamics", "duration": 10.0 * unit, "boundaries": list(boundaries)}
    sim = simulation(
        spacing, box([0.0, 0.0], [6 * spacing, length]), scheme=scheme, pore_water=water, boundaries=boundaries,
        stages=[stage], gravity=[0.0, -GRAVITY], time_step={"fixed": 0.02 * unit},
    )  # fmt: skip
    p = sim.particles
    start = first - (first - 1.0) * np.exp(-alpha * p.position[:, 1])  # K/K_s
    p.pore_pressure[:] = GAMMA / alpha * np.log(start)
    p.water_content[:] = (residual + (1.0 - residual) * start) * PORES * p.volume * (1.0 + p.pore_pressure / 1e9)
    p.exchanged_water[:, 0] = p.water_content
    places, found = np.array([2.5, 5.0, 7.5, 10.0]), []

    def look(s):
        y = owned(s, "position")[:, 1]
        order = np.argsort(y)
        head = owned(s, "pore_pressure")[order] / GAMMA
        return np.exp(alpha * np.interp(places, y[order], head))

    record = Recorder(look)
    sim.start()
    sim.observers.append(record)
    sim.run()
    time, *found = record.columns()
    exact = {1.0: (0.173877, 0.107022, 0.180938, 0.676154), 5.0: (0.329487, 0.493078, 0.733811, 0.870427),
             10.0: (0.727036, 0.807665, 0.871506, 0.895533)}  # fmt: skip
    errors = []
    for moment, values in exact.items():
        now = [np.interp(moment * unit, time, f) for f in found]
        errors.append(np.abs(np.array(now) - values)[:3].max())
    return [Figure(f"K/K_s, t* = {moment:g}", error, at_most=0.01) for moment, error in zip(exact, errors, strict=True)]
