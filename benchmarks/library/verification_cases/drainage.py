"""W6 and W7: fronts in dry soil, and a column that drains under its own weight."""

import tempfile
from pathlib import Path

import numpy as np

from periporo.core.water.flow import FlowingWater

from .common import DEFAULT, Figure, Recorder, box, simulation
from .seepage import GAMMA, GRAVITY, SOIL, STANDSTILL

_HEAD, _PORES, _CONDUCTIVITY = 1.0, 0.4, 1e-3  # m, suction at the front; 1; m/s
_DRY, _WIDTH = 0.1, 0.1  # S before the front, and the part of its suction, to both sides, over which S falls


def build_with(table, **scene):
    """A simulation whose retention `table` has rows of suction Pa, saturation, and relative conductivity."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "retention.csv"
        file.write_text("suction,saturation,conductivity\n" + "".join(f"{a!r},{b!r},{c!r}\n" for a, b, c in table))
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
    for rows, taus in ((20, (0.1, 0.5)), (8, (1.0, 2.0, 5.0))) if full else ((8, (0.5,)),):  # in a metre of suction
        unit = _HEAD * _PORES * (1.0 - _DRY) / _CONDUCTIVITY
        time, entered = _soaked(rows, taus[-1], unit, scheme)
        for tau in taus:
            f = np.interp(tau * unit, time, entered) / (_HEAD * _PORES * (1.0 - _DRY))
            figures.append(Figure(f"infiltration over the exact one, less 1, tau = {tau:g}",
                                  abs(f / green_ampt(tau) - 1.0), at_most=0.03 if full else 0.06))  # fmt: skip
    return figures


def _soaked(rows, last, unit, scheme):
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
        time_step={"fixed": 0.006 * unit / rows},
    )  # fmt: skip
    sim.start()
    record = Recorder(lambda s: balance(s)["water_inflow"] / (4 * spacing), interval=5)
    sim.observers.append(record)
    sim.run()
    return record.columns()
