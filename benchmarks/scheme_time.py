"""Time per point of the schemes, one core.

    python -m benchmarks scheme_time [points]

Prints the two halves of each scheme, elastic, and then the whole step of Cam-Clay that is sheared so that every row
flows, in turns, with the time of bond_projected over that of the scheme. Processor time, the least of some runs.
"""

import time

import numpy as np

from . import option_parser
from .library.blocks import block as soil_block
from .library.blocks import shear
from .library.elastic_block import block
from .library.verification_cases import OPTIONS

REPEATS = 9
CASES = ((2, "cubic", 2.2), (2, "cubic", 3.0), (3, "cubic", 2.2), (3, "cubic", 3.0))
ENERGY_CONSISTENT = ("bond_projected", "point_state", "point_state, sharpened", "sub_horizon", "standard")
STEPS = 20


def processor_time(function) -> float:
    """Of one call, s: other work on the machine must not count."""
    began = time.process_time()
    function()
    return time.process_time() - began


def best(function) -> float:
    """Shortest of some calls, s."""
    return min(processor_time(function) for _ in range(REPEATS))


def halves(points):
    """Table of microseconds per point of strain and force."""
    print("| scheme | d | m | neighbours | rows per point | strain µs | force µs |\n|---|---|---|---|---|---|---|")
    for (d, influence, m), scheme in ((case, s) for case in CASES for s in (*ENERGY_CONSISTENT, "published")):
        sim = block((round(points ** (1 / d)),) * d, scheme, influence, m, 0.0)
        p, b = sim.particles, sim.bonds
        strain = best(lambda s=sim: s.scheme.deform(s.particles, s.bonds, s.halo, 1e-9, 1e-9))
        force = best(lambda s=sim: s.scheme.internal_force(s.particles, s.bonds, s.halo, s.particles.internal_force))
        neighbours = 2 * np.count_nonzero(b.pairs.weight) / p.owned
        rows = sum(block.active.sum() for block in b.blocks) / p.owned
        scale = 1e6 / p.owned
        print(f"| {scheme} | {d} | {m} | {neighbours:.1f} | {rows:.1f} | {strain * scale:.3f} | {force * scale:.3f} |")


def flowing(points):
    """Table of microseconds per point of the step of a soil that flows everywhere."""
    print("\n| scheme | d | m | step of flowing Cam-Clay µs | bond_projected / scheme |\n|---|---|---|---|---|")
    for d, _, m in CASES:
        side = round(points ** (1 / d))
        sims = {s: soil_block(d, side, "cam_clay", m, OPTIONS.get(s, s)) for s in ENERGY_CONSISTENT}
        seconds = {s: np.inf for s in sims}
        for _ in range(REPEATS):
            for name, sim in sims.items():
                steps = 2 if name == "sub_horizon" else STEPS
                seconds[name] = min(seconds[name], processor_time(lambda s=sim, n=steps: advance(s, n)) / steps)
        for name, value in seconds.items():
            ratio = seconds["bond_projected"] / value
            print(f"| {name} | {d} | {m} | {value * 1e6 / side**d:.3f} | {ratio:.2f} |", flush=True)


def advance(sim, steps):
    """Steps of simple shear."""
    for _ in range(steps):
        shear(sim)
        sim.step()


def main(words=None):
    """Print both tables."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("points", type=int, nargs="?", default=8000, help="points of a block, about")
    count = parser.parse_args(words).points
    halves(count)
    flowing(count)
