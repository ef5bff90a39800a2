"""One material point that is strained, deformed with rotation, or brought to a prescribed stress."""

import numpy as np

from periporo.core.numerics.tensors import from_matrix, to_matrix
from periporo.core.points.material import Material, StepRefused, UpdatesFailed
from periporo.core.points.opening import advance_rows

_WANTED = 1e-11  # error of a prescribed stress, of the largest stress or of 1e-6 K
_ACCEPTED = 1e-7  # the same, where a law's own tolerance stops Newton's method before
_RANK = 1e-6  # singular values of a tangent that are smaller, relative to the largest, are noise
_MAX_ITERATIONS = 40
_MOST_HALVINGS = 10  # of a strain increment that the law refuses
_LINE_SEARCH = 0.5 ** np.arange(8)


class PointStopped(Exception):
    """The point cannot go on; the message says why."""


class StressNotReached(PointStopped):
    """No strain was found that gives the prescribed stress."""


class MaterialPoint:
    """Stress (1, 6) Pa, state (1, k) and accumulated strain (6,) of one point."""

    def __init__(self, material: Material, stress: np.ndarray, volume: float = 1.0, number: int = 0):
        """`volume` (m^3) and `number` are what the law is told of the specimen's size and of the point's id."""
        self.material = material
        self.stress = np.array(stress, dtype=float).reshape(1, 6)
        self.state = material.initial_state(self.stress, np.full((1, 2), number, np.int64), np.full(1, float(volume)))
        self.strain = np.zeros(6)

    def strain_by(self, increment: np.ndarray, dt: float, halvings: int = _MOST_HALVINGS) -> None:
        """Advance by a strain increment (6,) over `dt` s, without rotation; in halves where the law refuses that.

        Raises PointStopped, with the point as it was before the part that did not work.
        """
        stress, state = self.stress.copy(), self.state.copy()
        problem = ""
        try:
            advance_rows(self.material, self.stress, increment.reshape(1, 6).copy(), self.state, dt)
        except StepRefused as refusal:
            problem = f"the law refuses the strain, {refusal.reason}"
        except UpdatesFailed as failure:
            problem, halvings = f"the law failed, {failure.reason}", 0
        else:
            if not (np.isfinite(self.stress).all() and np.isfinite(self.state).all()):
                problem, halvings = f"the law gives stress {self.stress[0]} Pa, state {self.state[0]}", 0
        if not problem:
            self.strain += increment
            return
        self.stress[:], self.state[:] = stress, state
        if halvings == 0:
            raise PointStopped(problem)
        for _ in range(2):
            self.strain_by(0.5 * increment, 0.5 * dt, halvings - 1)

    def deform(self, start: np.ndarray, end: np.ndarray, dt: float, substeps: int = 1) -> None:
        """Advance from the deformation gradient `start` to `end` (3, 3) over `dt` s.

        F_end F_start^-1 = R U: the point is strained by ln U, evenly in `substeps`, and then turned by R with its
        tensors. Exact for any rotation of a stretch along fixed axes; second order to Jaumann's rate else.
        """
        change = (end - start) @ np.linalg.inv(start)
        green, axes = np.linalg.eigh(0.5 * (change + change.T + change.T @ change))
        increment = (axes * (0.5 * np.log1p(2.0 * green))) @ axes.T
        shrink = (axes / np.sqrt(1.0 + 2.0 * green)) @ axes.T
        for _ in range(substeps):
            self.strain_by(from_matrix(increment[None], 6)[0] / substeps, dt / substeps)
        self._rotate((np.eye(3) + change) @ shrink)

    def _rotate(self, rotation: np.ndarray) -> None:
        def turned(rows):
            return from_matrix(rotation @ to_matrix(rows) @ rotation.T, 6)

        self.stress[:] = turned(self.stress)
        self.strain = turned(self.strain[None])[0]
        column = 0
        for field in self.material.state_fields:
            columns = slice(column, column + field.columns(6))
            if field.kind == "tensor":
                self.state[:, columns] = turned(self.state[:, columns])
            column = columns.stop

    def reach(self, increment: np.ndarray, controlled: np.ndarray, target: np.ndarray, dt: float) -> None:
        """Advance so that the stress components where `controlled` (6,) is true become `target` (6,) Pa.

        `increment` (6,) holds the prescribed strain, and a first guess where stress is controlled; it is
        completed in place. Raises StressNotReached, with the point as it was.
        """
        unknown = np.flatnonzero(controlled)
        guesses = np.tile(increment, (2, 1))
        guesses[1, unknown] = 0.0
        bulk = float(self.material.elastic_moduli(self.stress, self.state)[0][0])
        scale = max(np.abs(self.stress).max(), np.abs(target[unknown]).max(), 1e-6 * bulk)
        best, residual = self._best(guesses, unknown, target, dt)
        for _ in range(_MAX_ITERATIONS):
            if np.abs(residual).max() <= _WANTED * scale:
                break
            step = self._newton_step(best, residual, unknown, target, dt)
            trials = np.tile(best, (len(_LINE_SEARCH), 1))
            trials[:, unknown] += _LINE_SEARCH[:, None] * step
            new, new_residual = self._best(trials, unknown, target, dt)
            if not np.linalg.norm(new_residual) < np.linalg.norm(residual):
                break
            best, residual = new, new_residual
        if not np.abs(residual).max() <= _ACCEPTED * scale:
            raise StressNotReached
        increment[:] = best
        self.strain_by(best, dt)

    def _residuals(self, increments, unknown, target, dt):
        """Stress error (m, u) in Pa after each of the increments (m, 6), the point left alone."""
        stress = np.tile(self.stress, (len(increments), 1))
        state = np.tile(self.state, (len(increments), 1))
        try:
            advance_rows(self.material, stress, increments.copy(), state, dt)
        except (StepRefused, UpdatesFailed):
            if len(increments) == 1:
                return np.full((1, len(unknown)), np.inf)
            return np.concatenate([self._residuals(i[None], unknown, target, dt) for i in increments])
        return stress[:, unknown] - target[unknown]

    def _best(self, increments, unknown, target, dt):
        residuals = self._residuals(increments, unknown, target, dt)
        norms = np.linalg.norm(residuals, axis=1)
        index = int(np.argmin(np.where(np.isfinite(norms), norms, np.inf)))
        return increments[index].copy(), residuals[index]

    def _newton_step(self, increment, residual, unknown, target, dt):
        """Change (u,) of the unknown strains, by a numerical tangent with central differences."""
        size = 1e-8 + 1e-4 * np.abs(increment).max()
        count = len(unknown)
        trials = np.tile(increment, (2 * count, 1))
        trials[np.arange(count), unknown] += size
        trials[count + np.arange(count), unknown] -= size
        residuals = self._residuals(trials, unknown, target, dt)
        tangent = (residuals[:count] - residuals[count:]).T / (2 * size)
        if not (np.isfinite(tangent).all() and np.isfinite(residual).all()):
            raise StressNotReached  # the law fails, or refuses to try
        return -np.linalg.lstsq(tangent, residual, rcond=_RANK)[0]
