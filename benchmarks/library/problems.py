"""Problems with known answers, and the errors of a scheme in them: what `pareto` sets against run time.

A `choice` has a `correspondence`, the scheme as in the input file, and `keys()`, more of its keys.
"""

import numpy as np

from ..aluminium_bars import collapse as bars
from ..aluminium_bars import compare
from .verification_cases import collapse, columns, footing, manufactured, surfaces, waves
from .verification_cases.common import P_SPEED, S_SPEED, owned


def wave_error(cells, choice):
    """Root mean square of the relative errors of the phase speeds of P and S waves, `cells` to the wavelength."""
    keys = choice.keys()
    keys["safety"] = keys.pop("time_step")["safety"]
    speeds = [waves.phase_speed(cells, shear, choice.correspondence, **keys) for shear in (False, True)]
    return float(np.sqrt(np.mean((np.array(speeds) / [P_SPEED, S_SPEED] - 1.0) ** 2)))


def grid_error(cells, choice):
    """Relative error of the manufactured solution on a grid."""
    return manufactured.solution_error(cells, 0.0, choice.correspondence, **choice.keys())


def cloud_error(cells, choice):
    """Relative error of the manufactured solution on a cloud of 10 % jitter."""
    return manufactured.solution_error(cells, 0.1, choice.correspondence, **choice.keys())


def settlement_error(rows, choice):
    """Relative error of the settlement of the highest points of a column."""
    return columns.settled(rows, choice.correspondence, **choice.keys())[1]


def footing_error(points, choice):
    """Relative error of the load of a smooth box, `points` wide, that is pushed into clay: 2 + pi strengths."""
    load = surfaces.pushed_down(points, choice.correspondence, **choice.keys())
    return abs(load / footing.EXACT - 1.0)


def bars_error(rows, choice):
    """Root mean square distance of the surface of a fallen pile from the measured one, over its height of .1 m."""
    sim, moved = bars(0.1 / rows, correspondence=choice.correspondence, **choice.keys())
    return compare(owned(sim, "position"), moved, 0.1 / rows)["surface"] / 0.1


def deposit(cells, choice, seed):
    """Quantiles (2, 200) of |x| and y of the soil at rest, in half-widths; `cells` to the width."""
    sim = collapse.fallen(0.1 / cells, choice.correspondence, jitter=0.02, seed=seed, **choice.keys())
    levels = (np.arange(200) + 0.5) / 200
    quantiles = [np.quantile(np.abs(owned(sim, "position")[:, 0]), levels)]
    return np.stack([*quantiles, np.quantile(owned(sim, "position")[:, 1], levels)]) / 0.05


def distance(one, other):
    """Mean distance of quantiles (2, n), that is of sorted positions."""
    return float(np.sqrt((np.abs(one - other).mean(axis=1) ** 2).sum()))
