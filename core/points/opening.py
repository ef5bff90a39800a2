"""Soil that has come apart bears nothing until it has closed: the opened strain is a state.

A law without tension (an apex of its cone, a cut-off) cannot follow a row that expands beyond it. What expands beyond
is a gap, `opened`, the volumetric strain that must be taken back before the grains touch again (Dunatunga & Kamrin
2015, J. Fluid Mech. 779). Without it every opening would be kept for ever: the law would resist at once when the gap
begins to close. A law takes part by listing `OPENED` among its state fields and telling its `tension_limit`; this
module does the rest, for any law, and a cycle of opening and closing does no work on cohesionless soil. Soil that
dilates while it is open expands into the gap. A law without `tension_limit`, which knows better what it expands beyond,
adds to the column, and fills it, itself; then this module only closes.
"""

from collections.abc import Callable

import numpy as np

from periporo.core.numerics.jit import kernel
from periporo.core.numerics.tensors import mean
from periporo.core.points.material import OPENED, Material, UpdatesFailed, state_column

_LARGEST_DILATANCY = 2.0  # volumetric strain over shear strain: no soil dilates by more
_MARGIN = 4.0  # over the strain that takes a pressure away: shear stress goes with it, which makes pressure, too
_AT_THE_LIMIT = 1e-9  # of the bulk modulus: so near to its limit is a stress that was returned to it


class Opening:
    """The opened strain of a law's rows, in the column `column` of their state."""

    def __init__(self, material: Material, column: int):
        self.column = column
        self._limit = getattr(material, "tension_limit", None)
        self._dilatancy = _LARGEST_DILATANCY if getattr(material, "exchanges_stress", False) else 0.0

    @classmethod
    def of(cls, material: Material, components: int) -> "Opening | None":
        """Of a law that has the state field `OPENED`, else None."""
        column = state_column(material, OPENED.name, components)
        return None if column is None else cls(material, column)

    def advance(self, active, stress, strain_increment, state, bulk: Callable, take: Callable[[], None]) -> None:
        """Let `take` advance the rows by their law; what is opened closes before, what expands beyond opens after.

        `bulk` gives the rows' bulk modulus (n,) Pa. What closes, or opens further, is taken from `strain_increment`.
        """
        if self._limit is None:
            _close(self.column, active, strain_increment, state)
            take()
            return
        before, modulus = mean(stress), bulk()
        _close(self.column, active, strain_increment, state)
        limit = self._limit(stress, state)
        _fill(self.column, active, before, modulus, limit, self._dilatancy, strain_increment, state)
        take()
        limit = self._limit(stress, state)
        _open(self.column, active, before, modulus, limit, stress, strain_increment, state)
        if self._dilatancy == 0.0:
            _release(self.column, active, before, modulus, limit, stress, state)


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
def _fill(column, active, before, bulk, limit, dilatancy, strain, state):
    """Let open rows expand into their gap: by the pressure that they bear, and by what they may dilate in this step.

    The latter goes to laws that remember nothing but stress: what they do not need opens again.
    """
    for r in range(strain.shape[0]):
        opened = state[r, column]
        if not (active[r] and opened > 0.0):
            continue
        square = 0.0
        for c in range(strain.shape[1]):
            square += strain[r, c] ** 2 if c < 3 else 2.0 * strain[r, c] ** 2
        filled = dilatancy * np.sqrt(square)
        if before[r] < limit[r] - _AT_THE_LIMIT * bulk[r]:
            filled += _MARGIN * (limit[r] - before[r]) / bulk[r]
        filled = min(filled, opened)
        state[r, column] = opened - filled
        for c in range(3):
            strain[r, c] += filled / 3.0


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


@kernel
def _release(column, active, before, bulk, limit, stress, state):
    """Let open rows of soil without tension expand into their gap at once, by what this step made them bear.

    Their law did not see the gap, and took dilation for confined: its pressure would push apart what is open already.
    """
    for r in range(stress.shape[0]):
        opened = state[r, column]
        now = (stress[r, 0] + stress[r, 1] + stress[r, 2]) / 3.0
        gained = min(before[r], 0.0) - now
        if active[r] and opened > 0.0 and limit[r] <= 0.0 and gained > 0.0:
            filled = min(gained / bulk[r], opened)
            state[r, column] = opened - filled
            for c in range(stress.shape[1]):
                stress[r, c] *= 1.0 + filled * bulk[r] / now
