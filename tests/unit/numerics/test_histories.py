"""Motions from records: integrals are exact, drifts are measured and taken off."""

import numpy as np
import pytest

from periporo.core.numerics.histories import Course, drift, integrated, without_drift

TIMES = np.array([0.0, 0.3, 1.0, 1.4])
VALUES = np.array([2.0, -1.0, 4.0, 0.0])


@pytest.mark.parametrize("kind, order", [("displacement", 0), ("velocity", 1), ("acceleration", 2)])
def test_displacement_is_the_integral_of_what_is_given(kind, order):
    """Against sums of a fine quadrature of the same lines."""
    course = Course(kind, TIMES, VALUES)
    fine = np.linspace(0.0, 2.0, 200_001)
    values = np.interp(fine, TIMES, VALUES, right=0.0 if kind == "acceleration" else VALUES[-1])
    for _ in range(order):
        steps = 0.5 * (values[1:] + values[:-1]) * np.diff(fine)
        values = np.concatenate([[0.0], np.cumsum(steps)])
    for t in (0.0, 0.17, 0.3, 0.9, 1.4, 1.9):
        assert course.displacement(t) == pytest.approx(np.interp(t, fine, values), abs=2e-5)
        h = 1e-6
        slope = (course.displacement(t + h) - course.displacement(t + 1e-12)) / h
        assert course.velocity(t + 1e-12) == pytest.approx(slope, abs=2e-5)
    before = {"displacement": 2.0, "velocity": -2.0, "acceleration": 0.0}
    assert course.displacement(-1.0) == pytest.approx(before[kind])


def test_a_record_without_drift_ends_at_rest_where_it_began():
    times = np.linspace(3.0, 13.0, 2001)
    values = np.sin(5.0 * times) * np.exp(-((times - 8.0) ** 2)) + 0.02
    assert min(drift(times, values)) > 0.5
    right = without_drift(times, values)
    velocity, displacement = integrated(times, right)
    assert abs(velocity[-1]) < 1e-12 and abs(displacement[-1]) < 1e-12
    bend = np.diff(values - right, 2)
    assert np.abs(bend).max() < 1e-14  # what was taken off is a line
