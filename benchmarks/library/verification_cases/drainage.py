"""W6 and W7: fronts in dry soil, and a column that drains under its own weight."""

import tempfile
from pathlib import Path

import numpy as np

from periporo.core.water.flow import FlowingWater

from .common import DEFAULT, Figure, Recorder, box, owned, simulation
from .consolidation import Increments
from .seepage import GAMMA, GRAVITY, SOIL, STANDSTILL

_HEAD, _PORES, _CONDUCTIVITY = 1.0, 0.4, 1e-3  # m, suction at the front; 1; m/s
_DRY, _WIDTH = 0.1, 0.1  # S before the front, and the part of its suction, to both sides, over which S falls
_MINUTES = (5, 10, 20, 30, 60, 120)


def build_with(table, **scene):
    """A simulation whose retention `table` has rows of suction Pa, saturation, and relative conductivity."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "retention.csv"
        rows = [f"{suction:.17g},{filled:.17g},{relative:.17g}" for suction, filled, relative in table]
        file.write_text("\n".join(["suction,saturation,conductivity", *rows]))
        water = scene.pop("pore_water") | {"retention": {"table": str(file)}}
        return simulation(pore_water=water, **scene)


def balance(sim):
    """Histories of the water."""
    return next(p for p in sim.point_processes if isinstance(p, FlowingWater)).histories()


def green_ampt(tau):
    """Infiltration f over psi dtheta at a time tau over psi dtheta/K: tau = f - ln(1 + f)."""
    f = np.sqrt(2.0 * tau) + tau
    for _ in range(50):
        f -= (f - np.log1p(f) - tau) * (1.0 + f) / f
    return f


def ponded(full=False, scheme=DEFAULT):
    """W6: water on dry ground goes in behind a sharp front, as fast as Green & Ampt (1911) say."""
    figures = []
    long = ((16, 0.006, (0.5,)), (8, 0.006, (1.0, 2.0, 5.0)))
    runs = ((40, 0.002, (0.1,)), *long) if full else ((8, 0.006, (0.5,)),)
    for rows, step, taus in runs:  # rows in a metre of suction; step over the time in which water passes one
        unit = _HEAD * _PORES * (1.0 - _DRY) / _CONDUCTIVITY
        time, entered = _soaked(rows, step * unit / rows, taus[-1], unit, scheme)
        for tau in taus:
            f = np.interp(tau * unit, time, entered) / (_HEAD * _PORES * (1.0 - _DRY))
            figures.append(Figure(f"infiltration over the exact one, less 1, tau = {tau:g}",
                                  abs(f / green_ampt(tau) - 1.0), at_most=0.03 if full else 0.06))  # fmt: skip
    return figures


def _soaked(rows, step, last, unit, scheme):
    """Times until `last` `unit`s, and the water, m, that has gone into dry ground under a pond."""
    spacing = _HEAD / rows
    length = np.ceil(1.1 * green_ampt(last) / spacing) * spacing
    low, high = (1.0 - _WIDTH) * _HEAD * GAMMA, (1.0 + _WIDTH) * _HEAD * GAMMA
    boundaries = {"all": STANDSTILL, "pond": {"where": {"lower": [None, length - spacing]},
                                              "water": {"pressure": 0.0, "side": "y+"}}}  # fmt: skip
    sim = build_with(
        [(0.0, 1.0, 1.0), (low, 1.0, 1.0), (high, _DRY, 0.0)], spacing=spacing, scheme=scheme, material=SOIL,
        shapes=box([0.0, 0.0], [4 * spacing, length]), boundaries=boundaries, gravity=[0.0, -GRAVITY],
        pore_water={"suction": high, "drainage": "flowing", "porosity": _PORES, "bulk_modulus": 4e6,
                    "conductivity": _CONDUCTIVITY},
        stages=[{"name": "soak", "type": "dynamics", "duration": last * unit, "boundaries": list(boundaries)}],
        time_step={"fixed": step},
    )  # fmt: skip
    sim.start()
    record = Recorder(lambda s: balance(s)["water_inflow"] / (4 * spacing), interval=5)
    sim.observers.append(record)
    sim.run()
    return record.columns()


def liakopoulos(full=False, scheme=DEFAULT):
    """W7: a metre of Liakopoulos' sand drains under its own weight, against the finest of three spacings."""
    runs = [_drained(rows, scheme) for rows in ((10, 20, 40) if full else (8, 16))]
    (_, finest, fine, _, _), *coarser = runs[::-1]
    figures = []
    for rows, outflow, pressure, _, _ in coarser:
        figures += [
            Figure(f"outflow at six times, {rows} rows, over that at last", np.abs(outflow - finest).max() / finest[-1],
                   at_most=0.05 if rows == coarser[0][0] else None),
            Figure(f"suction in the middle, {rows} rows, over that of 1 m", np.abs(pressure - fine).max() / GAMMA,
                   at_most=0.05 if rows == coarser[0][0] else None),
        ]  # fmt: skip
    for number, minutes in enumerate(_MINUTES):
        figures.append(Figure(f"outflow by {minutes} min, mm", 1e3 * finest[number]))
    figures += [
        Figure("suction in the middle by 120 min, kPa", fine[-1] / 1e3),
        Figure("least outflow in an increment, over the whole", min(run[3] for run in runs), at_least=0.0),
        Figure("water not accounted for, over what left", max(run[4] for run in runs), at_most=1e-9),
    ]
    return figures


def _drained(rows, scheme):
    """Outflow m and suction Pa in the middle at `_MINUTES`; least outflow of an increment and error of the balance."""
    spacing, young, ratio = 1.0 / rows, 1.3e6, 0.4
    soil = {"model": "elastic", "density": 2000.0 * (1.0 - 0.2975), "bulk_modulus": young / (3.0 * (1.0 - 2.0 * ratio)),
            "shear_modulus": young / (2.0 * (1.0 + ratio))}  # fmt: skip
    heads = np.linspace(0.0, 1.2, 241)
    lost = 0.10152 * heads**2.4279
    table = [(GAMMA * h, 1.0 - dry, max(1.0 - 2.207 * dry**1.0121, 0.0)) for h, dry in zip(heads, lost, strict=True)]
    boundaries = {
        "base": {"where": {"upper": [None, spacing]}, "fix": ["x", "y"]},
        "sides": {"where": {"lower": [None, -1.0]}, "fix": ["x"]},
        "drain": {"where": {"upper": [None, spacing]}, "water": {"pressure": 0.0, "side": "y-"}},
    }
    held = ["base", "sides"]
    sim = build_with(
        table, spacing=spacing, scheme=scheme, material=soil, shapes=box([0.0, 0.0], [4 * spacing, 1.0]),
        boundaries=boundaries, gravity=[0.0, -GRAVITY], initial_stress={"type": "geostatic", "K0": ratio / (1 - ratio)},
        pore_water={"suction": 0.0, "drainage": "flowing", "porosity": 0.2975, "bulk_modulus": 2e9,
                    "conductivity": 4.41e-6},
        stages=[{"name": "settle", "type": "relax", "tolerance": 1e-4, "boundaries": held},
                {"name": "drain", "type": "quasi_static", "duration": 7200.0, "boundaries": list(boundaries)}],
    )  # fmt: skip
    middle = np.abs(owned(sim, "position")[:, 1] - 0.5) < spacing

    def look(s):
        return balance(s)["water_outflow"] / (4 * spacing), -owned(s, "pore_pressure")[middle].mean()

    time, outflow, suction = Increments(look).run(sim)
    sums, moments = balance(sim), 60.0 * np.array(_MINUTES)
    least = np.diff(outflow).min() / (outflow[-1] - outflow[0])
    error = abs(sums["water_balance"]) / sums["water_outflow"]
    return rows, np.interp(moments, time, outflow - outflow[0]), np.interp(moments, time, suction), least, error
