"""V1, V2 (a), V10: strain and rotation under imposed motion."""

import numpy as np

from periporo.core.numerics.tensors import component_count, from_matrix, to_matrix

from .common import BULK, DEFAULT, SHEAR, Figure, ImposedVelocity, box, hooke, order, owned, point_stress, simulation


def _cloud(dimension, scheme, count=None, **scene):
    """A jittered box of points, with surfaces on all sides."""
    n = count or (9 if dimension == 2 else 5)
    shape = box([0.0] * dimension, [n * 0.01] * dimension)
    return simulation(0.01, shape, dimension=dimension, scheme=scheme, jitter=0.2, **scene)


def _affine_step(gradient):
    """Strain increment (3, 3) and volume ratio of one step with displacement gradient `gradient` of the end."""
    unit = np.eye(3)
    middle = gradient @ np.linalg.inv(unit - gradient / 2.0)
    spin = (middle - middle.T) / 2.0
    half = np.linalg.inv(unit - spin / 4.0) @ (unit + spin / 4.0)
    return half @ (middle + middle.T) @ half.T / 2.0, 1.0 / np.linalg.det(unit - gradient)


def affine_velocity(full=False, scheme=DEFAULT):
    """V1: one step of an affine velocity field, whose strain must be exact at every point, surfaces included."""
    figures = []
    for dimension in (2, 3):
        sim = _cloud(dimension, scheme, (30 if dimension == 2 else 12) if full else None)
        sim.start()
        random = np.random.default_rng(dimension)
        gradient = np.zeros((3, 3))
        gradient[:dimension, :dimension] = 0.05 * random.normal(size=(dimension, dimension))
        sim.dt = 1e-3
        velocity = owned(sim, "position") @ gradient[:dimension, :dimension].T / sim.dt + random.normal(size=dimension)
        sim.particles.velocity[: len(velocity)] = velocity
        sim.evaluate_forces()
        strain, ratio = _affine_step(gradient)
        exact = hooke(from_matrix(strain[None], component_count(dimension)))
        error = np.abs(point_stress(sim) - exact).max() / np.abs(exact).max()
        figures.append(Figure(f"stress of an affine step, {dimension}D, relative", error, at_most=1e-12))
        error = np.abs(owned(sim, "jacobian") - ratio).max()
        figures.append(Figure(f"volume ratio of an affine step, {dimension}D", error, at_most=1e-12))
    return figures


def _rotation(axis, angle):
    """Rotation matrix (3, 3) about a unit vector (Rodrigues)."""
    cross = np.cross(np.eye(3), axis)
    return np.eye(3) - np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def rigid_turns(full=False, scheme=DEFAULT):
    """V2 (a): rigid rotation, 100 steps per turn: an initial stress must turn with the body, and none may appear."""
    turns = 3 if not full else 1000 if scheme == DEFAULT else 100
    start = {"xx": 2e4, "yy": -1e4, "zz": 5e3, "xy": 7e3}
    figures = []
    for dimension in (2, 3):
        axis = np.array([0.0, 0.0, 1.0]) if dimension == 2 else np.array([1.0, 2.0, -2.0]) / 3.0
        components = start if dimension == 2 else start | {"yz": -3e3, "xz": 4e3}
        initial = {"type": "uniform", "components": components}
        sim = _cloud(dimension, scheme, 6 if dimension == 2 else 4, initial_stress=initial, time_step={"fixed": 1e-4})
        sim.start()
        first = to_matrix(point_stress(sim)[:1])[0]
        change = (_rotation(axis, 2.0 * np.pi / 100) - np.eye(3))[:dimension, :dimension]
        centre = owned(sim, "position").mean(axis=0)
        sim.prescribed_motions = [ImposedVelocity(lambda x, dt, c=centre, a=change: (x - c) @ a.T / dt)]
        worst = 0.0
        for step in range(1, 100 * turns + 1):
            sim.step()
            if step % 97 == 0 or step == 100 * turns:
                turn = _rotation(axis, 2.0 * np.pi * step / 100)
                exact = from_matrix((turn @ first @ turn.T)[None], sim.particles.components)
                worst = max(worst, np.abs(point_stress(sim) - exact).max())
        figures.append(Figure(f"stress error after {turns} turns, {dimension}D, / K", worst / BULK, at_most=1e-10))
    return figures


def _sheared(steps, scheme):
    """Largest error of the stress, in mu, over a simple shear to 2 in `steps` steps.

    Corners are left out: drawn to sharp tips, they come to have too few neighbours and fly off.
    """
    sim = _cloud(2, scheme, time_step={"fixed": 1.0 / steps})
    sim.start()
    sim.prescribed_motions = [ImposedVelocity(lambda x, dt: np.stack([2.0 * x[:, 1], 0.0 * x[:, 1]], axis=1))]
    worst = 0.0
    for step in range(1, steps + 1):
        sim.step()
        if step % 10 == 0:
            angle = 2.0 * step / steps
            normal, shear = 1.0 - np.cos(angle), np.sin(angle)
            exact = SHEAR * np.array([[normal, -normal, 0.0, shear]])
            from_middle = np.abs(owned(sim, "initial_position") - 0.045).sum(axis=1)
            worst = max(worst, np.abs(point_stress(sim) - exact)[from_middle < 0.05].max())
    return worst / SHEAR


def simple_shear(full=False, scheme=DEFAULT):
    """V10: simple shear to 2 of a hypoelastic cloud through many changes of neighbours (Jaumann rate)."""
    errors = [_sheared(steps, scheme) for steps in ((250, 500, 1000) if full else (500, 1000))]
    return [
        Figure("stress error at 1000 steps, / mu", errors[-1], at_most=1e-6),
        Figure("order in the step", order(errors), at_least=1.9),
    ]
