"""Rows of Arena whose parameters vary, answered at once, and what is said of rows whose update fails."""

import numpy as np

from periporo.core.points.material import UpdatesFailed
from periporo.materials.arena.elasticity import fill_each_moduli
from periporo.materials.arena.kernel import update_each


class ArenaRows:
    """Rows with a law each: `laws` (n,), which differ in numbers alone."""

    def __init__(self, laws):
        self._law = laws[0]
        self._constants = tuple(np.array(parts) for parts in zip(*(law._packed for law in laws), strict=True))

    def compute_stress(self, stress, strain_increment, state, dt):
        """As the law does, for all rows. Raises UpdatesFailed."""
        failed = np.empty(len(stress), np.bool_)
        columns = self._law._columns[stress.shape[1]]
        update_each(*self._constants, columns, stress, strain_increment, state, float(dt), failed)
        tell_failed(np.flatnonzero(failed))

    def elastic_moduli(self, stress, state):
        """Bulk and shear modulus of the rows, two (n,) arrays in Pa."""
        return self._law._moduli(fill_each_moduli, self._constants, stress, state)


def tell_failed(rows: np.ndarray) -> None:
    """Raise UpdatesFailed if there are any of these rows."""
    if len(rows):
        reason = "the return to the yield surface did not converge within its substeps; smaller steps may help"
        raise UpdatesFailed(rows, reason)
