"""Speed of Arena per row and update, and error against time for tolerances and fixed substeps.

    python -m benchmarks arena_speed     # one core; the best of many repetitions counts
"""

import time

import numpy as np

from periporo.materials.arena import Arena

from . import option_parser

ROWS = 1000  # a call shorter than a time slice, so that the best of many is undisturbed
STEP = 1e-5  # |strain increment| of one update
INVISCID = {"T1": 0.0, "T2": 0.0}


def started(material, rows):
    """Stress and state of fresh rows of 1 mm^3 with the ids 0, 1, ..."""
    stress = np.zeros((rows, 6))
    ids = np.repeat(np.arange(rows)[:, None], 2, axis=1)
    return stress, material.initial_state(stress, ids, np.full(rows, 1e-9))


def loaded(material):
    """Rows compressed by about 5 % with some shear, and the direction of loading of unit size."""
    stress, state = started(material, ROWS)
    amount = 0.05 * (1.0 + 0.1 * np.random.default_rng(0).random(ROWS))
    increment = np.zeros((ROWS, 6))
    increment[:, [0, 1, 3]] = amount[:, None] * np.array([-1.0, -0.2, 0.1])
    for _ in range(40):
        material.compute_stress(stress, increment / 40, state, 1.0)
    return stress, state, increment / np.linalg.norm(increment, axis=1)[:, None]


def time_per_row(material, stress, state, increment, repetitions=100, alternate=False):
    """Microseconds per row and update; rows move on by `increment`, or to and fro."""
    stress, state = stress.copy(), state.copy()
    best = np.inf
    for repetition in range(repetitions):
        change = -increment if alternate and repetition % 2 else increment
        begin = time.perf_counter()
        material.compute_stress(stress, change, state, 1e-6)
        best = min(best, time.perf_counter() - begin)
    return best / ROWS * 1e6


def elastic_rows(stress, state):
    """The same rows at 60 % of their stress: every small step from there is elastic."""
    stress, state = stress.copy(), state.copy()
    pressure = state[:, 1:2] * (np.arange(6) < 3)
    stress[:] = 0.6 * (stress + pressure) - pressure
    state[:, -6:] = stress if state.shape[1] > 6 else state[:, -6:]
    return stress, state


def skip_table():
    """One line per case: what the parts cost that a row needs, and that it skips what it does not need."""
    print(f"time per update of one row, us (|de| = {STEP:g}, default tolerance)")
    print(f"{'case':44s} elastic plastic")
    for name, parameters in (
        ("dry", {"initial_saturation": 0.0, **INVISCID}),
        ("saturated", {"initial_saturation": 1.0, **INVISCID}),
        ("partly saturated, S0 = 0.5", {"initial_saturation": 0.5, **INVISCID}),
        ("dry, rate-dependent", {"initial_saturation": 0.0}),
        ("dry, damage", {"initial_saturation": 0.0, "do_damage": True, **INVISCID}),
        ("dry, variability", {"initial_saturation": 0.0, "do_variability": True, **INVISCID}),
        ("partly saturated with all parts", {"do_damage": True, "do_variability": True}),
    ):
        material = Arena(**parameters)
        stress, state, direction = loaded(material)
        plastic = time_per_row(material, stress, state, STEP * direction)
        stress, state = elastic_rows(stress, state)
        shear = np.zeros((ROWS, 6))
        shear[:, 0] = STEP / np.sqrt(2)
        shear[:, 1] = -shear[:, 0]
        before = state[:, 0].copy()
        elastic = time_per_row(material, stress, state, shear, alternate=True)
        assert np.array_equal(before, state[:, 0]) and not state[:, 3].any()
        print(f"{name:44s} {elastic:7.3f} {plastic:7.3f}")


def path():
    """A cyclic, non-proportional strain path: corners (k, 6)."""
    corners = np.zeros((6, 6))
    corners[1:, 0] = [-0.04, -0.06, -0.055, -0.08, -0.1]
    corners[1:, 1] = [0.0, -0.02, -0.015, -0.02, 0.0]
    corners[1:, 3] = [0.0, 0.02, 0.015, -0.02, -0.03]
    return corners


def follow(material, rows, updates):
    """Stress (6,) after each corner of the path with `updates` calls between corners, and time per row."""
    stress, state = started(material, rows)
    history = []
    begin = time.perf_counter()
    for change in np.diff(path(), axis=0):
        increment = np.tile(change / updates, (rows, 1))
        for _ in range(updates):
            material.compute_stress(stress, increment, state, 1.0)
        history.append(stress[0].copy())
    return np.array(history), (time.perf_counter() - begin) / rows


def accuracy_table():
    """Error (of the largest stress) against time, for the tolerance and for fixed substeps."""
    print("\nerror against time on a cyclic, non-proportional path of five legs")
    for saturation in (0.0, 0.5, 1.0):
        soil = {"initial_saturation": saturation, **INVISCID}
        exact, _ = follow(Arena(**soil, substeps=20000), 1, 1)
        scale = np.abs(exact).max()
        for label, updates, values in (
            ("tolerance", 1, (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)),
            ("substeps", 1, (10, 30, 100, 300, 1000)),
        ):
            for value in values:
                material = Arena(**soil, **{label: value})
                history, seconds = follow(material, 200, updates)
                error = np.abs(history - exact).max() / scale
                print(f"S0 = {saturation:3.1f}  {label:9s} {value:8g}  error {error:7.1e}  {seconds * 1e6:8.1f} us")


def main(words=None):
    """Print both tables."""
    option_parser(__name__, __doc__).parse_args(words)
    skip_table()
    accuracy_table()
