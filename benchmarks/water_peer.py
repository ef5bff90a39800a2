"""This program beside FiPy: rain through a strip lifts a water table (Vauclin, Khanji & Vachaud 1979).

    python -m benchmarks water_peer [--spacing 0.1]

Half of their slab of sand, 3 m wide and 2 m high, whose water table stands at .65 m; 14.8 cm/h fall on the half metre
beside the middle for 8 h, and the far side keeps its water. Retention and conductivity are theirs. FiPy solves the
equation of Richards on square cells, by modified Picard iterations, which keep the water (Celia, Bouloutas & Zarba
1990), in steps of two minutes; this program has points in the places of the cells, whose grains stand still, in
`quasi_static` stages. Prints the water table under the strip and 1 m from it, what has flowed out, and processor
time. `pip install fipy` brings FiPy.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

from periporo.core.scene.build import build
from periporo.core.water.flow import FlowingWater
from periporo.io.input.load import parse_scene
from periporo.io.output.water_table import water_table

from . import option_parser

WIDTH, HEIGHT, TABLE, STRIP = 3.0, 2.0, 0.65, 0.5  # m
RAIN, CONDUCTIVITY, PORES = 0.148 / 3600.0, 0.35 / 3600.0, 0.3  # m/s, m/s, 1
HOURS = (2, 3, 4, 8)
PLACES = (0.0, 1.0)  # m from the middle
_WEIGHT, _STEP, _MOST_ITERATIONS = 9810.0, 120.0, 100  # N/m^3, s, 1
_AGREED, _LARGEST = 1e-5, 0.1  # m, between iterations: when they are over, and what one may change


def saturation(head):
    """S (n,) at a pressure head (n,) m."""
    return 40000.0 / (40000.0 + (100.0 * np.maximum(-head, 0.0)) ** 2.9)


def relative_conductivity(head):
    """k_r (n,) at a pressure head (n,) m."""
    return 2.99e6 / (2.99e6 + (100.0 * np.maximum(-head, 0.0)) ** 5)


def by_points(spacing):
    """Water tables (hours, places) m, and outflow (hours,) m^2, of this program; processor time, s."""
    suction = _WEIGHT * np.concatenate([[0.0], np.geomspace(0.01, 3.0, 200)])
    fills, conducts = saturation(-suction / _WEIGHT), relative_conductivity(-suction / _WEIGHT)
    side = {"lower": [WIDTH - spacing, None]}
    strip = {"lower": [None, HEIGHT - spacing], "upper": [STRIP, None]}
    boundaries = {
        "grains": {"where": {"body": "slab"}, "fix": ["x", "y"]},
        "rain": {"where": strip, "water": {"flux": RAIN, "side": "y+"}},
        "side": {"where": side, "water": {"head": TABLE, "side": "x+"}},
    }
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "sand.csv"
        rows = np.column_stack([suction, fills, conducts])
        np.savetxt(table, rows, delimiter=",", header="suction,saturation,conductivity", comments="")
        sim = build(parse_scene({
            "dimension": 2, "spacing": spacing, "gravity": [0.0, -9.81],
            "materials": {"sand": {"model": "elastic", "density": 1600, "bulk_modulus": 1e7, "shear_modulus": 6e6}},
            "bodies": [{"name": "slab", "material": "sand",
                        "shape": {"type": "box", "lower": [0.0, 0.0], "upper": [WIDTH, HEIGHT]}}],
            "pore_water": {"water_table": TABLE, "largest_suction": _WEIGHT * HEIGHT, "drainage": "flowing",
                           "porosity": PORES, "conductivity": CONDUCTIVITY, "retention": {"table": str(table)}},
            "boundaries": boundaries,
            "stages": [{"name": f"to {hour} h", "type": "quasi_static", "duration": 3600.0 * length, "accuracy": 0.005,
                        "boundaries": list(boundaries)}
                       for hour, length in zip(HOURS, np.diff([0, *HOURS]), strict=True)],
        }), MPI.COMM_SELF)  # fmt: skip
    began = time.process_time()
    sim.start()
    water = next(part for part in sim.point_processes if isinstance(part, FlowingWater))
    levels, out = [], []
    for stage in sim.stages:
        stage.run(sim, False)
        p = sim.particles
        place = np.pad(p.position, ((0, 0), (0, 1)))
        found = water_table(place, p.pore_pressure, spacing, 1, 1.0, _WEIGHT)
        levels.append(np.interp(PLACES, found[:, 0], found[:, 1]))
        sums = water.histories()
        out.append(sums["water_outflow"] - sums["water_inflow"] + RAIN * STRIP * sim.time)
    return np.array(levels), np.array(out), time.process_time() - began


def by_fipy(spacing):
    """The same of FiPy, on cells of a side of `spacing` m."""
    from fipy import CellVariable, DiffusionTerm, FaceVariable, Grid2D, ImplicitSourceTerm

    mesh = Grid2D(nx=round(WIDTH / spacing), ny=round(HEIGHT / spacing), dx=spacing, dy=spacing)
    x, y = mesh.cellCenters.value
    head = CellVariable(mesh=mesh, value=TABLE - y)
    head.constrain(TABLE - mesh.faceCenters[1], mesh.facesRight)
    falls = RAIN / spacing * ((y > HEIGHT - spacing) & (x < STRIP))  # 1/s
    upwards = FaceVariable(mesh=mesh, rank=1, value=0.0)
    conducts = FaceVariable(mesh=mesh, value=0.0)
    capacity, known = CellVariable(mesh=mesh), CellVariable(mesh=mesh)
    inner = ~mesh.exteriorFaces.value
    equation = (
        ImplicitSourceTerm(coeff=capacity) == known + DiffusionTerm(coeff=conducts) + upwards.divergence
    )
    began, levels, out, stored = time.process_time(), [], [], PORES * saturation(head.value)
    start = stored.sum()
    for number in range(1, round(3600.0 * HOURS[-1] / _STEP) + 1):
        for _ in range(_MOST_ITERATIONS):
            h = head.value.copy()
            kr = CellVariable(mesh=mesh, value=CONDUCTIVITY * relative_conductivity(h)).arithmeticFaceValue.value
            conducts.setValue(kr)
            upwards.setValue(np.stack([np.zeros_like(kr), kr * inner]))
            slope = PORES * (saturation(h + 1e-6) - saturation(h - 1e-6)) / 2e-6
            capacity.setValue(slope / _STEP)
            known.setValue((slope * h - PORES * saturation(h) + stored) / _STEP + falls)
            equation.solve(var=head)
            change = np.clip(head.value - h, -_LARGEST, _LARGEST)
            head.setValue(h + change)
            if np.abs(change).max() < _AGREED:
                break
        stored = PORES * saturation(head.value)
        hours = number * _STEP / 3600.0
        if any(abs(hours - hour) < 1e-9 for hour in HOURS):
            place = np.column_stack([x, y, 0.0 * x])
            found = water_table(place, _WEIGHT * head.value, spacing, 1, 1.0, _WEIGHT)
            levels.append(np.interp(PLACES, found[:, 0], found[:, 1]))
            out.append(RAIN * STRIP * 3600.0 * hours - spacing**2 * (stored.sum() - start))
    return np.array(levels), np.array(out), time.process_time() - began


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--spacing", type=float, default=0.1, help="m between points, and side of cells")
    spacing = parser.parse_args(words).spacing
    try:
        import fipy  # noqa: F401
    except ImportError:
        sys.exit("this needs FiPy: pip install fipy")
    by_points(2.0 * spacing)  # compiles
    (own, left, seconds), (theirs, away, took) = by_points(spacing), by_fipy(spacing)
    print("| after | program | water table, m, " + " | ".join(f"{place:g} m from the middle" for place in PLACES)
          + " | flowed out, m^2 |\n|---|---|---|---|---|")  # fmt: skip
    for k, hour in enumerate(HOURS):
        for name, level, gone in (("periporo", own, left), ("FiPy", theirs, away)):
            print(f"| {hour} h | {name} | {level[k, 0]:.3f} | {level[k, 1]:.3f} | {gone[k]:.4f} |")
    print(f"\nprocessor time: {seconds:.1f} s, FiPy {took:.1f} s; {len(PLACES) * len(HOURS)} levels differ by "
          f"{np.abs(own - theirs).max():.3f} m at most")  # fmt: skip
