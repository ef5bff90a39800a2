"""Factors of safety by the stage `strength_reduction`, against limit equilibrium and limit analysis.

    python -m benchmarks factor_of_safety [--points 10 20] [--only slope] [--scheme bond_projected]

*slope*: 26.57 degrees (1:2) on a firm base, friction 20 degrees, cohesion .05 of gamma H: 1.376 by Bishop's slices
(1955).
*layer*: a layer of sand of 30 degrees without end, which repeats along the slope of 20 degrees, with flow that is
associated: tan(30)/tan(20) = 1.586. One that does not dilate has f with sin(phi(f)) = tan(20), tan(phi(f)) =
tan(30)/f, which is 1.477 (Davis 1968).
*cut*: a vertical cut in clay without drainage, as V21, with gamma H/c = 2.5: 3.776/2.5 = 1.510 (Martin 2011).

Found are the middle of the bracket, which is 2 % wide, over the exact one. `--points` are those of the height.
"""

import numpy as np

from periporo import Simulation

from . import option_parser

G, DENSITY = 10.0, 2000.0
ANGLE = float(np.radians(20.0))  # of the layer
EXACT = {"slope": 1.376, "layer": float(np.tan(np.radians(30.0)) / np.tan(ANGLE)), "cut": 3.776 / 2.5}

_SLOW = {"trial": 8.0, "damping": {"viscous": 3.0}, "moving": 2e-3}  # the whole layer moves, and takes its time
_FAST = {"trial": 1.5, "damping": {"viscous": 20.0}}
TRIALS = {"slope": _FAST, "layer": _SLOW, "cut": _FAST}


def search(case: str, points: int, scheme: str | None = None) -> float:
    """The factor of safety of a case with `points` of height, by the default scheme or another."""
    make = {"slope": _slope, "layer": _layer, "cut": _cut}[case]
    data = make(points) | ({} if scheme is None else {"correspondence": scheme})
    stage = {"name": "safety", "type": "strength_reduction", "boundaries": list(data["boundaries"])} | TRIALS[case]
    rest = {"name": "rest", "type": "relax", "tolerance": 1e-3, "boundaries": list(data["boundaries"])}
    sim = Simulation.from_scene(data | {"dimension": 2, "stages": [rest, stage]})
    sim.run()
    return sim.stages[-1].safety


def _soil(height, cohesion, friction, dilation=0.0, stiffness=1000.0):
    modulus = stiffness * DENSITY * G * height
    angles = {"friction_angle": friction, "dilation_angle": dilation}
    law = {"model": "mohr_coulomb", "density": DENSITY, "bulk_modulus": modulus, "shear_modulus": 0.5 * modulus}
    return {"soil": law | angles | {"cohesion": cohesion}}


def _slope(points):
    height = 10.0
    h, crest = height / points, 12.0
    corners = [[0, 0], [crest + 2.0 * height, 0], [crest, height], [0, height]]
    return {
        "spacing": h, "gravity": [0.0, -G], "materials": _soil(height, 0.05 * DENSITY * G * height, 20.0),
        "bodies": [{"name": "slope", "material": "soil", "shape": {"type": "polygon", "vertices": corners}}],
        "initial_stress": {"type": "geostatic", "K0": 0.7},
        "boundaries": {"base": {"where": {"upper": [None, h]}, "fix": ["x", "y"]},
                       "back": {"where": {"upper": [h, None]}, "fix": ["x"]}},
    }  # fmt: skip


def _layer(points):
    height = 2.0
    h = height / points
    width = 10 * h
    return {
        "spacing": h, "gravity": [float(G * np.sin(ANGLE)), float(-G * np.cos(ANGLE))],
        "materials": _soil(height, 0.0, 30.0, 30.0, stiffness=100.0),
        "bodies": [{"name": "layer", "material": "soil",
                    "shape": {"type": "box", "lower": [0, -2.0 * h], "upper": [width, height]}}],
        "periodic": {"lower": [0, None], "upper": [width, None]},
        "boundaries": {"base": {"where": {"upper": [None, 0.0]}, "fix": ["x", "y"]}},
    }  # fmt: skip


def _cut(points):
    height = 2.0
    h = height / points
    return {
        "spacing": h, "gravity": [0.0, -G], "materials": _soil(height, DENSITY * G * height / 2.5, 0.0),
        "bodies": [{"name": "ground", "material": "soil", "shape": {
            "type": "polygon", "vertices": [[0, 0], [8, 0], [8, 1], [4, 1], [4, 3], [0, 3]]}}],
        "initial_stress": {"type": "geostatic", "K0": 1.0},
        "boundaries": {"base": {"where": {"upper": [None, h]}, "fix": ["x", "y"]},
                       "back": {"where": {"upper": [h, None]}, "fix": ["x"]},
                       "front": {"where": {"lower": [8 - h, None]}, "fix": ["x"]}},
    }  # fmt: skip


def main(words=None):
    """Print the table."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--points", type=int, nargs="+", default=[10, 20], help="of the height")
    parser.add_argument("--only", choices=EXACT, help="one of the cases")
    parser.add_argument("--scheme", help="of correspondence, in place of the default")
    arguments = parser.parse_args(words)
    print("| case | exact | " + " | ".join(f"{n} points" for n in arguments.points) + " |")
    print("|---" * (2 + len(arguments.points)) + "|")
    for case in [arguments.only] if arguments.only else EXACT:
        found = [search(case, n, arguments.scheme) / EXACT[case] for n in arguments.points]
        print(f"| {case} | {EXACT[case]:.3f} | " + " | ".join(f"{f:.3f}" for f in found) + " |", flush=True)
