"""Time per point of the two halves of each scheme, elastic: python benchmarks/scheme_time.py [points]"""

import sys
import time

import numpy as np
from stability import SCHEMES, block

REPEATS = 9
CASES = ((2, "cubic", 2.2), (2, "cubic", 3.0), (3, "cubic", 2.2), (3, "cubic", 3.0))


def best(function) -> float:
    """Shortest of some runs, s."""
    times = []
    for _ in range(REPEATS):
        began = time.process_time()  # other work on the machine must not count
        function()
        times.append(time.process_time() - began)
    return min(times)


def main():
    """Table of microseconds per point."""
    points = int(sys.argv[1]) if len(sys.argv) > 1 else 8000
    print("| scheme | d | m | neighbours | rows per point | strain µs | force µs |\n|---|---|---|---|---|---|---|")
    for (d, influence, m), scheme in ((case, s) for case in CASES for s in list(SCHEMES)[:4]):
        sim = block((round(points ** (1 / d)),) * d, scheme, influence, m, 0.0)
        p, b = sim.particles, sim.bonds
        strain = best(lambda s=sim: s.scheme.deform(s.particles, s.bonds, s.halo, 1e-9, 1e-9))
        force = best(lambda s=sim: s.scheme.internal_force(s.particles, s.bonds, s.halo, s.particles.internal_force))
        neighbours = 2 * np.count_nonzero(b.pairs.weight) / p.owned
        rows = sum(block.active.sum() for block in b.blocks) / p.owned
        scale = 1e6 / p.owned
        print(f"| {scheme} | {d} | {m} | {neighbours:.1f} | {rows:.1f} | {strain * scale:.3f} | {force * scale:.3f} |")


if __name__ == "__main__":
    main()
