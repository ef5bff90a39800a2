"""Clauses about what a law answers: finite, the same in all axes, as stiff as it says, conservative if it says so."""

import numpy as np

from periporo.core.numerics.tensors import COMPONENTS, from_matrix, to_matrix
from periporo.materials.testing.breaches import CycleEnergyError, FrameError, ModuliError
from periporo.materials.testing.contract import SAME
from periporo.materials.testing.rows import ROWS, Rows

_WALK_STEPS = 60
_CYCLE_STEPS, _CYCLE_STRAIN, _CYCLE_LOSS = 100, 1e-4, 1e-6
_PROBE_STRESS, _PROBE_STRAIN = 1e-4, 1e-9  # size of a probe: of the stress over K, and of strain
_PROBE_TIMES = (np.inf, 1e-3)  # s: a law that flows is stiff in the short one, one with viscosity is not in the long
_STIFFER, _SOFTER = 1.1, 0.5  # response over declared moduli that is let pass: more would be unstable, less wasteful


def check_walk(rows: Rows):
    """Rows after a random walk with finite and infinite time steps; everything stays finite."""
    stress, state = rows.stress.copy(), rows.state.copy()
    for step in range(_WALK_STEPS):
        dt = np.inf if step >= _WALK_STEPS // 2 else 10.0 ** rows.rng.uniform(-7, -1)
        stress, state = rows.after(stress, rows.increments(), state, dt)
        rows.check_finite(stress, state, f"step {step + 1} of a random walk with dt = {dt:g} s")
        rows.moduli(stress, state)
    return stress, state


def check_frame(rows: Rows, stress, state) -> None:
    """Turning stress, tensor state and strain increment turns the result."""
    turn = _random_rotation(rows.rng, in_plane=rows.components == 4)
    increment = rows.accepted(stress, state, 1e-5)

    def turned(tensors):
        return from_matrix(turn @ to_matrix(tensors) @ turn.T, rows.components)

    def turned_state(values):
        values, column = values.copy(), 0
        for field in rows.material.state_fields:
            columns = slice(column, column + field.columns(rows.components))
            if field.kind == "tensor":
                values[:, columns] = turned(values[:, columns])
            elif field.kind == "vector":
                values[:, columns] = values[:, columns] @ turn.T
            elif field.kind == "matrix":
                values[:, columns] = (turn @ values[:, columns].reshape(-1, 3, 3) @ turn.T).reshape(-1, 9)
            column = columns.stop
        return values

    expected, expected_state = rows.after(stress, increment, state, 1e-5)
    expected, expected_state = turned(expected), turned_state(expected_state)
    found, found_state = rows.after(turned(stress), turned(increment), turned_state(state), 1e-5)
    difference = np.abs(found - expected).max(axis=1) / rows.stress_scale(stress, state, increment)
    row = int(np.argmax(difference))
    if not difference[row] <= SAME:
        raise FrameError(
            f"{rows.law}: in turned axes row {row} gets the stress {found[row]}, not {expected[row]} Pa; use "
            "invariants, give shear components the factor 2 in products, mind their order (xx yy zz xy yz xz), and "
            "declare tensor state as such"
        )
    widths = [field.columns(rows.components) for field in rows.material.state_fields]
    parts = np.split(np.abs(expected_state), np.cumsum(widths, dtype=int)[:-1], axis=1)
    scale = np.repeat([part.max(initial=0.0) + 1e-300 for part in parts[: len(widths)]], widths)
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


def check_components(rows: Rows) -> None:
    """Shear in one plane makes shear stress in that plane alone, from isotropic stress."""
    names = COMPONENTS[: rows.components]
    for c in range(3, rows.components):
        increment = np.zeros_like(rows.stress)
        increment[:, c] = 1e-6
        change = np.abs(rows.after(rows.stress, increment, rows.state, 1e-6)[0] - rows.stress)
        shear, scale = change[:, 3:], rows.stress_scale(rows.stress, rows.state, increment)
        excess = (shear.max(axis=1) - shear[:, c - 3]) / scale
        row = int(np.argmax(excess))
        if excess[row] > SAME:
            answered = int(np.argmax(shear[row])) + 3
            raise FrameError(
                f"{rows.law}: strain in {names[c]} makes stress in {names[answered]} of row {row}; components stand in "
                "the order xx, yy, zz, xy, yz, xz (some codes have xy, xz, yz)"
            )


def check_moduli(rows: Rows, stress, state) -> float:
    """Small strains are answered with the stiffness that `elastic_moduli` gives, up or down, at most; its share.

    Each row is strained in volume, in shear along its own deviator and in a random plane, there and back. The power
    of the answer may not exceed that of the declared moduli, or steps would be too long; and unloading must come near
    it somewhere, or they would be needlessly short.
    """
    bulk, shear = rows.moduli(stress, state)
    size = _PROBE_STRESS * np.abs(stress).max(axis=1) / bulk + _PROBE_STRAIN
    chosen = rows.rng.normal(size=stress.shape)
    probes = {
        "bulk": (3.0 * bulk, [_volumetric(np.ones_like(stress))]),
        "shear": (2.0 * shear, [stress - _volumetric(stress), chosen - _volumetric(chosen)]),
    }
    largest = 0.0
    for name, (stiffness, directions) in probes.items():
        answers = [_stiffness(rows, stress, state, size, d, dt) for d in directions for dt in _PROBE_TIMES]
        ratio = np.max(answers, axis=0) / stiffness
        row = int(np.argmax(ratio))
        if not ratio[row] <= _STIFFER:
            raise ModuliError(
                f"{rows.law}.elastic_moduli: row {row} answers a small strain {ratio[row]:.3g} times as stiffly as its "
                f"{name} modulus says; time steps would be unstable: give the stiffness of unloading"
            )
        if not ratio[row] >= _SOFTER:
            raise ModuliError(
                f"{rows.law}.elastic_moduli: no row answers a small strain with more than {ratio[row]:.3g} of its "
                f"{name} modulus; time steps would be needlessly short: give the stiffness of unloading"
            )
        largest = max(largest, float(ratio[row]))
    return largest


def _stiffness(rows: Rows, stress, state, size, direction, dt):
    """Stress (n,) Pa per strain of `size` (n,) along `direction` (n, 4|6), there or back, whichever is stiffer."""
    weight = np.where(np.arange(rows.components) < 3, 1.0, 2.0)
    length = np.sqrt(np.sum(weight * direction**2, axis=1))
    none = length <= 1e-6 * np.abs(stress).max(axis=1)  # of the own deviator in isotropic stress
    unit = direction / np.where(none, np.inf, length)[:, None]
    still = rows.after(stress, np.zeros_like(stress), state, dt)[0]
    answers = []
    for strain in (size[:, None] * unit, -size[:, None] * unit):
        answer = rows.after(stress, strain, state, dt)[0] - still
        answers.append(np.sum(weight * answer * strain, axis=1) / size**2)
    return np.maximum(*answers)


def _volumetric(rows):
    """Spherical part of tensors (n, 4|6)."""
    part = np.zeros_like(rows)
    part[:, :3] = rows[:, :3].mean(axis=1, keepdims=True)
    return part


def check_cycle(rows: Rows) -> float:
    """Largest work of a parallelogram of strain over K strain^2 of the row; zero for a conservative law."""
    legs = _CYCLE_STRAIN * rows.rng.normal(size=(2, ROWS, rows.components))
    stress, state = rows.stress.copy(), rows.state.copy()
    bulk = rows.moduli(stress, state)[0]
    weight = np.where(np.arange(rows.components) < 3, 1.0, 2.0)
    work = np.zeros(ROWS)
    for leg in (legs[0], legs[1], -legs[0], -legs[1]):
        increment = leg / _CYCLE_STEPS
        for _ in range(_CYCLE_STEPS):
            before = stress
            stress, state = rows.after(stress, increment, state, np.inf)
            work += np.sum(weight * 0.5 * (before + stress) * increment, axis=1)
    relative = work / (bulk * _CYCLE_STRAIN**2)
    largest = float(relative[np.argmax(np.abs(relative))])
    if getattr(rows.material, "conservative", False) and not abs(largest) <= _CYCLE_LOSS:
        raise CycleEnergyError(
            f"{rows.law} declares itself conservative, but a closed cycle of strain does the work "
            f"{largest:.3g} K strain^2; derive the stress from a potential or drop `conservative`"
        )
    return largest
