"""Soil that has come apart bears nothing until it has closed: the opened strain is a state.

A law without tension (an apex of its cone, a cut-off) cannot follow a row that expands beyond it. What expands beyond
is a gap, `opened`, the volumetric strain that must be taken back before the grains touch again (Dunatunga & Kamrin
2015, J. Fluid Mech. 779). Without it every opening would be kept for ever: the law would resist at once when the gap
begins to close. A law takes part by listing `OPENED` among its state fields and telling its `tension_limit`; this
module does the rest, for any law, and a cycle of opening and closing does no work on cohesionless soil.
"""

import numpy as np

from periporo.core.numerics.jit import kernel
from periporo.core.points.material import OPENED, state_column

_AT_THE_LIMIT = 1e-9  # of the bulk modulus: so near to its limit is a stress that was returned to it


class Opening:
    """The opened strain of one block's rows, in the column `column` of their state."""

    def __init__(self, material, components: int):
        self.material = material
        self.column = state_column(material, OPENED.name, components)

    def close(self, active, strain_increment, state) -> None:
        """Let openings take up volumetric strain: they close, or grow, and the law sees what is left."""
        _close(self.column, active, strain_increment, state)

    def open(self, active, before, bulk, stress, strain_increment, state) -> None:
        """Open rows at their limit by what they expanded beyond it; `before` (n,) Pa is the mean stress of the trial.

        The trial stress is `before` plus `bulk` (n,) Pa times the volumetric part of `strain_increment`.
        """
        limit = self.material.tension_limit(stress, state)
        _open(self.column, active, before, bulk, limit, stress, strain_increment, state)


def mean_stress(stress: np.ndarray) -> np.ndarray:
    """A third of the trace (n,) Pa of `stress` (n, 4|6)."""
    return (stress[:, 0] + stress[:, 1] + stress[:, 2]) / 3.0


@kernel
def _close(column, active, strain, state):
    for r in range(strain.shape[0]):
        opened = state[r, column]
        if active[r] and opened > 0.0:
            taken = max(strain[r, 0] + strain[r, 1] + strain[r, 2], -opened)
            state[r, column] = opened + taken
            for c in range(3):
                strain[r, c] -= taken / 3.0


@kernel
def _open(column, active, before, bulk, limit, stress, strain, state):
    for r in range(strain.shape[0]):
        if not active[r]:
            continue
        now = (stress[r, 0] + stress[r, 1] + stress[r, 2]) / 3.0
        if now >= limit[r] - _AT_THE_LIMIT * bulk[r]:
            beyond = before[r] - now + bulk[r] * (strain[r, 0] + strain[r, 1] + strain[r, 2])
            if beyond > 0.0:
                state[r, column] += beyond / bulk[r]
