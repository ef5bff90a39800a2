"""Explicit stages of second order whose stability grows with the square of their number (RKL2).

Meyer, Balsara & Aslam (2014). They need no inner products, so that bits do not depend on the ranks.
"""

import numpy as np

EULER = 0.8  # of the longest stable explicit step


def stages_for(courant: float) -> float:
    """Stages for a step of `courant` longest explicit ones: 1, an explicit step, or odd from 3 on; NaN stays."""
    if courant <= EULER:
        return 1
    stages = np.ceil(0.5 * (np.sqrt(9.0 + 16.0 * courant / EULER) - 1.0))
    return max(3, int(stages) + 1 - int(stages) % 2) if np.isfinite(stages) else stages


def integrate(rate, start: np.ndarray, dt: float, stages: int) -> np.ndarray:
    """State after `dt` s of d(state)/dt = rate(state) from `start`, by an explicit step or RKL2 (see the module)."""
    first = rate(start)
    if stages == 1:
        return start + dt * first
    w = 4.0 / (stages**2 + stages - 2)
    b = [1.0 / 3.0] * 3 + [(j * j + j - 2.0) / (2.0 * j * (j + 1.0)) for j in range(3, stages + 1)]
    older, old = start, start + b[1] * w * dt * first
    for j in range(2, stages + 1):
        mu, nu = (2 * j - 1) / j * b[j] / b[j - 1], -(j - 1) / j * b[j] / b[j - 2]
        new = mu * (old - start) + nu * (older - start) + start
        new += mu * w * dt * (rate(old) - (1.0 - b[j - 1]) * first)
        older, old = old, new
    return old
