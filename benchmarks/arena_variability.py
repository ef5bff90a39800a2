"""What a bond makes of the Weibull draws of its two ends: distribution at points, bonds, and point averages.

    python -m benchmarks arena_variability [figure.png]
"""

import math

import numpy as np

from periporo.materials.arena.variability import strength_factors

from . import option_parser

MODULUS, REFERENCE_VOLUME, VOLUME, SEED = 4.0, 1e-3, 1e-6, 1
SIDE, REACH = 120, 2  # points per side of a square grid, and how many points a bond spans at most


def grid_bonds():
    """Ends (m, 2) of all bonds of a square grid that span at most REACH points."""
    ids = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    bonds = []
    for dx in range(REACH + 1):
        for dy in range(-REACH, REACH + 1):
            if (dx, dy) <= (0, 0) or dx * dx + dy * dy > REACH * REACH:
                continue
            first = ids[: SIDE - dx, max(0, -dy) : SIDE - max(0, dy)]
            second = ids[dx:, max(0, dy) : SIDE + min(0, dy)]
            bonds.append(np.stack([first.ravel(), second.ravel()], axis=1))
    return np.concatenate(bonds)


def averages(bonds, values):
    """Mean of `values` over the bonds of each point."""
    total = np.bincount(bonds[:, 0], values, minlength=SIDE * SIDE)
    total += np.bincount(bonds[:, 1], values, minlength=SIDE * SIDE)
    return total / np.bincount(bonds.ravel())


def main(words=None):
    """Print the quantiles; draw the densities if a figure is named."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("figure", nargs="?", help="file of a picture of the densities")
    figure = parser.parse_args(words).figure
    points = np.repeat(np.arange(SIDE * SIDE)[:, None], 2, axis=1)
    bonds = grid_bonds()
    size = (REFERENCE_VOLUME / VOLUME) ** (1 / MODULUS)

    def factors(ids):
        return strength_factors(ids, np.full(len(ids), VOLUME), MODULUS, MODULUS, REFERENCE_VOLUME, SEED) / size

    samples = {"points": factors(points), "bonds": factors(bonds)}
    samples["bonds averaged at points"] = averages(bonds, samples["bonds"])
    law = np.linspace(0.01, 2.0, 200)
    scale = 1 / math.gamma(1 + 1 / MODULUS)
    print(f"strength factor over the size effect {size:.4g}; Weibull modulus {MODULUS:g}")
    print("quantile          " + "".join(f"{q:8.0%}" for q in (0.05, 0.25, 0.5, 0.75, 0.95)) + "    mean   s.d.")
    quantiles = np.array([0.05, 0.25, 0.5, 0.75, 0.95])
    exact = scale * (-np.log1p(-quantiles)) ** (1 / MODULUS)
    spread = scale * math.sqrt(math.gamma(1 + 2 / MODULUS) - math.gamma(1 + 1 / MODULUS) ** 2)
    rows = {"Weibull law": (exact, 1.0, spread)}
    for name, sample in samples.items():
        rows[name] = (np.quantile(sample, quantiles), sample.mean(), sample.std())
    for name, (values, mean, deviation) in rows.items():
        print(f"{name:24s}" + "".join(f"{v:8.3f}" for v in values) + f"{mean:8.3f}{deviation:7.3f}")
    if figure:
        import matplotlib.pyplot as plt

        for name, sample in samples.items():
            plt.hist(sample, bins=80, density=True, histtype="step", label=name)
        density = MODULUS / scale * (law / scale) ** (MODULUS - 1) * np.exp(-((law / scale) ** MODULUS))
        plt.plot(law, density, "k--", label="Weibull law")
        plt.xlabel("strength factor / size effect")
        plt.ylabel("density")
        plt.legend()
        plt.savefig(figure, dpi=150)
