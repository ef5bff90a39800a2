"""V27, V28: undrained clay that flows round a bar, and one in which a cavity opens, from the forces on obstacles.

The clay obeys Tresca's criterion, `mohr_coulomb` without friction, has no weight, and is under an even pressure, so
that it stays on the bar all round. A rough bar is one on which it does not slide: where its own strength is used up.
"""

import tempfile
from pathlib import Path

import numpy as np

from .common import DEFAULT, Figure, Recorder, box, simulation

STRENGTH = 20e3  # Pa, undrained
PRESSURE = 20.0 * STRENGTH
_EVEN = {"type": "uniform", "components": dict.fromkeys(("xx", "yy", "zz"), -PRESSURE)}
RESISTANCE = {"smooth": 6.0 + np.pi, "rough": 4.0 * np.sqrt(2.0) + 2.0 * np.pi}  # Randolph & Houlsby (1984)
DIAMETER, RIM = 1.0, 2.5  # of the bar, m; radius of the clay, which is held there
WAY, STEADY = 0.15, 0.05  # of the bar, and from where on its force is the mean, diameters
CAVITY, FAR, ROWS = 0.5, 30.0, 4  # first radius of the cavity and that of the clay, m; rows of rings
STIFFNESS = 50.0  # shear modulus over strength, of clay with a cavity


def _clay(stiffness, bulk):
    """A clay of that shear modulus over its strength, and bulk over shear modulus."""
    shear = stiffness * STRENGTH
    return {"model": "mohr_coulomb", "density": 1800.0, "bulk_modulus": bulk * shear, "shear_modulus": shear,
            "cohesion": STRENGTH, "friction_angle": 0.0}  # fmt: skip


def _half_rings(inner, outer, spacing):
    """Points and volumes (n, 3) m, m^2 on half circles about the origin with x > 0."""
    rows = []
    for low in inner + spacing * np.arange(round((outer - inner) / spacing)):
        radius = low + 0.5 * spacing
        count = round(np.pi * radius / spacing)
        angle = np.pi * ((np.arange(count) + 0.5) / count - 0.5)
        volume = np.full(count, np.pi * radius * spacing / count)
        rows.append(np.column_stack([radius * np.cos(angle), radius * np.sin(angle), volume]))
    return np.concatenate(rows)


def _history(sim, name, axis):
    """Ways (k,) m of the obstacle `name` along an axis, and forces (k,) N that it exerts, in a run of all stages."""
    (part,) = (part for part in sim.reactions if getattr(part, "name", "") == name)

    def look(sim):
        told = part.histories(sim)
        return told[f"{name}_displacement_{axis}"], -told[f"{name}_force_{axis}"]

    record = Recorder(look, 5)
    sim.observers.append(record)
    sim.start()
    sim.run()
    return record.columns()[1:]


def bar_resistance(points, friction, scheme=DEFAULT, speed=0.1):
    """Way (k,) of a bar over its diameter, of `points`, and force (k,) over strength and diameter."""
    spacing, radius = DIAMETER / points, 0.5 * DIAMETER
    with tempfile.TemporaryDirectory() as folder:
        shapes = []
        for name, ends in {"clay": (radius, RIM - 2 * spacing), "rim": (RIM - 2 * spacing, RIM)}.items():
            shapes.append({"type": "points", "file": str(Path(folder) / f"{name}.csv")})
            rows = _half_rings(*ends, spacing)
            np.savetxt(shapes[-1]["file"], rows, delimiter=",", header="x,y,volume", comments="")
        sim = simulation(
            spacing, shapes, scheme=scheme, material=_clay(100.0, 5.0), initial_stress=_EVEN,
            symmetry={"lower": [0, None]}, boundaries={"rim": {"where": {"body": "body1"}, "fix": ["x", "y"]}},
            contacts=[{"type": "disc", "name": "bar", "center": [0, 0], "radius": radius, "friction": friction,
                       "velocity": {"y": {"times": [0, 0.02], "values": [0, speed]}}}],
            stages=[{"name": "pull", "type": "dynamics", "duration": WAY * DIAMETER / speed, "boundaries": ["rim"],
                     "damping": {"viscous": 5.0}}],
        )  # fmt: skip
    way, force = _history(sim, "bar", "y")
    return way / DIAMETER, 2.0 * force / (DIAMETER * STRENGTH)


def flow_round_a_bar(full=False, scheme=DEFAULT):
    """V27: bar pulled across undrained clay, force over strength and diameter: 6 + pi smooth, 4 sqrt(2) + 2 pi rough.
    """
    figures = []
    for name, exact in RESISTANCE.items():
        for points in (8, 16, 32) if full else (8,):
            way, force = bar_resistance(points, 0.0 if name == "smooth" else 1.0, scheme)
            found = force[way > STEADY].mean()
            figures += [
                Figure(f"{name}, {points} points of diameter ({exact:.2f})", found),
                Figure("relative error", abs(found / exact - 1.0), at_most=0.15 if points == 8 else 0.08),
            ]
    return figures


def cavity_pressure(points, scheme=DEFAULT, opened=2.0):
    """Radius (k,) over the first one, of `points`, of a cavity that opens, and pressure (k,) over the strength."""
    spacing = CAVITY / points
    speed, height = 0.25, ROWS * spacing
    sim = simulation(
        spacing, box([CAVITY, 0.0], [FAR, height]), scheme=scheme, material=_clay(STIFFNESS, 20.0),
        axisymmetric=True, initial_stress=_EVEN,
        boundaries={
            "plane": {"where": {"body": "body0"}, "fix": ["y"]},
            "far": {"where": {"lower": [FAR - spacing, None]}, "traction": {"stress": [-PRESSURE, 0.0], "side": "x+"}},
        },
        contacts=[{"type": "plane", "name": "cavity", "point": [CAVITY, 0], "normal": [1, 0], "friction": 0,
                   "velocity": {"x": {"times": [0, 0.1], "values": [0, speed]}}}],
        stages=[{"name": "open", "type": "dynamics", "duration": (opened - 1.0) * CAVITY / speed + 0.05,
                 "boundaries": ["plane", "far"], "damping": {"viscous": 1.0}}],
    )  # fmt: skip
    way, force = _history(sim, "cavity", "x")
    radius = CAVITY + way
    return radius / CAVITY, (force / (2.0 * np.pi * radius * height) - PRESSURE) / STRENGTH


def exact_pressure(radius):
    """Pressure on the wall over the strength, by the radius over the first one (Gibson & Anderson 1961).

    In incompressible clay under an even pressure at its outer radius, where the clay that yields, to the radius
    sqrt(G/s_u (a^2 - a_0^2)), begins to count.
    """
    yielding = STIFFNESS * (radius**2 - 1.0) * (CAVITY / FAR) ** 2
    return 1.0 + np.log(STIFFNESS * (1.0 - radius**-2.0)) - yielding


def cavity(full=False, scheme=DEFAULT):
    """V28: cavity that opens in undrained clay, pressure over strength: 1 + ln(G/s_u (1 - a0^2/a^2))."""
    figures = []
    for points in (8, 16) if full else (4,):
        radius, found = cavity_pressure(points, scheme, 2.0 if full else 1.5)
        error = found / exact_pressure(radius) - 1.0
        for ends in ((1.25, 1.5), (1.5, 1.75), (1.75, 2.0)) if full else ((1.25, 1.5),):
            within = (radius > ends[0]) & (radius < ends[1])
            what = f"{points} points, mean error at {ends[0]} to {ends[1]} first radii"
            most = {4: 0.13, 8: 0.08}.get(points, 0.05)
            figures.append(Figure(what, error[within].mean(), at_least=-most, at_most=most))
        if full:
            largest = found[radius > 1.9].mean() / (1.0 + np.log(STIFFNESS))
            figures.append(Figure("pressure at twice the radius, over its limit (0.943)", largest))
    return figures
