"""Soil that has come apart bears nothing until it has closed: the opened strain is a state.

A law without tension (an apex of its cone, a cut-off) cannot follow a row that expands beyond it. What expands beyond
is a gap, `opened`, the volumetric strain that must be taken back before the grains touch again (Dunatunga & Kamrin
2015, J. Fluid Mech. 779). Without it every opening would be kept for ever: the law would resist at once when the gap
begins to close. A law takes part by listing `OPENED` among its state fields and telling its `tension_limit`; this
module does the rest, for any law, and a cycle of opening and closing does no work on cohesionless soil. A law without
`tension_limit`, which knows better what it expands beyond, adds to the column itself; then this module only closes.
"""

from collections.abc import Callable

import numpy as np

from periporo.core.numerics.jit import kernel
from periporo.core.numerics.tensors import mean
from periporo.core.points.material import OPENED, Material, UpdatesFailed, state_column

_AT_THE_LIMIT = 1e-9  # of the bulk modulus: so near to its limit is a stress that was returned to it


class Opening:
    """The opened strain of a law's rows, in the column `column` of their state."""

    def __init__(self, material: Material, column: int):
        self.column = column
        self._limit = getattr(material, "tension_limit", None)

    @classmethod
    def of(cls, material: Material, components: int) -> "Opening | None":
        """Of a law that has the state field `OPENED`, else None."""
        column = state_column(material, OPENED.name, components)
        return None if column is None else cls(material, column)

    def advance(self, active, stress, strain_increment, state, bulk: Callable, take: Callable[[], None]) -> None:
        """Let `take` advance the rows by their law; what is opened closes before, what expands beyond opens after.

        `bulk` gives the rows' bulk modulus (n,) Pa. What closes, or opens further, is taken from `strain_increment`.
        """
        _close(self.column, active, strain_increment, state)
        if self._limit is None:
            take()
            return
        before, modulus = mean(stress), bulk()
        take()
        _open(self.column, active, before, modulus, self._limit(stress, state), stress, strain_increment, state)


def advance_rows(material: Material, stress, strain_increment, state, dt: float) -> None:
    """`compute_stress` as a run calls it: rows that have come apart close first. Changes all three arrays.

    Raises what the law raises.
    """
    opening = Opening.of(material, stress.shape[1])
    if opening is None:
        material.compute_stress(stress, strain_increment, state, dt)
        return
    failure = []

    def take():
        try:
            material.compute_stress(stress, strain_increment, state, dt)
        except UpdatesFailed as failed:  # the others are advanced, and open
            failure.append(failed)

    active = np.ones(len(stress), bool)
    opening.advance(active, stress, strain_increment, state, lambda: material.elastic_moduli(stress, state)[0], take)
    if failure:
        raise failure[0]


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
