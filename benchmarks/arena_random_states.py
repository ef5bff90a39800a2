"""Arena on random states and increments: counts failures, NaN and states off the yield surface.

    python -m benchmarks arena_random_states [1000000]     # number of increments

Each group of rows has random BETA (.3-2), CR (.05-.95) and saturation (0, 1 or between). A row is brought
to a random state by two random increments and then takes the increment that counts; |de| up to 0.2, and to 0.02 in the
half of the groups whose pore pressure follows the elastic strain, too (beyond it, water gets as stiff as grains).
"""

import time

import numpy as np

from periporo.core.points.material import UpdatesFailed
from periporo.materials.arena import Arena

from . import option_parser

GROUP = 10_000


def random_increments(rng, n, largest=0.2):
    """Strain increments (n, 6) of random direction, their size down to 1e-8 of the `largest`."""
    direction = rng.normal(size=(n, 6))
    isotropic = rng.random(n) < 0.2
    direction[isotropic, :3] = -np.abs(direction[isotropic, :1])
    direction[isotropic, 3:] = 0.0
    size = largest * 10.0 ** (-7.3 * rng.random(n) ** 2)
    norm = np.sqrt((direction[:, :3] ** 2).sum(1) + 2 * (direction[:, 3:] ** 2).sum(1))
    return direction * (size / norm)[:, None]


def run(total, seed=0, tolerance=1e-3):
    """Dictionary of counts over `total` increments."""
    rng = np.random.default_rng(seed)
    counts = dict(increments=0, failed=0, not_finite=0, outside=0, largest_excess=0.0)
    while counts["increments"] < total:
        n = min(GROUP, total - counts["increments"])
        saturation = float(rng.choice([0.0, 1.0, rng.random(), rng.random() ** 4, 1 - rng.random() ** 4]))
        pore_pressure, largest = [("plastic", 0.2), ("total", 0.02)][int(rng.integers(2))]
        material = Arena(
            initial_saturation=saturation,
            BETA=float(rng.uniform(0.3, 2.0)),
            BETA_above_1="allow",
            CR=float(rng.uniform(0.05, 0.95)),
            p1_sat=float(rng.choice([1.0, 0.3])),
            pore_pressure=pore_pressure,
            T1=0.0,
            T2=0.0,
            tolerance=tolerance,
        )
        stress = np.zeros((n, 6))
        state = material.initial_state(stress, np.zeros((n, 2), np.int64), np.ones(n))
        for _ in range(3):
            try:
                material.compute_stress(stress, random_increments(rng, n, largest), state, 1.0)
            except UpdatesFailed as failure:
                counts["failed"] += len(failure.rows)
        counts["increments"] += n
        counts["not_finite"] += int((~np.isfinite(stress).all(1) | ~np.isfinite(state).all(1)).sum())
        excess = material.yield_excess(stress, state)
        counts["outside"] += int((excess > 1e-6).sum())
        counts["largest_excess"] = max(counts["largest_excess"], float(excess.max()))
    return counts


def main(words=None):
    """Print what went wrong, and the time."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("increments", type=int, nargs="?", default=1_000_000, help="number of increments")
    increments = parser.parse_args(words).increments
    start = time.perf_counter()
    print(run(increments))
    print(f"{time.perf_counter() - start:.1f} s")
