"""One material point that is strained, deformed with rotation, or brought to a prescribed stress."""

from dataclasses import dataclass

import numpy as np

from periporo.core.numerics.tensors import from_matrix, to_matrix
from periporo.core.points.given import Given
from periporo.core.points.material import BONDING, Material, StepRefused, UpdatesFailed, state_column
from periporo.core.points.opening import advance_rows
from periporo.materials.laboratory.water import SpecimenWater

_WANTED = 1e-11  # error of a prescribed stress, of the largest stress or of 1e-6 K
_ACCEPTED = 1e-7  # the same, where a law's own tolerance stops Newton's method before
_RANK = 1e-6  # singular values of a tangent that are smaller, relative to the largest, are noise
_MAX_ITERATIONS = 40
_MOST_RISES = 5  # of the error on the way: it may rise across a kink, as where the row begins to yield
_MOST_HALVINGS = 10  # of a strain increment that the law refuses
_LINE_SEARCH = 0.5 ** np.arange(8)


class PointStopped(Exception):
    """The point cannot go on; the message says why."""


class StressNotReached(PointStopped):
    """No strain was found that gives the prescribed stress."""


@dataclass(frozen=True)
class Control:
    """Which strains are free, and which stresses decide them.

    free: (6, m) directions of strain, orthonormal columns; stress: (m, 6), each row makes a number of the stress that
    is prescribed; effective: (m,) whether that stress is the effective one, not the total.
    """

    free: np.ndarray
    stress: np.ndarray
    effective: np.ndarray

    @classmethod
    def of_components(cls, chosen: np.ndarray) -> "Control":
        """The total stress components where `chosen` (6,) is true."""
        unit = np.eye(6)[np.flatnonzero(chosen)]
        return cls(unit.T, unit, np.zeros(len(unit), bool))


class MaterialPoint:
    """Effective stress (1, 6) Pa, state (1, k) and accumulated strain (6,) of one point, and its water if it has any.

    Without water effective and total stress are the same.
    """

    def __init__(
        self, material: Material, stress: np.ndarray, volume: float = 1.0, number: int = 0,
        water: SpecimenWater | None = None,
    ):  # fmt: skip
        """The total `stress` at the start; `volume` (m^3) and `number` are what the law is told of size and id."""
        self.material = material
        self.water = water
        self.strain = np.zeros(6)
        self.stress = np.array(stress, dtype=float).reshape(1, 6)
        self.stress[:, :3] -= self.pore_stress(np.zeros(1))[:, None]
        self.state = material.initial_state(self.stress, np.full((1, 2), number, np.int64), np.full(1, float(volume)))
        self._bonding = state_column(material, BONDING.name, 6)
        self._given = Given.of(material, 6)
        self._time, self._turn = 0.0, np.eye(3)  # s; rotation since the law was asked

    @property
    def volumetric(self) -> float:
        """The volumetric strain, tension positive."""
        return float(self.strain[:3].sum())

    def pore_stress(self, volumetric: np.ndarray) -> np.ndarray:
        """What water adds to the normal stress, (n,) Pa at volumetric strains (n,)."""
        return np.zeros(len(volumetric)) if self.water is None else self.water.pore_stress(volumetric)

    @property
    def total(self) -> np.ndarray:
        """Total stress (6,) Pa."""
        total = self.stress[0].copy()
        total[:3] += self.pore_stress(np.array([self.volumetric]))
        return total

    def controlled(self, control: Control) -> np.ndarray:
        """The present values (m,) of what a `control` prescribes."""
        return np.where(control.effective, control.stress @ self.stress[0], control.stress @ self.total)

    def _tell(self, state: np.ndarray, increments: np.ndarray, dt: float) -> None:
        """Write what a run tells a law before a step of strain `increments` (n, 6); the place is 0."""
        if self._bonding is not None and self.water is not None:
            state[:, self._bonding] = self.water.bonding(self.volumetric)
        if self._given is not None:
            still = np.zeros((len(state), 3))
            self._given.tell(state, increments, still, still, self._time + (dt if np.isfinite(dt) else 0.0))
            if self._given.rotation is not None:
                state[:, self._given.rotation : self._given.rotation + 9] = self._turn.ravel()

    def strain_by(self, increment: np.ndarray, dt: float, halvings: int = _MOST_HALVINGS) -> None:
        """Advance by a strain increment (6,) over `dt` s, without rotation; in halves where the law refuses that.

        Raises PointStopped, with the point as it was before the part that did not work.
        """
        stress, state = self.stress.copy(), self.state.copy()
        self._tell(self.state, increment[None], dt)
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
            self._time, self._turn = self._time + (dt if np.isfinite(dt) else 0.0), np.eye(3)
            if self.water is not None and not self.water.drained:
                self.water.pressure = float(self.water.at(np.array([self.volumetric]))[0][0])
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
        self._turn = rotation @ self._turn
        if self._given is not None and self._given.gradient is not None:
            columns = slice(self._given.gradient, self._given.gradient + 9)
            self.state[:, columns] = (rotation @ self.state[:, columns].reshape(-1, 3, 3)).reshape(-1, 9)
        column = 0
        for field in self.material.state_fields:
            columns = slice(column, column + field.columns(6))
            if field.kind == "tensor":
                self.state[:, columns] = turned(self.state[:, columns])
            column = columns.stop

    def reach(self, increment: np.ndarray, control: Control, target: np.ndarray, dt: float) -> None:
        """Advance so that what the `control` prescribes becomes `target` (m,).

        `increment` (6,) holds the prescribed strain, and a first guess of the free one; it is completed in place.
        Raises StressNotReached, with the point as it was.
        """
        guesses = np.tile(increment, (2, 1))
        guesses[1] -= control.free @ (control.free.T @ increment)
        bulk = float(self.material.elastic_moduli(self.stress, self.state)[0][0])
        scale = max(np.abs(self.stress).max(), np.abs(target).max(), 1e-6 * bulk)
        best, residual = self._best(guesses, control, target, dt)
        rises = 0
        for _ in range(_MAX_ITERATIONS):
            error = np.abs(residual).max()
            if error <= _WANTED * scale:
                break
            step = self._newton_step(best, residual, control, target, dt)
            trials = best + _LINE_SEARCH[:, None] * (control.free @ step)
            new, new_residual = self._best(trials, control, target, dt)
            if not np.linalg.norm(new_residual) < np.linalg.norm(residual):
                if error <= _ACCEPTED * scale or rises == _MOST_RISES:
                    break
                rises += 1
            best, residual = new, new_residual
        if not np.abs(residual).max() <= _ACCEPTED * scale:
            raise StressNotReached
        increment[:] = best
        self.strain_by(best, dt)

    def _residuals(self, increments, control, target, dt):
        """Error (n, m) of what is prescribed after each of the increments (n, 6), the point left alone."""
        stress = np.tile(self.stress, (len(increments), 1))
        state = np.tile(self.state, (len(increments), 1))
        self._tell(state, increments, dt)
        try:
            advance_rows(self.material, stress, increments.copy(), state, dt)
        except (StepRefused, UpdatesFailed):
            if len(increments) == 1:
                return np.full((1, len(target)), np.inf)
            return np.concatenate([self._residuals(i[None], control, target, dt) for i in increments])
        effective = stress @ control.stress.T
        if self.water is None:
            return effective - target
        stress[:, :3] += self.pore_stress(self.volumetric + increments[:, :3].sum(axis=1))[:, None]
        return np.where(control.effective, effective, stress @ control.stress.T) - target

    def _best(self, increments, control, target, dt):
        residuals = self._residuals(increments, control, target, dt)
        norms = np.linalg.norm(residuals, axis=1)
        index = int(np.argmin(np.where(np.isfinite(norms), norms, np.inf)))
        return increments[index].copy(), residuals[index]

    def _newton_step(self, increment, residual, control, target, dt):
        """Change (m,) of the free strains, by a numerical tangent with central differences."""
        size = 1e-8 + 1e-4 * np.abs(increment).max()
        count = len(target)
        trials = increment + size * np.concatenate([control.free.T, -control.free.T])
        residuals = self._residuals(trials, control, target, dt)
        if not (np.isfinite(residuals).all() and np.isfinite(residual).all()):
            raise StressNotReached  # the law fails, or refuses to try
        tangent = (residuals[:count] - residuals[count:]).T / (2 * size)
        return -np.linalg.lstsq(tangent, residual, rcond=_RANK)[0]
