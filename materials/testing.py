"""Conformance kit: does a constitutive law keep the contract of `periporo.core.points.material`?

from periporo.materials.testing import check_material
check_material(MyLaw(...), dimension=2)
check_material(MyLaw(...), dimension=3)
"""

from dataclasses import dataclass

import numpy as np

from periporo.core.numerics.tensors import component_count, from_matrix, to_matrix
from periporo.core.points.material import Material, StateField, state_columns

_ROWS = 24
_WALK_STEPS = 60
_SAME = 1e-7  # of stress and elastic increment: results that must agree apart from iteration errors
_CYCLE_STEPS, _CYCLE_STRAIN, _CYCLE_LOSS = 100, 1e-4, 1e-6


class NonConformance(AssertionError):
    """The law breaks the contract; the message says where and how to fix it."""


class DeclarationError(NonConformance):
    """`density` or `state_fields` is not what the protocol asks for."""


class ShapeError(NonConformance):
    """An array has the wrong shape or type, or a method changes what it must leave alone."""


class ModuliError(NonConformance):
    """`elastic_moduli` are not positive, finite (n,) arrays."""


class ZeroIncrementError(NonConformance):
    """Stress changes although nothing was strained (and no time passed)."""


class FrameError(NonConformance):
    """The response depends on the orientation of the axes."""


class SplitError(NonConformance):
    """The result of a row depends on the other rows in the call."""


class NonFiniteError(NonConformance):
    """NaN or infinity after finite strains."""


class CycleEnergyError(NonConformance):
    """A law that declares itself `conservative` made or lost energy in a closed cycle of strain."""


@dataclass(frozen=True)
class Report:
    """What was measured: `cycle_energy` is the work of a closed cycle of strain over K strain^2."""

    law: str
    dimension: int
    cycle_energy: float


def check_material(material: Material, dimension: int = 3, seed: int = 0, pressure: float = 1e4) -> Report:
    """Check `material` in plane strain (`dimension` 2) or 3D; random strains are drawn from `seed`.

    Rows start from isotropic compression up to `pressure` Pa and are strained by up to about 1 % a step.

    Raises a subclass of NonConformance, an AssertionError, at the first breach. A law with the attribute
    `conservative = True` must also return the work of a closed cycle of strain.
    """
    _check_declaration(material)
    rows = _Rows(material, component_count(dimension), np.random.default_rng(seed), pressure)
    _check_start(rows)
    _check_calls(rows)
    stress, state = _check_walk(rows)
    _check_zero_increment(rows, stress, state)
    _check_split(rows, stress, state)
    _check_frame(rows, stress, state)
    return Report(rows.law, dimension, _check_cycle(rows))


class _Rows:
    """The law, its random rows at the start, and calls that leave their arguments alone."""

    def __init__(self, material: Material, components: int, rng: np.random.Generator, pressure: float):
        self.material, self.components, self.rng = material, components, rng
        self.law = type(material).__name__
        self.ids = np.stack([np.arange(_ROWS), np.arange(_ROWS) + 7], axis=1).astype(np.int64)
        self.volume = rng.uniform(0.5, 2.0, _ROWS) * 1e-6
        bulk = self.moduli(np.zeros((1, components)), self.start(np.zeros((1, components)))[1])[0][0]
        self.bulk = float(bulk)
        compressed = np.zeros((_ROWS, components))
        compressed[:, :3] = -rng.uniform(0.1, 1.0, (_ROWS, 1)) * pressure
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
        return stress, state

    def moduli(self, stress, state):
        moduli = self.material.elastic_moduli(stress.copy(), state.copy())
        for name, values in zip(("bulk", "shear"), moduli, strict=True):
            values = np.asarray(values)
            if values.shape != (len(stress),) or not np.all((values > 0) & np.isfinite(values)):
                raise ModuliError(
                    f"{self.law}.elastic_moduli: the {name} modulus must be {len(stress)} positive finite "
                    f"numbers, one for each row, not {values.shape} {values.ravel()[:3]}"
                )
        return moduli

    def after(self, stress, increment, state, dt):
        """Stress and state after one call."""
        stress, state = stress.copy(), state.copy()
        self.material.compute_stress(stress, increment.copy(), state, dt)
        return stress, state

    def increments(self, count=_ROWS):
        """Random strain increments (count, components), 1e-7 to 3e-3 in size."""
        size = 10 ** self.rng.uniform(-7.0, -2.5, (count, 1))
        return size * self.rng.normal(size=(count, self.components))

    def stress_scale(self, stress, increment):
        """Stress (n,) to which differences are compared."""
        return np.abs(stress).max(axis=1) + self.bulk * (np.abs(increment).max(axis=1) + 1e-9)


def _check_declaration(material: Material) -> None:
    law = type(material).__name__
    for name in ("initial_state", "compute_stress", "elastic_moduli"):
        if not callable(getattr(material, name, None)):
            raise DeclarationError(f"{law} has no method `{name}`; see periporo.core.points.material")
    density = getattr(material, "density", None)
    if not isinstance(density, (int, float)) or not 0 < density < np.inf:
        raise DeclarationError(f"{law}.density must be a positive number in kg/m^3, not {density!r}")
    fields = getattr(material, "state_fields", None)
    if not isinstance(fields, tuple) or not all(isinstance(f, StateField) for f in fields):
        raise DeclarationError(f"{law}.state_fields must be a tuple of StateField, not {fields!r}")
    names = [f.name for f in fields]
    for field in fields:
        if not field.name.isidentifier() or names.count(field.name) > 1 or field.name == "stress":
            raise DeclarationError(
                f"{law}: state field '{field.name}' needs a name of letters, digits and _ that no other has"
            )
        if field.kind not in ("scalar", "tensor") or field.merge not in ("mean", "log_mean"):
            raise DeclarationError(
                f"{law}: state field '{field.name}' has kind '{field.kind}' and merge '{field.merge}'; "
                "kind is 'scalar' or 'tensor', merge 'mean' or 'log_mean'"
            )


def _check_start(rows: _Rows) -> None:
    """initial_state: the same for the same row, alone or among others; log_mean columns keep a sign."""
    for row in range(3):
        alone = rows.start(rows.stress[row : row + 1], slice(row, row + 1))[1]
        if not np.array_equal(alone, rows.state[row : row + 1], equal_nan=True):
            raise SplitError(
                f"{rows.law}.initial_state gives row {row} another state alone than among {_ROWS} rows; a "
                "row's state may depend on its own stress, ids and volume only (seed random numbers by ids)"
            )
    _check_finite(rows, rows.stress, rows.state, "initial_state")
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


def _check_calls(rows: _Rows) -> None:
    """compute_stress works in place, returns nothing and leaves the strain increment alone."""
    stress, state, increment = rows.stress.copy(), rows.state.copy(), rows.increments()
    given = increment.copy()
    result = rows.material.compute_stress(stress, increment, state, 1e-5)
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


def _check_walk(rows: _Rows):
    """Rows after a random walk with finite and infinite time steps; everything stays finite."""
    stress, state = rows.stress.copy(), rows.state.copy()
    for step in range(_WALK_STEPS):
        dt = np.inf if step >= _WALK_STEPS // 2 else 10.0 ** rows.rng.uniform(-7, -1)
        stress, state = rows.after(stress, rows.increments(), state, dt)
        _check_finite(rows, stress, state, f"step {step + 1} of a random walk with dt = {dt:g} s")
        rows.moduli(stress, state)
    return stress, state


def _check_finite(rows: _Rows, stress, state, where: str) -> None:
    bad = ~(np.isfinite(stress).all(axis=1) & np.isfinite(state).all(axis=1))
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        raise NonFiniteError(
            f"{rows.law}: NaN or infinity in row {row} after {where}: stress {stress[row]}, state "
            f"{state[row]}. Guard divisions by |s|, p and 0, roots and logarithms of negative numbers"
        )


def _check_zero_increment(rows: _Rows, stress, state) -> None:
    """Nothing changes without strain: at dt = infinity after an inviscid step, and always at dt -> 0."""
    still = np.zeros_like(stress)
    overstressed, its_state = rows.after(stress, rows.increments(), state, 1e-6)
    cases = ((stress, state, np.inf), (overstressed, its_state, 1e-30))
    for before, its, dt in cases:
        change = np.abs(rows.after(before, still, its, dt)[0] - before).max(axis=1)
        row = int(np.argmax(change / rows.stress_scale(before, still)))
        if not change[row] <= _SAME * rows.stress_scale(before, still)[row]:
            raise ZeroIncrementError(
                f"{rows.law}: without strain and with dt = {dt:g} s the stress of row {row} moved by "
                f"{change[row]:.3g} Pa; return to the yield surface within rounding, scale viscous flow with "
                "dt, and treat infinite dt as the inviscid limit"
            )


def _check_split(rows: _Rows, stress, state) -> None:
    """n rows at once equal row by row, bit for bit."""
    increment = rows.increments()
    together = rows.after(stress, increment, state, 1e-5)
    for row in range(_ROWS):
        one = slice(row, row + 1)
        alone = rows.after(stress[one], increment[one], state[one], 1e-5)
        for name, a, t in zip(("stress", "state"), alone, together, strict=True):
            if not np.array_equal(a, t[one], equal_nan=True):
                raise SplitError(
                    f"{rows.law}: {name} of row {row} is {a[0]} alone, {t[row]} among {_ROWS} rows; use no "
                    "sums, means or iteration counts over rows (runs on more ranks would differ)"
                )


def _check_frame(rows: _Rows, stress, state) -> None:
    """Turning stress, tensor state and strain increment turns the result."""
    turn = _random_rotation(rows.rng, in_plane=rows.components == 4)
    increment = rows.increments()

    def turned(tensors):
        return from_matrix(turn @ to_matrix(tensors) @ turn.T, rows.components)

    def turned_state(values):
        values, column = values.copy(), 0
        for field in rows.material.state_fields:
            columns = slice(column, column + field.columns(rows.components))
            if field.kind == "tensor":
                values[:, columns] = turned(values[:, columns])
            column = columns.stop
        return values

    expected, expected_state = rows.after(stress, increment, state, 1e-5)
    expected, expected_state = turned(expected), turned_state(expected_state)
    found, found_state = rows.after(turned(stress), turned(increment), turned_state(state), 1e-5)
    difference = np.abs(found - expected).max(axis=1) / rows.stress_scale(expected, increment)
    row = int(np.argmax(difference))
    if not difference[row] <= _SAME:
        raise FrameError(
            f"{rows.law}: in turned axes row {row} gets the stress {found[row]}, not {expected[row]} Pa; use "
            "invariants, give shear components the factor 2 in products, and declare tensor state as such"
        )
    scale = np.abs(expected_state).max(axis=0, initial=0.0) + 1e-300
    difference = np.abs(found_state - expected_state) / scale
    if difference.size and not difference.max() <= 1e-5:
        raise FrameError(
            f"{rows.law}: state column {int(np.argmax(difference.max(axis=0)))} depends on the orientation "
            "of the axes; compute it from invariants, or declare a tensor with kind='tensor'"
        )


def _random_rotation(rng: np.random.Generator, in_plane: bool) -> np.ndarray:
    if in_plane:
        angle = rng.uniform(0.5, 1.0)
        c, s = np.cos(angle), np.sin(angle)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return turn * np.sign(np.linalg.det(turn))


def _check_cycle(rows: _Rows) -> float:
    """Largest work of a parallelogram of strain over K strain^2; zero for a conservative law."""
    legs = _CYCLE_STRAIN * rows.rng.normal(size=(2, _ROWS, rows.components))
    stress, state = rows.stress.copy(), rows.state.copy()
    weight = np.where(np.arange(rows.components) < 3, 1.0, 2.0)
    work = np.zeros(_ROWS)
    for leg in (legs[0], legs[1], -legs[0], -legs[1]):
        increment = leg / _CYCLE_STEPS
        for _ in range(_CYCLE_STEPS):
            before = stress
            stress, state = rows.after(stress, increment, state, np.inf)
            work += np.sum(weight * 0.5 * (before + stress) * increment, axis=1)
    relative = work / (rows.bulk * _CYCLE_STRAIN**2)
    largest = float(relative[np.argmax(np.abs(relative))])
    if getattr(rows.material, "conservative", False) and not abs(largest) <= _CYCLE_LOSS:
        raise CycleEnergyError(
            f"{rows.law} declares itself conservative, but a closed cycle of strain does the work "
            f"{largest:.3g} K strain^2; derive the stress from a potential or drop `conservative`"
        )
    return largest
