"""V20, W8: bearing capacity of a strip footing on weightless clay without drainage (Prandtl 1921): q = (2 + pi) c.

The clay is `drucker_prager` without friction: von Mises with sqrt(J2) = c. Plastic flow keeps the volume, so in plane
strain the stress out of plane is the mean of the other two at failure, sqrt(J2) is the radius of Mohr's circle, and c
is the undrained strength as in Tresca's criterion. The footing is a row of points that is driven down, slowly; the
load is the force that the soil opposes to it, over its width, which is that of the points' cells.

In W8 the clay is a skeleton with friction and without cohesion or dilation, and its pores are full of water that cannot
leave. Suction holds it together, p' = s at no total stress; at constant volume p' stays, so that c = s sin(phi). Total
stress is run with the bulk modulus of V20, and with that of the skeleton and its water, by which it is as hard to
compress: points that resist a change of volume more carry more, the more the fewer they are.
"""

import numpy as np

from .common import DEFAULT, Figure, Recorder, box, owned, simulation
from .noise import unevenness

COHESION = 10e3  # Pa
SHEAR = 1000.0 * COHESION
CLAY = {
    "model": "drucker_prager", "density": 1800.0, "bulk_modulus": 10.0 * SHEAR, "shear_modulus": SHEAR,
    "cohesion": COHESION, "friction_angle": 0.0,
}  # fmt: skip
HALF_WIDTH, HALF_LENGTH, DEPTH = 1.0, 3.5, 2.0  # of the footing and of the soil, m
EXACT = 2.0 + np.pi
FRICTION, PORES = 30.0, 0.4  # degrees; 1
SUCTION = COHESION / np.sin(np.radians(FRICTION))
SKELETON = CLAY | {"bulk_modulus": 2.0 / 3.0 * SHEAR, "cohesion": 0.0, "friction_angle": FRICTION}
WATER = {  # 200 times as stiff as the shear modulus: p' rises by .003 of the total mean stress
    "pore_water": {"suction": SUCTION, "drainage": "undrained", "porosity": PORES, "bulk_modulus": 200 * PORES * SHEAR},
    "initial_stress": {"type": "uniform", "components": dict.fromkeys(("xx", "yy", "zz"), -SUCTION)},
}  # fmt: skip
STIFF = SKELETON["bulk_modulus"] + 200.0 * SHEAR
OTHERS = (  # whose bonds expand as their points do, and whose bonds insist on their own volume, which locks
    ("bond_projected, dilatation: points", {"scheme": "bond_projected", "dilatation": "points"}),
    ("dilatation: bond", "bond_projected"),
)
SPEED, SETTLEMENT = 0.012, 0.01  # m/s, m: shear waves are six thousand times faster


def flowing(scheme):
    """The scheme with what lets soil flow at constant volume."""
    return {"scheme": scheme, "dilatation": "points"} if scheme == "bond_projected" else scheme


def load_curve(points, scheme, *, rough=True, speed=SPEED, material=CLAY, look=None, **water):
    """Settlement (k,) over the width, and load (k,) over c and the width, with `points` points under the footing.

    With a function `look` of the simulation also what it returns, (k,).
    """
    spacing = 2.0 * HALF_WIDTH / points
    sim = simulation(
        spacing, box([-HALF_LENGTH, 0.0], [HALF_LENGTH, DEPTH]), scheme=scheme, material=material,
        boundaries=_boundaries(spacing, rough, speed),
        stages=[{"name": "push", "type": "dynamics", "duration": SETTLEMENT / speed + 0.5 * _ramp(speed),
                 "boundaries": ["footing", "sides", "other side", "base"]}], **water,
    )  # fmt: skip
    sim.start()
    footing = sim.stages[0].prescribed_motions[0]

    def state(s):
        rows = np.isin(s.particles.id[: s.particles.owned], footing.ids)
        settled = (owned(s, "initial_position") - owned(s, "position"))[rows, 1].mean()
        return settled, owned(s, "internal_force")[rows, 1].sum(), *(() if look is None else (look(s),))

    record = Recorder(state, 10)
    sim.observers.append(record)
    sim.run()
    _, settled, force, *seen = record.columns()
    return settled / (2.0 * HALF_WIDTH), force / (2.0 * HALF_WIDTH * COHESION), *seen


def _ramp(speed):
    """Time (s) in which the footing gets up to its speed."""
    return 0.1 * SETTLEMENT / speed


def _boundaries(spacing, rough, speed):
    down = {"y": {"times": [0.0, _ramp(speed)], "values": [0.0, -speed]}}
    footing = {"lower": [-HALF_WIDTH, DEPTH - spacing], "upper": [HALF_WIDTH, None]}
    inside = HALF_LENGTH - 2.0 * spacing
    return {
        "footing": {"where": footing, "velocity": down | ({"x": 0.0} if rough else {})},
        "base": {"where": {"upper": [None, 2.0 * spacing]}, "fix": ["x", "y"]},
        "sides": {"where": {"upper": [-inside, None]}, "fix": ["x"]},
        "other side": {"where": {"lower": [inside, None]}, "fix": ["x"]},
    }


def plateau(settled, load):
    """Mean load of the last fifth of the settlement, and how much it still rises in the last half, relative."""
    last, half = (load[settled > share * settled[-1]] for share in (0.8, 0.5))
    return last.mean(), np.ptp(half) / last.mean()


def strip_footing(full=False, scheme=DEFAULT):
    """V20: strip footing on undrained clay, load at failure over c and width: 2 + pi."""
    numbers = (12, 24, 48) if full else (24,)
    scheme = flowing(scheme)
    found = np.array([plateau(*load_curve(n, scheme)) for n in numbers])
    figures = [Figure(f"rough, {n} points under it (5.1416)", q) for n, q in zip(numbers, found[:, 0], strict=True)]
    error = np.abs(found[:, 0] / EXACT - 1.0)
    figures += [Figure("relative error of the finest", error[-1], at_most=0.08 if not full else 0.04)]
    flat = {numbers[-1]: 0.02 if full else 0.025}
    figures += [
        Figure(f"rise in the last half of the settlement, {n} points, relative", rise, at_most=flat.get(n))
        for n, rise in zip(numbers, found[:, 1], strict=True)
    ]
    if full:
        slow = plateau(*load_curve(12, scheme, speed=SPEED / 2.0))[0]
        figures += [
            Figure("error with twice the points, / error", (error[1:] / error[:-1]).max(), at_most=0.75),
            Figure("smooth, 24 points", plateau(*load_curve(24, scheme, rough=False))[0]),
            Figure("half the speed, 12 points, relative change", abs(slow / found[0, 0] - 1.0), at_most=0.01),
            *(Figure(f"{name}, {n} points", plateau(*load_curve(n, other))[0])
              for name, other in OTHERS for n in (12, 24)),
        ]  # fmt: skip
    return figures


def _unevenness(sim):
    """That of the points that are farther than two spacings from those that boundaries hold."""
    place, near = owned(sim, "initial_position"), 4.0 * sim.spacing
    free = (np.abs(place[:, 0]) < HALF_LENGTH - near) & (place[:, 1] > near) & (place[:, 1] < DEPTH - 0.5 * near)
    return unevenness(sim, free)


def _beyond(load, other):
    """Error of a load beyond that of another, relative."""
    return (abs(load - EXACT) - abs(other - EXACT)) / EXACT


def undrained_footing(full=False, scheme=DEFAULT):
    """W8: strip footing on a saturated skeleton with friction, load at failure over s sin(phi) and width: 2 + pi."""
    figures = []
    for n in (12, 24, 48) if full else (8,):
        dry = plateau(*load_curve(n, scheme))[0]
        stiff = plateau(*load_curve(n, scheme, material=CLAY | {"bulk_modulus": STIFF}))[0]
        settled, load, noise = load_curve(n, scheme, material=SKELETON, look=_unevenness, **WATER)
        wet, rise = plateau(settled, load)
        figures += [
            Figure(f"total stress, {n} points under it (5.1416)", dry),
            Figure(f"total stress, as hard to compress, {n} points", stiff),
            Figure(f"effective stress and water, {n} points", wet),
            Figure("its error beyond that of total stress, relative", _beyond(wet, dry),
                   at_most={48: 0.03, 8: 0.12}.get(n)),
            Figure("beyond that of total stress as hard to compress", _beyond(wet, stiff), at_most=0.03),
            Figure("rise in the last half of the settlement, relative", rise, at_most=0.03),
            Figure("unevenness of the pressure at last, over the load", (noise / (load * COHESION))[-1], at_most=0.05),
        ]  # fmt: skip
    return figures
