"""The clause about soil that has come apart: it bears nothing until it has closed."""

import numpy as np

from periporo.core.numerics.tensors import mean
from periporo.core.points.material import OPENED, state_column
from periporo.materials.testing.breaches import OpeningError, ShapeError
from periporo.materials.testing.rows import ROWS, Rows

_EXPANSION, _STEPS = 0.01, 20  # volumetric strain by which rows are pulled apart
_NOTHING = 1e-3  # of the bulk modulus times the expansion: stress that counts for none


def check_limit(rows: Rows) -> None:
    """`tension_limit` has its column, and gives a number for each row."""
    limit = getattr(rows.material, "tension_limit", None)
    if limit is None:
        return
    if state_column(rows.material, OPENED.name, rows.components) is None:
        raise OpeningError(f"{rows.law} has a method `tension_limit`, but `state_fields` does not list OPENED")
    if np.shape(limit(rows.stress.copy(), rows.state.copy())) != (ROWS,):
        raise ShapeError(f"{rows.law}.tension_limit must give a number for each row, an array ({ROWS},)")


def check_opening(rows: Rows) -> None:
    """Rows that expand beyond what their law bears open; they bear nothing until closed, and are then as before.

    A law has a limit where the mean stress grows no more in the second half of an expansion.
    """
    column = state_column(rows.material, OPENED.name, rows.components)
    size = _EXPANSION * rows.moduli(rows.stress, rows.state)[0]
    half, its_state = _expanded(rows, rows.stress, rows.state, 0.5)
    pulled, pulled_state = _expanded(rows, half, its_state, 0.5)
    apart = np.flatnonzero(mean(pulled) - mean(half) <= _NOTHING * size)
    if not len(apart):
        return
    closing, its_state = _expanded(rows, pulled, pulled_state, -0.5)
    borne = (mean(pulled) - mean(closing))[apart]
    row = np.argmax(borne / size[apart])
    if not borne[row] <= _NOTHING * size[apart][row]:
        missing = "list periporo.materials.OPENED in `state_fields` and give a method `tension_limit`"
        wrong = "let `tension_limit` tell the largest mean stress, or add to the column `opened` what expands beyond it"
        raise OpeningError(
            f"{rows.law}: row {apart[row]} bears no more tension when expanded by {_EXPANSION:g}, yet resists by "
            f"{borne[row]:.3g} Pa before that has closed: soil that has come apart bears nothing until it has closed; "
            f"{missing if column is None else wrong}"
        )
    _check_shear(rows, closing, its_state, apart, size)
    closed, its_state = _expanded(rows, closing, its_state, -0.5)
    kept = (mean(rows.stress) - mean(closed))[apart]
    row = np.argmax(kept / size[apart])
    if not kept[row] <= _NOTHING * size[apart][row]:
        raise OpeningError(
            f"{rows.law}: row {apart[row]}, expanded by {_EXPANSION:g} and compressed by the same, is left with "
            f"{kept[row]:.3g} Pa more pressure than before; it must open by all that it expands beyond its limit"
        )
    if column is not None:
        _check_column(rows, pulled_state[apart, column], its_state[apart, column])
        _check_hands_off(rows, pulled, pulled_state, column)


def _check_shear(rows: Rows, stress, state, apart, size) -> None:
    """Open rows bear no pressure after they have been sheared: what dilates fills the gap."""
    shear = np.zeros_like(stress)
    shear[:, 3] = 0.1 * _EXPANSION
    sheared, its_state = rows.after(stress, shear, state, np.inf)
    for _ in range(2):  # it may take a step until the gap is filled
        sheared, its_state = rows.after(sheared, np.zeros_like(stress), its_state, np.inf)
    borne = (mean(stress) - mean(sheared))[apart]
    row = np.argmax(borne / size[apart])
    if not borne[row] <= _NOTHING * size[apart][row]:
        raise OpeningError(
            f"{rows.law}: row {apart[row]}, open and sheared, bears {borne[row]:.3g} Pa; what dilates in shear "
            "fills the gap before it presses: expand the row by what is left of `opened`"
        )


def _expanded(rows: Rows, stress, state, share):
    """Stress and state after a `share` of the expansion, equal in all directions."""
    step = np.zeros_like(stress)
    step[:, :3] = share * _EXPANSION / (3 * _STEPS)
    for _ in range(_STEPS):
        stress, state = rows.after(stress, step, state, np.inf)
    return stress, state


def _check_column(rows: Rows, opened, left) -> None:
    """What rows opened by, and what is left of it when they are closed."""
    if opened.min() > 0.0 and opened.max() < 1.01 * _EXPANSION and np.abs(left).max() < _NOTHING * _EXPANSION:
        return
    raise OpeningError(
        f"{rows.law}: expanded by {_EXPANSION:g}, rows have opened by {opened.min():.3g} to {opened.max():.3g}, and by "
        f"{np.abs(left).max():.3g} when closed again; let `tension_limit` tell the largest mean stress, or add "
        "to the column `opened` what expands beyond it"
    )


def _check_hands_off(rows: Rows, stress, state, column) -> None:
    """A law whose limit the program knows leaves the column alone."""
    if getattr(rows.material, "tension_limit", None) is None:
        return
    own, step = state.copy(), np.zeros_like(stress)
    step[:, :3] = _EXPANSION
    rows.material.compute_stress(stress.copy(), step, own, np.inf)
    if not np.array_equal(own[:, column], state[:, column]):
        raise OpeningError(
            f"{rows.law}.compute_stress writes the column `opened`, which the program fills by `tension_limit`; leave "
            "the column alone, or take `tension_limit` away"
        )
