"""Which way is up: one rule for doubts of `check` and for pictures."""

from collections.abc import Sequence

import numpy as np


def vertical_axis(gravity: Sequence[float] | None, dimension: int) -> int:
    """Index of the axis against which gravity pulls most, so that down is down; without gravity the last one.

    On a chute gravity may pull as much along x, where the soil runs, as against y: up is y all the same.
    """
    if gravity is None or not any(gravity):
        return dimension - 1
    return int(np.argmin(gravity) if min(gravity) < 0.0 else np.argmax(gravity))
