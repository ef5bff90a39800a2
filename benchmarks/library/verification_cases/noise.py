"""W11: pore pressure that differs from point to point."""

import numpy as np

from .common import DEFAULT, Figure, Recorder, box, owned, simulation
from .consolidation import layer

_SILT = {"model": "cam_clay", "grain_density": 2700, "porosity": 0.45, "bulk_modulus": 5e6, "shear_modulus": 2.5e6,
         "critical_state_slope": 1.2, "compression_index": 0.1, "swelling_index": 0.01,
         "overconsolidation_ratio": 1.1}  # fmt: skip


def unevenness(sim, rows=slice(None)):
    """Standard deviation, Pa, of the pressures of the points, or of some `rows`, less their means over a horizon."""
    pairs, n = sim.bonds.pairs, sim.particles.owned
    near = pairs.weight > 0.0
    first, second, volume, p = pairs.first[near], pairs.second[near], owned(sim, "volume"), owned(sim, "pore_pressure")
    weights, sums = volume.copy(), volume * p
    for i, j in ((first, second), (second, first)):
        weights += np.bincount(i, volume[j], n)
        sums += np.bincount(i, volume[j] * p[j], n)
    return (p - sums / weights)[rows].std()


def at_rest_and_in_flow(full=False, scheme=DEFAULT):
    """W11: what pore pressures differ from their means over a horizon, at rest and in a saturated collapse."""
    load, figures = 1e3, []
    for jitter in (0.0, 0.1) if full else (0.1,):
        sim = layer(40, load, scheme, duration=0.01, jitter=jitter)
        sim.start()
        sim.run()
        figures.append(Figure(f"W1 at T = .01, jitter {jitter:g}, over the load", unevenness(sim) / load, at_most=0.03))
    spacing, last = (0.1, 1.2) if full else (0.2, 0.5)
    sides = {"left": {"where": {"upper": [spacing - 2.0, None]}, "fix": ["x"]},
             "right": {"where": {"lower": [2.0 - spacing, None]}, "fix": ["x"]}}  # fmt: skip
    sim = simulation(
        spacing, box([-2.0, 0.0], [2.0, 3.0]), scheme=scheme, material=_SILT, gravity=[0.0, -9.81], boundaries=sides,
        initial_stress={"type": "geostatic", "K0": 0.7},
        pore_water={"suction": 2e3, "drainage": "undrained", "bulk_modulus": 2e7},
        contacts=[{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.6, "damping": 0.2}],
        stages=[{"name": "settle", "type": "relax", "tolerance": 1e-3, "boundaries": list(sides)},
                {"name": "collapse", "type": "dynamics", "duration": last}],
    )  # fmt: skip
    sim.start()
    record = Recorder(lambda s: (unevenness(s), np.sqrt((owned(s, "pore_pressure") ** 2).mean())), interval=20)
    sim.observers.append(record)
    sim.run()
    time, noise, size = record.columns()
    moving = time > 0.1
    weight = 3.0 * 9.81 * (2700.0 * 0.55 + 1000.0 * 0.45)
    return [
        *figures,
        Figure("collapse, over the weight of the column", noise[moving].max() / weight, at_most=0.1),
        Figure("collapse, mean, over the root mean square of p", (noise / size)[moving].mean()),
    ]
