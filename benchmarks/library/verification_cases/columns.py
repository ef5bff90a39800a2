"""V7, V8: columns under their own weight."""

import numpy as np

from .common import (
    DEFAULT,
    DENSITY,
    GRAVITY,
    P_MODULUS,
    P_SPEED,
    Figure,
    Recorder,
    box,
    order,
    owned,
    point_stress,
    simulation,
)

HEIGHT = 0.2


def _column(rows, scheme, stage, **keys):
    """Column of `rows` free rows, 8 points wide, held along x everywhere: a state of uniaxial strain.

    It stands on points that are held to the depth of the horizon; the floor, y = 0, runs through the highest
    of them, so half of their cells belongs to the column.
    """
    spacing = HEIGHT / (rows + 0.5)
    depth = np.ceil(keys.get("horizon", 2.2)) - 0.5
    return simulation(
        spacing, box([0.0, -depth * spacing], [8 * spacing, HEIGHT]), scheme=scheme, gravity=[0.0, -GRAVITY],
        boundaries={"floor": {"where": {"upper": [None, 0.5 * spacing]}, "fix": ["y"]},
                    "sides": {"where": {"lower": [None, -1.0]}, "fix": ["x"]}},
        stages=[{"name": "weight", "boundaries": ["floor", "sides"], **stage}], **keys,
    )  # fmt: skip


def settled(rows, scheme, **keys):
    """Errors of interior stress and of the settlement of the highest points, relative; more `keys` of the input."""
    sim = _column(rows, scheme, {"type": "relax", "tolerance": 1e-7}, **keys)
    sim.start()
    sim.run()
    y = owned(sim, "initial_position")[:, 1]
    exact = -DENSITY * GRAVITY * (HEIGHT - y)
    interior = (y > 0.25 * HEIGHT) & (y < 0.75 * HEIGHT)
    stress = np.linalg.norm((point_stress(sim)[:, 1] - exact)[interior]) / np.linalg.norm(exact[interior])
    top = y > HEIGHT - sim.spacing
    target = DENSITY * GRAVITY / P_MODULUS * (HEIGHT * y[top] - y[top] ** 2 / 2.0)
    settlement = (y - owned(sim, "position")[:, 1])[top]
    return stress, np.abs(settlement / target - 1.0).max()


def self_weight(full=False, scheme=DEFAULT):
    """V7: settled column; the settlement is that of the highest points."""
    rows = (10, 20, 40, 80) if full else (10, 20, 40)
    stress, settlement = np.array([settled(n, scheme) for n in rows]).T
    return [
        Figure("interior stress at 40 rows, relative L2", stress[2], at_most=0.003),
        Figure("settlement at 40 rows, relative", settlement[2], at_most=0.01),
        Figure("order of the settlement", order(settlement), at_least=0.9),
    ]


def sudden_weight(full=False, scheme=DEFAULT):
    """V8: the same column, its weight switched on at once: a triangular wave between 0 and twice the weight."""
    rows = 80 if full else 40
    sim = _column(rows, scheme, {"type": "dynamics", "duration": 8.2 * HEIGHT / P_SPEED})
    sim.start()

    def base_stress(s):
        held = owned(s, "initial_position")[:, 1] < 0.5 * s.spacing
        return owned(s, "internal_force")[held, 1].sum() / (8 * s.spacing) - DENSITY * GRAVITY * s.spacing / 2.0

    record = Recorder(base_stress)
    sim.observers.append(record)
    sim.run()
    time, stress = record.columns()
    stress /= -DENSITY * GRAVITY * HEIGHT
    k = np.flatnonzero(np.diff(np.sign(stress - 1.0)) != 0)  # passes the static value twice in a period
    crossing = time[k] + (1.0 - stress[k]) / (stress[k + 1] - stress[k]) * (time[k + 1] - time[k])
    period = (crossing[2] - crossing[0]) * P_SPEED / (4.0 * HEIGHT)
    mean, amplitude = _triangle(time * P_SPEED / (4.0 * HEIGHT), stress)
    return [
        Figure("period, relative", abs(period - 1.0), at_most=0.01),
        Figure("largest base stress, / weight", mean + amplitude, at_least=1.98, at_most=2.02),
        Figure("smallest base stress, / weight", mean - amplitude, at_least=-0.02, at_most=0.02),
        Figure("largest base stress with its rounded tip, / weight", stress.max()),
    ]


def _triangle(periods, stress):
    """Mean and amplitude of a triangular wave from its mean and its first harmonic over two periods."""
    whole = periods <= 2.0
    angle = 2.0 * np.pi * periods[whole]
    waves = [np.ones_like(angle)] + [f(k * angle) for k in (1, 2, 3, 4, 5) for f in (np.cos, np.sin)]
    mean, cosine, sine, *_ = np.linalg.lstsq(np.stack(waves, axis=1), stress[whole], rcond=None)[0]
    return mean, np.hypot(cosine, sine) * np.pi**2 / 8.0
