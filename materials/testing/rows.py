"""Random rows of a law under test, and calls that leave their arguments alone."""

import numpy as np

from periporo.core.points.given import Given
from periporo.core.points.material import Material, StepRefused, UpdatesFailed, state_columns
from periporo.core.points.opening import advance_rows
from periporo.materials.testing.breaches import ModuliError, NonFiniteError, RefusalError, ShapeError

ROWS = 24
_MOST_HALVINGS = 6  # of a step of up to 1 % strain


class Rows:
    """The law, its random rows at the start, and calls that leave their arguments alone."""

    def __init__(self, material: Material, components: int, rng: np.random.Generator, pressure: float):
        self.material, self.components, self.rng = material, components, rng
        self.law = type(material).__name__
        self.failures = 0  # updates that failed
        self._given = Given.of(material, components)
        self.ids = np.stack([np.arange(ROWS), np.arange(ROWS) + 7], axis=1).astype(np.int64)
        self.volume = rng.uniform(0.5, 2.0, ROWS) * 1e-6
        compressed = np.zeros((ROWS, components))
        compressed[:, :3] = -rng.uniform(0.1, 1.0, (ROWS, 1)) * pressure
        self.stress, self.state = self.start(compressed)

    def start(self, stress, rows=slice(None)):
        """Stress (which the law may complete) and state of rows at the start."""
        stress = stress.copy()
        ids, volume = self.ids[rows][: len(stress)], self.volume[rows][: len(stress)]
        state = self.material.initial_state(stress, ids.copy(), volume.copy())
        wanted = (len(stress), state_columns(self.material, self.components))
        if not isinstance(state, np.ndarray) or state.shape != wanted or state.dtype != np.float64:
            found = f"{state.dtype} {state.shape}" if isinstance(state, np.ndarray) else type(state).__name__
            raise ShapeError(
                f"{self.law}.initial_state gave {found}; it must give a float64 array {wanted}, a column for "
                "every scalar of `state_fields` and 4 or 6 for every tensor"
            )
        self._tell(stress, np.zeros_like(stress), state)
        return stress, state

    def _tell(self, stress, increment, state) -> None:
        """Write what a run tells rows that have state; nothing turns, and all happens in one place at once."""
        if self._given is not None:
            rows = np.flatnonzero(stress.any(axis=1) | increment.any(axis=1) | state.any(axis=1))
            told, still = state[rows], np.zeros((len(rows), 1 if self.components == 4 else 3))
            self._given.tell(told, increment[rows], still, np.zeros((len(rows), 3)), 0.0)
            state[rows] = told

    def moduli(self, stress, state):
        """Bulk and shear modulus, two (n,) arrays in Pa."""
        moduli = self.material.elastic_moduli(stress.copy(), state.copy())
        for name, values in zip(("bulk", "shear"), moduli, strict=True):
            values = np.asarray(values)
            if values.shape != (len(stress),) or not np.all((values > 0) & np.isfinite(values)):
                raise ModuliError(
                    f"{self.law}.elastic_moduli: the {name} modulus must be {len(stress)} positive finite "
                    f"numbers, one for each row, not {values.shape} {values.ravel()[:3]}"
                )
        return moduli

    def after(self, stress, increment, state, dt, halvings=_MOST_HALVINGS, openings=True):
        """Stress and state after one step; after two of half of it where the law refuses it, as in a run.

        Without `openings` the law is asked alone.
        """
        new_stress, new_state = stress.copy(), state.copy()
        self._tell(stress, increment, new_state)
        try:
            if openings:
                advance_rows(self.material, new_stress, increment.copy(), new_state, dt)
            else:
                self.material.compute_stress(new_stress, increment.copy(), new_state, dt)
        except UpdatesFailed as failure:
            self.check_rows(failure.rows, len(increment))
            self.failures += len(failure.rows)
        except StepRefused as refusal:
            self._check_refusal(refusal, increment, halvings)
            halfway = self.after(stress, 0.5 * increment, state, 0.5 * dt, halvings - 1)
            return self.after(halfway[0], 0.5 * increment, halfway[1], 0.5 * dt, halvings - 1)
        return new_stress, new_state

    def _check_refusal(self, refusal, increment, halvings):
        rows = refusal.rows
        self.check_rows(rows, len(increment))
        still = rows[~increment[rows].any(axis=1)]
        if len(still):
            raise RefusalError(
                f"{self.law} refuses row {still[0]}, which has no strain increment: half a step would be no less; take "
                "newborn rows, and rows without state, as they are"
            )
        if halvings == 0:
            raise self._refused_for_good(refusal)

    def check_rows(self, rows, count) -> None:
        """Rows that are refused, or failed, are indices into the call's rows."""
        if not len(rows) or rows.min() < 0 or rows.max() >= count:
            raise RefusalError(f"{self.law} refuses rows {rows.tolist()} of {count}; give their indices in the call")

    def _refused_for_good(self, refusal):
        return RefusalError(
            f"{self.law} refuses a step that was halved {_MOST_HALVINGS} times ({refusal.reason}); a run would end"
        )

    def increments(self, count=ROWS) -> np.ndarray:
        """Random strain increments (count, components), 1e-7 to 3e-3 in size."""
        size = 10 ** self.rng.uniform(-7.0, -2.5, (count, 1))
        return size * self.rng.normal(size=(count, self.components))

    def accepted(self, stress, state, dt):
        """Random strain increments (n, components), halved together until the law refuses none of them."""
        increment = self.increments(len(stress))
        for _ in range(_MOST_HALVINGS):
            try:
                self.material.compute_stress(stress.copy(), increment.copy(), state.copy(), dt)
                return increment
            except StepRefused as refusal:
                last, increment = refusal, 0.5 * increment
        raise self._refused_for_good(last)

    def stress_scale(self, stress, state, increment):
        """Stress (n,) to which differences are compared."""
        bulk = self.moduli(stress, state)[0]
        return np.abs(stress).max(axis=1) + bulk * (np.abs(increment).max(axis=1) + 1e-9)

    def check_finite(self, stress, state, where: str) -> None:
        """Raise NonFiniteError if a number is not finite; `where` ends the sentence."""
        bad = ~(np.isfinite(stress).all(axis=1) & np.isfinite(state).all(axis=1))
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            raise NonFiniteError(
                f"{self.law}: NaN or infinity in row {row} after {where}: stress {stress[row]}, state "
                f"{state[row]}. Guard divisions by |s|, p and 0, roots and logarithms of negative numbers"
            )
