"""V25: plane compression of soil between smooth platens until it parts along bands.

The inclination of a band to the plane of the smaller principal stress lies between 45 degrees + psi/2 (Roscoe 1970),
along which strain leaves lengths as they are, and 45 degrees + phi/2 (Coulomb 1776), where the stress ratio is largest
(Vardoulakis 1980).
"""

import tempfile
from pathlib import Path

import numpy as np

from periporo.core.run import run
from periporo.io.output.results import open_results

from .common import DEFAULT, Figure, box

PRESSURE = 1e5  # Pa, on the sides
FRICTION, DILATION = 30.0, 10.0  # degrees
SAND = {
    "model": "drucker_prager", "density": 1800.0, "bulk_modulus": 25e6, "shear_modulus": 15e6, "cohesion": 1e3,
    "friction_angle": FRICTION, "dilation_angle": DILATION,
}  # fmt: skip
CLAY = {
    "model": "cam_clay", "grain_density": 2700.0, "porosity": 0.4, "bulk_modulus": 25e6, "shear_modulus": 15e6,
    "critical_state_slope": 1.2, "compression_index": 0.1, "swelling_index": 0.02, "preconsolidation": 6e5,
}  # fmt: skip


def compress(points, material, weak, scheme, strain, speed=1e-3):
    """First places (n, 2) m, from the middle, and shear strains (n,) of a block 1 m wide and 2 m high, and retries.

    It has `points` of width and is compressed by `strain`, at `speed` times 160 m/s, about the speed of waves. What
    is `weak` replaces keys of the material in a spot of four points in the middle.
    """
    spacing = 1.0 / points
    spot, side = 2.0 * spacing, 0.5
    shapes = [
        box([-side, -1.0], [side, -spot]), box([-side, spot], [side, 1.0]), box([-side, -spot], [-spot, spot]),
        box([spot, -spot], [side, spot]), box([-spot, -spot], [spot, spot]),
    ]  # fmt: skip
    boundaries = {
        "base": {"where": {"upper": [None, spacing - 1.0]}, "fix": ["y"]},
        "top": {"where": {"lower": [None, 1.0 - spacing]}, "velocity": {"y": -160.0 * speed}},
    }
    for name, sign, face in (("left", 1.0, "x-"), ("right", -1.0, "x+")):
        where = {"upper": [spacing - side, None]} if sign > 0.0 else {"lower": [side - spacing, None]}
        boundaries[name] = {"where": where, "traction": {"stress": [sign * PRESSURE, 0.0], "side": face}}
    scene = {
        "dimension": 2, "spacing": spacing, "correspondence": scheme,
        "materials": {"soil": material, "weak": material | weak},
        "bodies": [{"name": f"part{k}", "material": "weak" if k == 4 else "soil", "shape": shape}
                   for k, shape in enumerate(shapes)],
        "boundaries": boundaries,
        "initial_stress": {"type": "uniform", "components": {axis: -PRESSURE for axis in ("xx", "yy", "zz")}},
        "stages": [{"name": "press", "type": "dynamics", "duration": 2.0 * strain / (160.0 * speed),
                    "boundaries": list(boundaries)}],
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        file = run(scene, Path(folder) / "biaxial.vtkhdf", quiet=True)
        with open_results(file) as results:
            place = results.positions(0)[:, :2]
            return place, results.field("equivalent_shear_strain"), int(results.attributes["retries"])


def inclination(place, strain, spacing):
    """Degrees from the horizontal of the lines along which `strain` (n,) at `place` (n, 2) is most unlike elsewhere."""
    near = np.hypot(*place.T) < 0.45
    best = []
    for angle in np.arange(30.0, 75.5, 0.5):
        spread = []
        for turn in (angle, -angle):
            normal = np.array([-np.sin(np.radians(turn)), np.cos(np.radians(turn))])
            strip = np.floor((place[near] @ normal) / (2.0 * spacing)).astype(int)
            strip -= strip.min()
            count = np.bincount(strip)
            mean = np.bincount(strip, strain[near]) / np.maximum(count, 1)
            spread.append(np.sqrt(np.average((mean - strain[near].mean()) ** 2, weights=count)))
        best.append((max(spread), angle))
    return max(best)[1]


def bands(full=False, scheme=DEFAULT):
    """V25: plane compression of a block with a weak spot: inclination of its bands, and whether runs are stopped."""
    points = 64 if full else 24
    place, strain, retries = compress(points, SAND, {"friction_angle": 25.0}, scheme, 0.02, 1e-3 if full else 2e-3)
    figures = [
        Figure(f"sand, {points} points of width: degrees", inclination(place, strain, 1.0 / points),
               at_least=45.0 + 0.5 * DILATION, at_most=45.0 + 0.5 * FRICTION),
        Figure("steps that the watchdog took back", retries, at_most=0),
        Figure("strain in the bands over the mean", np.quantile(strain, 0.95) / strain.mean(), at_least=2.0),
    ]  # fmt: skip
    if full:
        place, strain, retries = compress(points, CLAY, {"preconsolidation": 4e5}, scheme, 0.04)
        figures += [
            Figure("overconsolidated Cam-Clay: degrees", inclination(place, strain, 1.0 / points)),
            Figure("steps that the watchdog took back", retries, at_most=0),
            Figure("strain in the bands over the mean", np.quantile(strain, 0.95) / strain.mean()),
        ]
    return figures
