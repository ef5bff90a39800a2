"""V22: surfaces. A uniform stress beside loaded faces, rows on a floor and under a strip, a footing pushed down."""

import numpy as np

from .common import (
    BULK,
    DEFAULT,
    DENSITY,
    GRAVITY,
    P_MODULUS,
    SHEAR,
    Figure,
    Recorder,
    box,
    owned,
    point_stress,
    simulation,
)
from .footing import CLAY, COHESION, EXACT

SPACING, STRESS = 0.01, 1e3  # m, Pa
AXES = "xyz"


def _row_errors(sim, count, stress):
    """Largest relative error of the mean normal stress across any of the four outer rows, at both ends of each axis.

    `count` points along each axis of a box; `stress` (Pa) is the exact value.
    """
    cell = np.floor(owned(sim, "initial_position") / SPACING).astype(int)
    found = point_stress(sim)
    means = [
        found[cell[:, axis] == row, axis].mean()
        for axis in range(cell.shape[1])
        for k in range(4)
        for row in (k, count - 1 - k)
    ]
    return np.abs(np.array(means) / stress - 1.0).max()


def _pulled(dimension, count, scheme, **keys):
    """A box at rest under traction on all sides; pulled, since a box that dead loads press turns over."""
    names = {}
    for axis in AXES[:dimension]:
        for sign, word in ((-1.0, "low"), (1.0, "high")):
            stress = [sign * STRESS * (a == axis) for a in AXES[:dimension]]
            side = f"{axis}{'-' if sign < 0.0 else '+'}"
            names[f"{word} {axis}"] = {"where": {"body": "body0"}, "traction": {"stress": stress, "side": side}}
    sim = simulation(
        SPACING, box([0.0] * dimension, [count * SPACING] * dimension), dimension=dimension, scheme=scheme,
        initial_stress={"type": "uniform", "components": {2 * a: STRESS for a in AXES[:dimension]}}, boundaries=names,
        stages=[{"name": "settle", "type": "relax", "tolerance": 1e-5, "boundaries": list(names)}], **keys,
    )  # fmt: skip
    sim.start()
    sim.run()
    return sim


def _held(dimension, count, scheme, **keys):
    """A box at rest between smooth planes that press on all sides, without gravity; and the stress that they exert."""
    planes = []
    for axis in range(dimension):
        for sign in (-1.0, 1.0):
            normal, point = np.zeros((2, dimension))
            normal[axis] = -sign
            point[axis] = (0.5 * (1.0 + sign) * count - sign * STRESS / P_MODULUS) * SPACING
            planes.append({"type": "plane", "point": point, "normal": normal, "friction": 0.0})
    sim = simulation(
        SPACING, box([0.0] * dimension, [count * SPACING] * dimension), dimension=dimension, scheme=scheme,
        initial_stress={"type": "uniform", "components": {2 * a: -STRESS for a in AXES[:dimension]}}, contacts=planes,
        stages=[{"name": "settle", "type": "relax", "tolerance": 1e-5}], **keys,
    )  # fmt: skip
    sim.start()
    sim.run()
    floor = owned(sim, "initial_position")[:, 1] < SPACING
    return sim, -owned(sim, "contact_force")[floor, 1].sum() / (count * SPACING) ** (dimension - 1)


def _on_a_plane(dimension, count, scheme, **keys):
    """A box of displaced points at rest on a smooth plane, between smooth walls, under traction from above."""
    width, inwards = count * SPACING, np.eye(dimension)
    planes = [{"type": "plane", "point": [0.0] * dimension, "normal": normal, "friction": 0.0} for normal in inwards]
    planes += [{"type": "plane", "point": width * normal, "normal": -normal, "friction": 0.0}
               for axis, normal in enumerate(inwards) if axis != 1]  # fmt: skip
    sim = simulation(
        SPACING, box([0.0] * dimension, [width] * dimension), dimension=dimension, scheme=scheme, contacts=planes,
        initial_stress={"type": "uniform", "components": {2 * a: -STRESS for a in AXES[:dimension]}},
        boundaries={"top": {"where": {"body": "body0"}, "traction": {"stress": -STRESS * inwards[1], "side": "y+"}}},
        stages=[{"name": "settle", "type": "relax", "tolerance": 1e-5, "boundaries": ["top"]}], **keys,
    )  # fmt: skip
    sim.start()
    sim.run()
    return sim


def uniform_stress(full=False, scheme=DEFAULT):
    """V22: a uniform stress, loaded by traction on all sides or between planes: error of the mean stress of a row."""
    figures = []
    sizes = {2: 24, 3: 14} if full else {2: 10, 3: 10} if scheme == DEFAULT else {2: 10}
    for dimension, count in sizes.items():
        error = _row_errors(_pulled(dimension, count, scheme), count, STRESS)
        figures.append(Figure(f"under traction, {dimension}D, worst of rows 1 to 4", error, at_most=0.01))
        sim, pressed = _held(dimension, count, scheme)
        figures.append(
            Figure(f"between planes, {dimension}D, worst of rows 1 to 4", _row_errors(sim, count, pressed), 0.01)
        )
    return figures


def displaced_points(full=False, scheme=DEFAULT):
    """V22: the same on a cloud of 10 % jitter in balance: on a plane, between walls, under traction from above."""
    figures = []
    for dimension, count in {2: 96, 3: 24}.items() if full else {2: 48}.items():
        sim = _on_a_plane(dimension, count, scheme, jitter=0.1)
        cell = np.floor(owned(sim, "initial_position")[:, 1] / SPACING).astype(int)
        stress = point_stress(sim)[:, 1] / -STRESS - 1.0
        rows = [abs(stress[cell == row].mean()) for row in (0, 1, 2, 3, *range(count - 4, count))]
        figures += [
            Figure(f"{dimension}D, worst of rows 1 to 4 on the plane", max(rows[:4]), at_most=0.02),
            Figure(f"{dimension}D, worst of rows 1 to 4 below the traction", max(rows[4:]), at_most=0.02),
            Figure(f"{dimension}D, scatter of points in these rows", stress[(cell < 4) | (cell >= count - 4)].std()),
        ]
    return figures


def resting_column(full=False, scheme=DEFAULT):
    """V22: a column at rest on a smooth floor between smooth walls: vertical stress of a row over the weight above."""
    rows, height = 40 if full else 20, 0.2
    spacing = height / rows
    width = 8 * spacing
    sim = simulation(
        spacing, box([0.0, 0.0], [width, height]), scheme=scheme, gravity=[0.0, -GRAVITY],
        initial_stress={"type": "geostatic", "K0": (BULK - 2.0 / 3.0 * SHEAR) / P_MODULUS},
        contacts=[{"type": "plane", "point": point, "normal": normal, "friction": 0.0} for point, normal in
                  (([0.0, 0.0], [0.0, 1.0]), ([0.0, 0.0], [1.0, 0.0]), ([width, 0.0], [-1.0, 0.0]))],
        stages=[{"name": "settle", "type": "relax", "tolerance": 1e-5}],
    )  # fmt: skip
    sim.start()
    sim.run()
    y = owned(sim, "initial_position")[:, 1]
    ratio = point_stress(sim)[:, 1] / (-DENSITY * GRAVITY * (height - y))
    lowest = [ratio[np.abs(y / spacing - k - 0.5) < 0.1].mean() for k in range(4)]
    return [
        Figure("lowest row", lowest[0], at_least=0.97, at_most=1.03),
        Figure("second row", lowest[1], at_least=0.97, at_most=1.03),
        Figure("third row", lowest[2], at_least=0.97, at_most=1.03),
        Figure("force of the floor over the weight", owned(sim, "contact_force")[y < spacing, 1].sum()
               / (DENSITY * GRAVITY * height * width), at_least=0.999, at_most=1.001),
    ]  # fmt: skip


def strip_load(full=False, scheme=DEFAULT):
    """V22: a strip load on an elastic half-plane: vertical stress of the rows below its middle, over Flamant's."""
    width, points = 0.16, 32 if full else 16
    spacing, half, depth = width / points, 0.48, 0.32
    sim = simulation(
        spacing, box([-half, 0.0], [half, depth]), scheme=scheme,
        boundaries={"load": {"where": {"lower": [-width / 2, None], "upper": [width / 2, None]},
                             "traction": {"stress": [0.0, -STRESS], "side": "y+"}},
                    "base": {"where": {"upper": [None, 2.0 * spacing]}, "fix": ["x", "y"]}},
        stages=[{"name": "settle", "type": "relax", "tolerance": 1e-4, "boundaries": ["load", "base"]}],
    )  # fmt: skip
    sim.start()
    sim.run()
    x, z = owned(sim, "initial_position")[:, 0], depth - owned(sim, "initial_position")[:, 1]
    one, other = np.arctan2(x + width / 2, z), np.arctan2(x - width / 2, z)
    exact = STRESS / np.pi * (one - other + np.sin(one - other) * np.cos(one + other))
    error = np.abs(point_stress(sim)[:, 1] / -exact - 1.0)
    middle = np.abs(x) < 0.35 * width
    return [
        Figure(f"row {k + 1}, largest error", error[middle & (np.abs(z / spacing - k - 0.5) < 0.1)].max(), at_most=0.05)
        for k in range(3)
    ]


def pushed_down(points, scheme, settlement=0.01, wider=0.0, **keys):
    """Load, over c and its width, of a smooth box of 2 m and `wider` spacings on either side, at a `settlement`, m."""
    half_width, half_length, depth, speed = 1.0, 3.5, 2.0, 0.024
    spacing = 2.0 * half_width / points
    inside, half_width = half_length - 2.0 * spacing, half_width + wider * spacing
    sim = simulation(
        spacing, box([-half_length, 0.0], [half_length, depth]), scheme=scheme, material=CLAY,
        boundaries={"base": {"where": {"upper": [None, 2.0 * spacing]}, "fix": ["x", "y"]},
                    "sides": {"where": {"upper": [-inside, None]}, "fix": ["x"]},
                    "other side": {"where": {"lower": [inside, None]}, "fix": ["x"]}},
        contacts=[{"type": "box", "lower": [-half_width, depth], "upper": [half_width, depth + 1.0], "friction": 0.0,
                   "velocity": [0.0, -speed]}],
        stages=[{"name": "push", "type": "dynamics", "duration": settlement / speed,
                 "boundaries": ["base", "sides", "other side"]}], **keys,
    )  # fmt: skip
    sim.start()
    record = Recorder(lambda s: -owned(s, "contact_force")[:, 1].sum() / (2.0 * half_width * COHESION), 10)
    sim.observers.append(record)
    sim.run()
    time, load = record.columns()
    return load[time > 0.8 * time[-1]].mean()


def pushed_footing(full=False, scheme=DEFAULT):
    """V22: a smooth box pushed into undrained clay (as V20), load at failure over c and its width: 2 + pi."""
    limits = {16: 0.10, 24: 0.07, 48: 0.05}
    figures = []
    for points in (16, 24, 48) if full else (16,):
        load = pushed_down(points, scheme, 0.01 if full else 0.006)
        figures.append(Figure(f"{points} points under it (5.1416)", load))
        figures.append(Figure(f"{points} points, relative error", abs(load / EXACT - 1.0), at_most=limits[points]))
    for wider in (0.25, 0.5, 0.75) if full else ():
        load = pushed_down(16, scheme, wider=wider)
        figures.append(
            Figure(f"{16 + 2 * wider:g} points under it, relative error", abs(load / EXACT - 1.0), at_most=0.1)
        )
    return figures
