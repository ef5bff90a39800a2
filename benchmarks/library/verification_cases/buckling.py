"""V23, V24: a column under a dead load along its axis that buckles (Euler 1744), and the elastica far beyond.

The column is free and pressed by dead tractions on the cells of its ends, which turn with them: pinned ends, without
any held point. Its plane-strain stiffness is E' = E / (1 - nu^2). The load of the elastica is multiplied by what a
column that shears and shortens bears, P (1 + P/kGA - P/E'A) = pi^2 E'I/L^2 (Reissner 1972; k = 5/6). Such closed forms
are of small strains, and good to .3 % here; so points are compared with the same column as a continuum
(`benchmarks.library.continuum`), and the forms translate a rise into a load, which changes eight times less.
"""

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from ..continuum import pressed
from .common import BULK, DEFAULT, SHEAR, Figure, box, owned, simulation

POISSON = (3.0 * BULK - 2.0 * SHEAR) / (2.0 * (3.0 * BULK + SHEAR))
MODULUS = 9.0 * BULK * SHEAR / (3.0 * BULK + SHEAR) / (1.0 - POISSON**2)  # E', Pa


def critical_load(slenderness):
    """Stress (Pa) at which a pinned column of length over thickness `slenderness` buckles."""
    euler = np.pi**2 * MODULUS / 12.0 / slenderness**2
    softer = 1.0 / (5.0 / 6.0 * SHEAR) - 1.0 / MODULUS
    return 2.0 * euler / (1.0 + np.sqrt(1.0 + 4.0 * euler * softer))


def _pressed(points, slenderness, stress, bow, scheme, tolerance, spread=False):
    """Rise (in lengths) of the middle over the ends, and the chord, of a column that began as a sine of `bow` lengths.

    It is `points` thick, one thickness being 1 m, and in equilibrium with the `stress` (Pa) on its ends. Rows that are
    `spread` lie farther from the axis, by what their second moment lacks; their volumes are as before.
    """
    length, spacing = float(slenderness), 1.0 / points
    ends = {}
    for name, low, high, side in (("left", None, spacing, "x-"), ("right", length - spacing, None, "x+")):
        where = {"lower": [low, None], "upper": [high, None]}
        sign = 1.0 if side == "x-" else -1.0
        ends[name] = {"where": where, "traction": {"stress": [sign * stress, 0.0], "side": side}}
    sim = simulation(
        spacing, box([0.0, -0.5], [length, 0.5]), scheme=scheme, boundaries=ends,
        stages=[{"name": "press", "type": "relax", "tolerance": tolerance, "boundaries": list(ends),
                 "max_displacement": 1e6}],
    )  # fmt: skip
    x = owned(sim, "position").copy()
    if spread:
        owned(sim, "position")[:, 1] /= np.sqrt(1.0 - 1.0 / points**2)
    owned(sim, "position")[:, 1] += bow * length * np.sin(np.pi * x[:, 0] / length)
    sim.start()
    sim.run()
    column = np.floor(x[:, 0] / spacing).astype(int)
    axis = np.stack([np.bincount(column, c) for c in owned(sim, "position").T], axis=1) * spacing
    left, right = 1.5 * axis[0] - 0.5 * axis[1], 1.5 * axis[-1] - 0.5 * axis[-2]
    middle = 0.5 * (axis[len(axis) // 2] + axis[(len(axis) - 1) // 2])
    return (middle[1] - 0.5 * (left + right)[1]) / length, (right - left)[0] / length


def elastica(rise):
    """Load over Euler's, and chord over length, of a pinned elastica that rises by `rise` lengths (Love 1927)."""
    k = brentq(lambda k: k / ellipk(k**2) - rise, 1e-6, 0.8)
    return (2.0 * ellipk(k**2) / np.pi) ** 2, 2.0 * ellipe(k**2) / ellipk(k**2) - 1.0


def column(full=False, scheme=DEFAULT):
    """V23: load at which a pinned column buckles, from how its bow grows at half of that, over the continuum's."""
    points, slenderness, bow, part = (12, 24.0, 0.005, 0.5) if full else (6, 10.0, 0.005, 0.5)
    stress = part * critical_load(slenderness)
    rise, _ = _pressed(points, slenderness, stress, bow, scheme, 1e-7)
    true, _ = pressed(slenderness, stress, BULK, SHEAR, bow=bow)
    load = (1.0 - bow / true) / (1.0 - bow / rise)
    return [
        Figure(f"{points} points of thickness: error of the load", abs(load - 1.0), at_most=0.01 if full else 0.03),
        Figure("load of the continuum over Euler's", part / (1.0 - bow / true)),
    ]


def post_buckling(full=False, scheme=DEFAULT):
    """V24: a column under 1.15 times its critical load stands as an elastica (Love 1927) with slopes near 1."""
    figures, slenderness = [], 16.0 if full else 10.0
    stress = 1.15 * critical_load(slenderness)
    true, true_chord = pressed(slenderness, stress, BULK, SHEAR, slope=1.0)
    true_load, true_exact = elastica(true)
    for points in (8, 12) if full else (6,):
        for spread, target in ((False, {6: 0.055, 12: 0.01}.get(points)), (True, {6: 0.025, 12: 0.01}.get(points))):
            rise, chord = _pressed(points, slenderness, stress, 2e-4, scheme, 1e-5, spread)
            load, exact = elastica(rise)
            what = f"{points} points of thickness, {'spread' if spread else 'lattice'}"
            shape = (chord - exact) - (true_chord - true_exact)
            figures += [
                Figure(f"{what}: error of the load for its rise", abs(true_load / load - 1.0), at_most=target),
                Figure(f"{what}: error of the chord for its rise, over the length", abs(shape),
                       at_most=0.001 if full else 0.005),
            ]  # fmt: skip
    return [*figures, Figure("load of the continuum over the elastica's", 1.15 / true_load)]
