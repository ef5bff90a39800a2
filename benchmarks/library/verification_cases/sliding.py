"""V15: a block on an incline and on the level, Coulomb friction.

The contact is damped along its normal: an elastic block that slides on a rigid plane takes up ever more vibration from
friction (Adams 1995), until parts of its face swing back and are not braked, which is real but hides the closed form.
"""

import numpy as np

from .common import DEFAULT, GRAVITY, Figure, box, owned, simulation

ANGLE = np.radians(30.0)


def _block(friction, slope, speed, scheme, spacing, **stages):
    """An elastic block that just touches a plane, in axes along and across the slope."""
    gravity = [GRAVITY * np.sin(slope), -GRAVITY * np.cos(slope)]
    sim = simulation(
        spacing, box([0.0, 0.0], [0.08, 0.04]), scheme=scheme, gravity=gravity,
        contacts=[{"type": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": friction, "damping": 0.5}],
        **stages,
    )  # fmt: skip
    sim.particles.velocity[:, 0] = speed
    sim.start()
    return sim


def _travel(sim):
    """Displacement of the centre of mass along the slope, m."""
    return float((owned(sim, "position") - owned(sim, "initial_position"))[:, 0].mean())


def _advance(sim, end):
    while sim.time < end:
        sim.step()


def incline(full=False, scheme=DEFAULT):
    """V15: distance slid down a slope of 30 degrees with friction 0.1 in 0.99 s: g (sin - 0.1 cos) t^2 / 2."""
    spacing, end = (0.005, 0.99) if full else (0.01, 0.2)
    sim = _block(0.1, ANGLE, 0.0, scheme, spacing)
    _advance(sim, end)
    exact = 0.5 * GRAVITY * (np.sin(ANGLE) - 0.1 * np.cos(ANGLE)) * sim.time**2
    distance = _travel(sim) * 0.99**2 / sim.time**2  # as if it had gone on
    return [
        Figure("distance in 0.99 s, m (1.9874)", distance),
        Figure("distance, relative error", abs(_travel(sim) / exact - 1.0), at_most=1e-3),
    ]


def sticking(full=False, scheme=DEFAULT):
    """V15: with friction 0.7 > tan 30 the block finds equilibrium on the slope, and stays there."""
    wait = {"name": "wait", "type": "dynamics", "duration": 1.0 if full else 0.1}
    stages = [{"name": "settle", "type": "relax"}, wait]
    sim = _block(0.7, ANGLE, 0.0, scheme, 0.005 if full else 0.01, stages=stages)
    sim.stages[0].run(sim)
    settled = _travel(sim)
    sim.stages[1].run(sim)
    return [
        Figure("displacement until equilibrium, m", abs(settled), at_most=1e-5),
        Figure("creep after that, m/s", abs(_travel(sim) - settled) / sim.time, at_most=1e-7),
    ]


def _stopped(scheme, spacing):
    """Relative error of the way to a stop, and the mean speed at the end over that at the start."""
    friction, speed = 0.3, 1.0
    sim = _block(friction, 0.0, speed, scheme, spacing)
    _advance(sim, 1.1 * speed / (friction * GRAVITY))
    exact = speed**2 / (2.0 * friction * GRAVITY)
    return abs(_travel(sim) / exact - 1.0), abs(owned(sim, "velocity")[:, 0].mean()) / speed


def stopping(full=False, scheme=DEFAULT):
    """V15: a block thrown along the level with 1 m/s stops after v^2 / (2 mu g)."""
    error, left = _stopped(scheme, 0.01)
    figures = [
        Figure("stopping distance, relative error", error, at_most=1e-3),
        Figure("mean speed at the end, / start", left, at_most=1e-3),
    ]
    if full:
        finer = ((scheme, "the default", 5.0), ("point_state", "point_state", 5.0), ("point_state", "point_state", 2.5))
        for other, name, spacing in finer:
            figures.append(Figure(f"the same, {name}, {spacing:g} mm: it flutters", _stopped(other, spacing * 1e-3)[0]))
    return figures


def published_friction(full=False, scheme=DEFAULT):
    """V15: the same throw on the published short-range contact, which is no friction: the block slides on."""
    friction, speed, spacing = 0.3, 1.0, 0.01
    figures = []
    for share, bounds in ((0.1, {"at_least": 0.9}), (0.25, {"at_least": 0.85}), (1.0, {})):
        substrate = {"lower": [-0.05, -1.05 * spacing], "upper": [0.45, -0.3 * spacing], "spacing": share}
        sim = simulation(
            spacing, box([0.0, 0.0], [0.08, 0.04]), scheme=scheme, gravity=[0.0, -GRAVITY],
            contacts=[{"type": "short_range_published", "friction": friction, "substrate": substrate}],
        )  # fmt: skip
        sim.particles.velocity[:, 0] = speed
        sim.start()
        _advance(sim, 0.9 * speed / (friction * GRAVITY))
        left = owned(sim, "velocity")[:, 0].mean() / speed
        figures.append(Figure(f"speed left where Coulomb leaves 0.1, substrate spacing {share:g}", left, **bounds))
    return figures
