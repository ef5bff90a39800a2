"""Clauses about how a law is called: declarations, shapes, rows on their own, rows without state, no strain."""

from typing import Any

import numpy as np

from periporo.core.points.given import ASKED_FOR
from periporo.core.points.material import Material, StateField, derived_fields
from periporo.materials.testing.breaches import (
    DeclarationError,
    NonFiniteError,
    RefusalError,
    ShapeError,
    SplitError,
    ZeroIncrementError,
)
from periporo.materials.testing.rows import ROWS, Rows

SAME = 1e-7  # of stress and elastic increment: results that must agree apart from iteration errors


def check_declaration(material: Material) -> None:
    """Methods, density and state fields are there and are what they must be."""
    law = type(material).__name__
    for name in ("initial_state", "compute_stress", "elastic_moduli"):
        if not callable(getattr(material, name, None)):
            raise DeclarationError(f"{law} has no method `{name}`; see periporo.materials.Material")
    density = getattr(material, "density", None)
    if not isinstance(density, (int, float)) or not 0 < density < np.inf:
        raise DeclarationError(f"{law}.density must be a positive number in kg/m^3, not {density!r}")
    fields = getattr(material, "state_fields", None)
    if not isinstance(fields, tuple) or not all(isinstance(f, StateField) for f in fields):
        raise DeclarationError(f"{law}.state_fields must be a tuple of StateField, not {fields!r}")
    names = [f.name for f in fields]
    derived = derived_fields(material)
    if derived and not callable(getattr(material, "derived_state", None)):
        raise DeclarationError(f"{law} lists `derived_fields`, but has no method `derived_state`")
    names += [f.name for f in derived]
    unknown = sorted(set(getattr(material, "default_output", ())) - set(names))
    if unknown:
        raise DeclarationError(f"{law}.default_output names {unknown}, which are neither state nor derived fields")
    for field in (*fields, *derived):
        if not field.name.isidentifier() or names.count(field.name) > 1 or field.name == "stress":
            raise DeclarationError(
                f"{law}: state field '{field.name}' needs a name of letters, digits and _ that no other has"
            )
        told = {f.name: f for f in ASKED_FOR}
        if field.name in told and field != told[field.name]:
            raise DeclarationError(
                f"{law}: state field '{field.name}' is told by the program as {told[field.name]}; use that, from "
                "periporo.materials, or another name"
            )
        if field.kind not in ("scalar", "tensor", "vector", "matrix") or field.merge not in ("mean", "log_mean"):
            raise DeclarationError(
                f"{law}: state field '{field.name}' has kind '{field.kind}' and merge '{field.merge}'; "
                "kind is 'scalar', 'tensor', 'vector' or 'matrix', merge 'mean' or 'log_mean'"
            )


def check_start(rows: Rows) -> None:
    """initial_state: the same for the same row, alone or among others; log_mean columns keep a sign."""
    for row in range(3):
        alone = rows.start(rows.stress[row : row + 1], slice(row, row + 1))[1]
        if not np.array_equal(alone, rows.state[row : row + 1], equal_nan=True):
            raise SplitError(
                f"{rows.law}.initial_state gives row {row} another state alone than among {ROWS} rows; a "
                "row's state may depend on its own stress, ids and volume only (seed random numbers by ids)"
            )
    rows.check_finite(rows.stress, rows.state, "initial_state")
    column = 0
    for field in rows.material.state_fields:
        width = field.columns(rows.components)
        if field.merge == "log_mean" and np.any(rows.state[:, column : column + width] == 0):
            raise DeclarationError(
                f"{rows.law}: state field '{field.name}' starts at 0, whose logarithm has no mean; use "
                "merge='mean' or a start other than 0"
            )
        column += width
    rows.moduli(rows.stress, rows.state)
    stress, state = rows.start(np.zeros_like(rows.stress))
    rows.check_finite(stress, state, "initial_state without stress, where points meet that flew freely")
    rows.moduli(stress, state)


def check_derived(rows: Rows) -> None:
    """derived_state gives what `derived_fields` lists, finite, and changes nothing."""
    wanted = {field.name: field.columns(rows.components) for field in derived_fields(rows.material)}
    if not wanted:
        return
    stress, state = rows.stress.copy(), rows.state.copy()
    derive: Any = getattr(rows.material, "derived_state", None)
    found = derive(stress, state)
    shapes = {name: (ROWS,) if width == 1 else (ROWS, width) for name, width in wanted.items()}
    if {name: np.shape(values) for name, values in found.items()} != shapes:
        given = {name: np.shape(values) for name, values in found.items()}
        raise ShapeError(f"{rows.law}.derived_state gave {given}; `derived_fields` lists {shapes}")
    if not all(np.isfinite(values).all() for values in found.values()):
        raise NonFiniteError(f"{rows.law}.derived_state gives NaN or infinity at the start")
    if not (np.array_equal(stress, rows.stress) and np.array_equal(state, rows.state)):
        raise ShapeError(f"{rows.law}.derived_state changed stress or state; it only looks at them")


def check_calls(rows: Rows) -> None:
    """compute_stress works in place, returns nothing and leaves the strain increment alone."""
    stress, state, increment = rows.stress.copy(), rows.state.copy(), rows.accepted(rows.stress, rows.state, 1e-5)
    given = increment.copy()
    result: Any = rows.material.compute_stress(stress, increment, state, 1e-5)  # type: ignore[func-returns-value]
    if result is not None:
        raise ShapeError(
            f"{rows.law}.compute_stress returned {type(result).__name__}; write into `stress` and `state` "
            "in place and return None"
        )
    if not np.array_equal(increment, given):
        raise ShapeError(f"{rows.law}.compute_stress changed `strain_increment`; work on a copy")
    if np.array_equal(stress, rows.stress):
        raise ShapeError(
            f"{rows.law}.compute_stress left `stress` as it was; assign to stress[:], not to the name"
        )
    try:
        rows.after(rows.stress[:0], increment[:0], rows.state[:0], 1e-5)
    except Exception as error:
        raise ShapeError(
            f"{rows.law}.compute_stress fails for zero rows ({error}); a rank may own none of a material"
        ) from error


def check_rows_without_state(rows: Rows) -> None:
    """Rows of zeros, which are bonds beyond the horizon, disturb neither the law nor the other rows."""
    between = np.zeros((2 * ROWS, rows.components))
    stress, increment = between.copy(), between.copy()
    state = np.zeros((2 * ROWS, rows.state.shape[1]))
    stress[::2], state[::2] = rows.stress, rows.state
    increment[::2] = rows.accepted(rows.stress, rows.state, 1e-5)
    for dt in (1e-5, np.inf):
        try:
            found = rows.after(stress, increment, state, dt)
            moduli = rows.material.elastic_moduli(stress.copy(), state.copy())
        except RefusalError:
            raise
        except Exception as error:
            raise ShapeError(
                f"{rows.law} fails where stress, state and strain increment of a row are all 0 ({error}); such rows "
                "are bonds beyond the horizon: what becomes of them does not count, so let them pass"
            ) from error
        if not all(np.isfinite(values[1::2]).all() for values in (*found, *moduli)):
            raise NonFiniteError(
                f"{rows.law}: NaN or infinity where stress, state and strain increment of a row are all 0; such rows "
                "are bonds beyond the horizon: let compute_stress and elastic_moduli give any finite number for them"
            )
        expected = rows.after(rows.stress, increment[::2], rows.state, dt)
        if not all(np.array_equal(f[::2], e, equal_nan=True) for f, e in zip(found, expected, strict=True)):
            raise SplitError(f"{rows.law}: rows change when rows without state (all 0) stand between them")


def check_zero_increment(rows: Rows, stress, state) -> None:
    """Nothing changes without strain: at dt = infinity after an inviscid step, and always at dt -> 0."""
    still = np.zeros_like(stress)
    overstressed, its_state = rows.after(stress, rows.increments(), state, 1e-6)
    cases = ((stress, state, np.inf), (overstressed, its_state, 1e-30))
    for before, its, dt in cases:
        change = np.abs(rows.after(before, still, its, dt, openings=False)[0] - before).max(axis=1)
        relative = change / rows.stress_scale(before, its, still)
        row = int(np.argmax(relative))
        if not relative[row] <= SAME:
            raise ZeroIncrementError(
                f"{rows.law}: without strain and with dt = {dt:g} s the stress of row {row} moved by "
                f"{change[row]:.3g} Pa; return to the yield surface within rounding, scale viscous flow with "
                "dt, and treat infinite dt as the inviscid limit"
            )


def check_split(rows: Rows, stress, state) -> None:
    """n rows at once equal row by row, bit for bit."""
    increment = rows.accepted(stress, state, 1e-5)
    together = rows.after(stress, increment, state, 1e-5)
    for row in range(ROWS):
        one = slice(row, row + 1)
        alone = rows.after(stress[one], increment[one], state[one], 1e-5)
        for name, a, t in zip(("stress", "state"), alone, together, strict=True):
            if not np.array_equal(a, t[one], equal_nan=True):
                raise SplitError(
                    f"{rows.law}: {name} of row {row} is {a[0]} alone, {t[row]} among {ROWS} rows; use no "
                    "sums, means or iteration counts over rows (runs on more ranks would differ)"
                )
