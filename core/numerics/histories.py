"""Records of acceleration over time, linear between their values: the velocity and the displacement that they mean."""

import numpy as np


def integrated(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocity (n,) m/s and displacement (n,) m at `times` (n,) s of a motion with accelerations `values` (n,) m/s^2.

    It begins at rest. Exact for values that are linear in between.

    >>> [x.tolist() for x in integrated(np.array([0.0, 2.0]), np.array([3.0, 3.0]))]
    [[0.0, 6.0], [0.0, 6.0]]
    """
    step = np.diff(times)
    velocity = np.concatenate([[0.0], np.cumsum(0.5 * step * (values[:-1] + values[1:]))])
    ways = step * velocity[:-1] + step**2 * (2.0 * values[:-1] + values[1:]) / 6.0
    return velocity, np.concatenate([[0.0], np.cumsum(ways)])


def drift(times: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """What a record of acceleration leaves at its end: velocity over its largest one, displacement over its largest."""
    velocity, displacement = integrated(times, values)
    largest = np.abs(velocity).max(), np.abs(displacement).max()
    return (
        float(abs(velocity[-1]) / largest[0]) if largest[0] else 0.0,
        float(abs(displacement[-1]) / largest[1]) if largest[1] else 0.0,
    )


def without_drift(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The record (n,) less a straight line, such that it ends at rest where it began.

    >>> t = np.linspace(0.0, 1.0, 101)
    >>> drift(t, without_drift(t, np.sin(7.0 * t) + 0.3)) < (1e-12, 1e-12)
    True
    """
    velocity, displacement = integrated(times, values)
    if len(times) < 2:
        return values
    T = times[-1] - times[0]
    level, slope = np.linalg.solve([[T, T**2 / 2.0], [T**2 / 2.0, T**3 / 6.0]], [velocity[-1], displacement[-1]])
    return values - level - slope * (times - times[0])


class Course:
    """Displacement and velocity over time of a motion whose `kind` is linear between `values` (n,) at `times` (n,) s.

    The kind is displacement (m), velocity (m/s) or acceleration (m/s^2). Before the first and after the last time,
    displacement or velocity stay as they are there; an acceleration begins and ends there, from rest.

    >>> fall = Course("acceleration", [1.0, 2.0], [10.0, 10.0])
    >>> [fall.displacement(t) for t in (0.0, 1.5, 2.0, 3.0)], [fall.velocity(t) for t in (0.0, 1.5, 3.0)]
    ([0.0, 1.25, 5.0, 15.0], [0.0, 5.0, 10.0])
    >>> Course("velocity", [0.0, 2.0], [0.0, 3.0]).displacement(4.0)
    9.0
    """

    def __init__(self, kind: str, times, values):
        self.times, values = np.asarray(times, float), np.asarray(values, float)
        zero, step = np.zeros(len(values)), np.diff(self.times)
        slope = np.append(np.diff(values) / step, 0.0)
        match kind:
            case "displacement":
                terms = values, slope, zero, zero
            case "velocity":
                way = np.concatenate([[0.0], np.cumsum(0.5 * step * (values[1:] + values[:-1]))])
                terms = way, values, slope, zero
            case "acceleration":
                velocity, way = integrated(self.times, values)
                terms = way, velocity, np.append(values[:-1], 0.0), slope
            case other:
                raise ValueError(f"no kind of motion '{other}'")
        self._terms = np.stack(terms, axis=1)  # displacement and its derivatives behind each of the times
        self._before = values[0] if kind == "velocity" else 0.0  # velocity

    @property
    def end(self) -> float:
        """Time (s) of its last entry."""
        return float(self.times[-1])

    def displacement(self, time: float) -> float:
        """Displacement, m, at a time, s."""
        (u, v, a, b), into = self._behind(time)
        return float(u + into * (v + into * (0.5 * a + into * b / 6.0)))

    def velocity(self, time: float) -> float:
        """Velocity, m/s, at a time, s."""
        (_, v, a, b), into = self._behind(time)
        return float(v + into * (a + 0.5 * into * b))

    def _behind(self, time):
        """Displacement and its derivatives at the last of the times that has come, and the time since."""
        k = int(np.searchsorted(self.times, time, side="right")) - 1
        if k < 0:
            return (self._terms[0, 0], self._before, 0.0, 0.0), time - self.times[0]
        return self._terms[k], time - self.times[k]


class AccelerationHistory(Course):
    """Velocity m/s, at a time (s) in a step of `dt`, of a motion with accelerations `values` m/s^2 at `times` s."""

    def __init__(self, times, values):
        super().__init__("acceleration", times, values)

    def __call__(self, time: float, dt: float) -> float:
        return self.velocity(time)
