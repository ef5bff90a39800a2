"""C1 to C5: contact. Waves through an interface, line contact, platens, torsion, walls that move."""

import numpy as np

from .common import (
    BULK,
    DEFAULT,
    DENSITY,
    ELASTIC,
    GRAVITY,
    P_SPEED,
    SHEAR,
    Figure,
    ImposedVelocity,
    Recorder,
    box,
    owned,
    simulation,
)

CONFINED = 1e5  # Pa
STIFFNESS = 9.0 * BULK * SHEAR / (3.0 * BULK + SHEAR)  # Young's modulus, Pa
POISSON = (3.0 * BULK - 2.0 * SHEAR) / (6.0 * BULK + 2.0 * SHEAR)
SAND = {
    "model": "drucker_prager", "density": 1800.0, "bulk_modulus": BULK, "shear_modulus": SHEAR, "cohesion": 0.0,
    "friction_angle": 30.0,
}  # fmt: skip


def _sent_through(points, ratio, scheme):
    """Largest velocities sent back by, and through, the flush contact of two bars, over that of a half sine.

    The pulse is `points` long and 1e-4 of strain high; `ratio` is the second bar's impedance over the first one's.
    """
    spacing, length, start, speed = 1.0 / points, 2.0, 0.8, 1e-4 * P_SPEED
    other = ELASTIC | {name: ratio * ELASTIC[name] for name in ("density", "bulk_modulus", "shear_modulus")}
    shapes = [box([0.0, 0.0], [length, 4 * spacing]), box([length, 0.0], [2 * length, 4 * spacing])]
    sim = simulation(
        spacing, shapes, scheme=scheme, materials={"soil": ELASTIC, "other": other},
        bodies=[{"name": f"body{k}", "material": name, "shape": shape}
                for k, (name, shape) in enumerate(zip(("soil", "other"), shapes, strict=True))],
        boundaries={"side": {"where": {"lower": [-1.0, None]}, "fix": ["y"]}},
        contacts=[{"type": "bodies", "between": "all", "friction": 0.0}],
        stages=[{"name": "motion", "type": "dynamics", "duration": 1.4 / P_SPEED, "boundaries": ["side"]}],
    )  # fmt: skip
    sim.start()
    x = owned(sim, "position")[:, 0].copy()
    pulse = np.where((x > start) & (x < start + 1.0), np.sin(np.pi * (x - start)), 0.0)
    owned(sim, "velocity")[:, 0] = speed * pulse
    for block in sim.bonds.blocks:
        bulk, shear = block.elastic_moduli()
        strain = -speed / P_SPEED * pulse[block.first]
        block.stress[:, 0] = (bulk + 4.0 / 3.0 * shear) * strain
        block.stress[:, 1] = block.stress[:, 2] = (bulk - 2.0 / 3.0 * shear) * strain
    sim.apply_loads(0.0)
    sim.run()
    v = owned(sim, "velocity")[:, 0] / speed
    back, through = v[x < length - 0.1], v[x > length + 0.1]
    return back[np.abs(back).argmax()], through[np.abs(through).argmax()]


def waves_through_contact(full=False, scheme=DEFAULT):
    """C1: a P wave, 40 points long, meets the flush contact of two bars: what comes back and what goes through."""
    figures = []
    for ratio in (1.0, 3.0, 1.0 / 3.0) if full else (1.0, 3.0):
        back, through = _sent_through(40, ratio, scheme)
        exact = (1.0 - ratio) / (1.0 + ratio), 2.0 / (1.0 + ratio)
        what = f"impedance {ratio:.3g} times as large"
        figures.append(Figure(f"{what}: back, {exact[0]:.3g}; error", abs(back - exact[0]), at_most=0.03))
        figures.append(Figure(f"{what}: through, {exact[1]:.3g}; error", abs(through - exact[1]), at_most=0.03))
    return figures


def _line_contact(points, scheme):
    """Half-width and pressure in the middle of two equal discs' contact over Hertz', `points` in the half-width."""
    radius = 5.0 * points
    modulus = STIFFNESS / (1.0 - POISSON**2)
    load = np.pi * modulus * points**2 / (4.0 * radius)  # N/m, at a spacing of 1 m
    discs = [{"type": "disc", "center": [0.0, sign * radius], "radius": radius} for sign in (1.0, -1.0)]
    sim = simulation(
        1.0, discs, scheme=scheme, gravity=[0.0, -load / (DENSITY * np.pi * radius**2)],
        boundaries={"hold": {"where": {"upper": [None, -1.6 * radius]}, "fix": ["x", "y"]}},
        contacts=[{"type": "bodies", "between": "all", "friction": 0.0}],
        stages=[{"name": "settle", "type": "relax", "tolerance": 1e-4, "boundaries": ["hold"]}],
    )  # fmt: skip
    sim.start()
    sim.run()
    p, contact = sim.particles, next(c for c in sim.contacts if hasattr(c, "faces"))
    pressure = np.zeros(p.total)
    for end in contact.pairs:
        np.add.at(pressure, end, contact.pressures)
    upper = owned(sim, "body") == 0
    x, f = owned(sim, "position")[upper, 0], pressure[: p.owned][upper]
    width = 2.0 * np.sqrt((f * x**2).sum() / f.sum())  # of the ellipse that spreads as far
    column = np.floor(owned(sim, "initial_position")[upper, 0]).astype(int)
    middle = np.mean([f[column == k].sum() for k in (-2, -1, 0, 1)])
    return width / points, middle / (2.0 * load / (np.pi * points)), f.sum() / load


def _on_a_plane(points, rings, scheme):
    """As `_line_contact` for a disc on a rigid plane: half-width, pressure in the middle, and where it is worst.

    Pressures are those of parts one spacing wide, over Hertz'; the outermost of them, where that ends, are left out.
    """
    radius = 5.0 * points
    modulus = STIFFNESS / (1.0 - POISSON**2)
    load = np.pi * modulus * points**2 / (4.0 * radius)  # N/m, at a spacing of 1 m
    disc = {"name": "disc", "material": "soil", "lattice": "rings" if rings else "shared",
            "shape": {"type": "disc", "center": [0.0, radius], "radius": radius}}  # fmt: skip
    sim = simulation(
        1.0, [], scheme=scheme, bodies=[disc], gravity=[0.0, -load / (DENSITY * np.pi * radius**2)],
        boundaries={"axis": {"where": {"lower": [-0.6, radius], "upper": [0.6, None]}, "fix": ["x"]}},
        contacts=[{"type": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.0}],
        stages=[{"name": "settle", "type": "relax", "tolerance": 1e-4, "boundaries": ["axis"]}],
    )  # fmt: skip
    sim.start()
    sim.run()
    x, f = owned(sim, "position")[:, 0], owned(sim, "contact_force")[:, 1]
    edges = np.arange(1.0 - points, points)
    middles = 0.5 * (edges[1:] + edges[:-1])
    found, _ = np.histogram(x, edges, weights=f)
    pressure = found / (2.0 * load / (np.pi * points) * np.sqrt(1.0 - (middles / points) ** 2))
    width = 2.0 * np.sqrt((f * x**2).sum() / f.sum()) / points
    return width, pressure[np.abs(middles) < 2.0].mean(), pressure[np.abs(pressure - 1.0).argmax()]


def line_contact(full=False, scheme=DEFAULT):
    """C2: two equal elastic discs pressed together in plane strain, over Hertz (1882)."""
    figures = []
    for points in (4, 8) if full else (4,):
        width, pressure, load = _line_contact(points, scheme)
        targets = ({"at_most": 0.08}, {"at_most": 0.15}) if points == 8 else ({"at_most": 0.16}, {"at_most": 0.3})
        figures.append(Figure(f"{points} points in the half-width: its error", abs(width - 1.0), **targets[0]))
        figures.append(Figure(f"{points} points: error of the largest pressure", abs(pressure - 1.0), **targets[1]))
        figures.append(Figure(f"{points} points: load, over what is above", load, at_least=0.99, at_most=1.01))
    return figures


def line_contact_on_a_plane(full=False, scheme=DEFAULT):
    """C2: an elastic disc on a rigid plane, its points on rings and on a lattice, over Hertz (1882)."""
    figures = []
    for points in (4, 8) if full else (4,):
        width, pressure, worst = _on_a_plane(points, True, scheme)
        what = f"{points} points in the half-width, on rings"
        figures.append(Figure(f"{what}: its error", abs(width - 1.0), at_most=0.08))
        figures.append(Figure(f"{what}: error of the largest pressure", abs(pressure - 1.0), at_most=0.15))
        figures.append(Figure(f"{what}: error of the worst pressure", abs(worst - 1.0), at_most=0.15))
        if full:
            width, pressure, worst = _on_a_plane(points, False, scheme)
            figures.append(Figure(f"{points} points, on a lattice: error of the half-width", abs(width - 1.0)))
            figures.append(Figure(f"{points} points, on a lattice: largest pressure", pressure))
            figures.append(Figure(f"{points} points, on a lattice: worst pressure", worst))
    return figures


def _compressed(points, scheme):
    """Largest stress along the axis over that across of a cylinder of sand between smooth platens, by their force."""
    radius, strain = 0.05, 0.008
    spacing = radius / points
    height = 4.0 * radius
    sides = {}
    for axis in "xy":
        for sign, word, side in ((1.0, "low", "-"), (-1.0, "high", "+")):
            stress = [sign * CONFINED * (a == axis) for a in "xyz"]
            sides[f"{axis} {word}"] = {"where": {"body": "body0"}, "traction": {"stress": stress, "side": axis + side}}
    platen = {"type": "plane", "friction": 0.0, "damping": 0.3}
    speed = 0.5 * height
    sim = simulation(
        spacing, {"type": "cylinder", "base": [0, 0, 0], "axis": "z", "radius": radius, "height": height}, dimension=3,
        material=SAND, scheme=scheme, boundaries=sides,
        initial_stress={"type": "uniform", "components": {axis: -CONFINED for axis in ("xx", "yy", "zz")}},
        contacts=[platen | {"point": [0, 0, 0], "normal": [0, 0, 1]},
                  platen | {"point": [0, 0, height], "normal": [0, 0, -1], "velocity": [0, 0, -speed]}],
        stages=[{"name": "settle", "type": "relax", "tolerance": 1e-4, "boundaries": list(sides)},
                {"name": "push", "type": "dynamics", "duration": strain * height / speed, "boundaries": list(sides)}],
    )  # fmt: skip
    sim.start()
    record = Recorder(lambda s: 0.5 * np.abs(owned(s, "contact_force")[:, 2]).sum(), 10)
    sim.observers.append(record)
    area = np.count_nonzero(owned(sim, "position")[:, 2] < spacing) * spacing**2
    sim.run()
    time, force = record.columns()
    return force[time > 0.9 * time[-1]].mean() / (area * CONFINED)


def platens(full=False, scheme=DEFAULT):
    """C3: a cylinder of sand in triaxial compression between smooth platens, axial over lateral stress: 3."""
    figures = []
    for points in (3, 6) if full else (3,):
        ratio = _compressed(points, scheme)
        figures.append(Figure(f"{points} points of radius", ratio, at_least=2.88, at_most=3.12))
    return figures


def _torque(points, fitted, scheme, turn=1e-4):
    """Torque of a round bar, twisted by `turn` rad/m, over mu turn pi R^4/2; and that by its points' cells."""
    spacing, length = 1.0 / points, 2.0
    bar = {"name": "bar", "material": "soil", "lattice": "rings" if fitted else "shared",
           "shape": {"type": "cylinder", "base": [0, 0, 0], "axis": "z", "radius": 1.0, "height": length}}
    sim = simulation(
        spacing, [], dimension=3, scheme=scheme, bodies=[bar],
        boundaries={"low": {"where": {"upper": [None, None, 2 * spacing]}, "fix": ["x", "y", "z"]},
                    "high": {"where": {"lower": [None, None, length - 2 * spacing]}, "fix": ["x", "y", "z"]}},
        stages=[{"name": "settle", "type": "relax", "tolerance": 1e-4, "boundaries": ["low", "high"]}],
    )  # fmt: skip
    sim.start()
    x = owned(sim, "position").copy()
    twist = ImposedVelocity(lambda q, dt: turn * q[:, 2:] * np.stack([-q[:, 1], q[:, 0], 0.0 * q[:, 0]], axis=1) / dt)
    chosen, sim.dt = sim.dt, 1.0
    twist.apply(sim.particles, 0.0, 1.0, False)
    owned(sim, "position")[:] += owned(sim, "velocity")
    sim.evaluate_forces()
    owned(sim, "velocity")[:] = 0.0
    sim.dt = chosen
    sim.run()
    force, held = owned(sim, "internal_force"), x[:, 2] < 2 * spacing
    torque = (x[held, 0] * force[held, 1] - x[held, 1] * force[held, 0]).sum()
    layer = x[:, 2] < spacing
    area = owned(sim, "volume")[layer] / spacing
    polar = (area * (x[layer, :2] ** 2).sum(axis=1) + area**2 / 6.0).sum()
    return torque / (SHEAR * turn * np.pi / 2.0), torque / (SHEAR * turn * polar)


def torsion(full=False, scheme=DEFAULT):
    """C4: torque of a twisted round bar over mu theta pi R^4/2: its points on rings, and on a lattice."""
    figures = []
    for points in (4, 8) if full else (4,):
        (fitted, _), (cut, own) = (_torque(points, rings, scheme) for rings in (True, False))
        limit = {"at_most": 0.03} if points == 8 else {"at_most": 0.06}
        figures.append(Figure(f"{points} points of radius, on rings: error", abs(fitted - 1.0), **limit))
        figures.append(Figure(f"{points} points of radius, on a lattice", cut))
        figures.append(Figure(f"{points} points, on a lattice, over the stiffness of its cells", own))
    return figures


def _on_a_wall(points, passive, scheme, cohesion=0.0, dilation=30.0):
    """Force of sand, 1 m high, on a smooth wall that moves, over Rankine's."""
    spacing, length = 1.0 / points, 2.6 if passive else 1.4
    way, speed = (0.02, 0.02) if passive else (-0.005, 0.02)
    sim = simulation(
        spacing, box([0.0, 0.0], [length, 1.0]), scheme=scheme, gravity=[0.0, -GRAVITY],
        material=SAND | {"cohesion": cohesion, "dilation_angle": dilation},
        initial_stress={"type": "geostatic", "K0": 0.5},
        boundaries={"end": {"where": {"lower": [length - 2 * spacing, None]}, "fix": ["x"]}},
        contacts=[{"type": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.0, "damping": 0.3},
                  {"type": "box", "lower": [-0.5, -1.0], "upper": [0.0, 2.0], "friction": 0.0, "damping": 0.3,
                   "velocity": [np.copysign(speed, way), 0.0]}],
        stages=[{"name": "move", "type": "dynamics", "duration": abs(way) / speed, "boundaries": ["end"]}],
    )  # fmt: skip
    sim.start()
    record = Recorder(lambda s: owned(s, "contact_force")[:, 0].sum(), 10)
    sim.observers.append(record)
    sim.run()
    time, force = record.columns()
    earth = 3.0 if passive else 1.0 / 3.0
    exact = 0.5 * SAND["density"] * GRAVITY * earth + 2.0 * cohesion * np.sqrt(earth) * (1.0 if passive else -1.0)
    return force[time > 0.4 * time[-1]].mean() / exact


def moving_walls(full=False, scheme=DEFAULT):
    """C5: force of sand on a smooth wall that gives way or is pushed in, over Rankine's (1857)."""
    figures = []
    cases = [("active", False, 0.0), ("passive", True, 0.0), ("passive, cohesion 5 kPa", True, 5e3)]
    for what, passive, cohesion in cases if full else cases[:1]:
        force = _on_a_wall(20, passive, scheme, cohesion)
        figures.append(Figure(f"{what}, 20 points of height", force, at_least=0.97, at_most=1.03))
        for points in (10, 20) if full else ():
            force = _on_a_wall(points, passive, scheme, cohesion, dilation=0.0)
            figures.append(Figure(f"{what}, without dilation, {points} points", force))
    return figures
