"""Velocity Verlet: half kicks and the drift, with each force's work."""

import math

from periporo.core.numerics import vectors
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.points.forces import INTEGRATION, ForceChannels
from periporo.core.points.particles import Particles


def first_kick(p: Particles, forces: ForceChannels, dt: float) -> None:
    """Velocity from t to t + dt/2."""
    _first_kick(p.awake, dt, p.mass, p.velocity, p.previous_velocity, forces.arrays(), p.dim)


def take_back_kick(p: Particles) -> None:
    """Velocity from t + dt/2 back to t."""
    p.velocity[: p.awake] = p.previous_velocity[: p.awake]


def drift(p: Particles, forces: ForceChannels, dt: float) -> tuple[float, float]:
    """Position from t to t + dt.

    Returns the largest distance (m) of an owned point from where its neighbours were found, and the longest way (m).
    """
    moved, way = _drift(
        p.awake, dt, p.mass, p.velocity, p.previous_velocity, p.position, p.reference_position, p.work,
        forces.arrays(), forces.columns, INTEGRATION, p.dim,
    )  # fmt: skip
    return math.sqrt(moved), math.sqrt(way)


def second_kick(p: Particles, forces: ForceChannels, dt: float) -> None:
    """Velocity from t + dt/2 to t + dt; the dilation takes this step's change."""
    _second_kick(
        p.awake, dt, p.mass, p.velocity, p.previous_velocity, p.dilation, p.jacobian, p.work, forces.arrays(),
        forces.columns, INTEGRATION, p.dim,
    )  # fmt: skip


@kernel
def _first_kick(owned, dt, mass, velocity, previous, forces, dim):
    for i in range(owned):
        v, total = vectors.row(velocity, i, dim), vectors.zero(dim)
        for force in forces:
            total += vectors.row(force, i, dim)
        vectors.put(previous, i, v)
        v += total * (0.5 * dt / mass[i])
        vectors.put(velocity, i, v)


@kernel
def _drift(owned, dt, mass, velocity, previous, position, reference, work, forces, columns, integration, dim):
    largest, longest = 0.0, 0.0
    for i in range(owned):
        v = vectors.row(velocity, i, dim)
        longest = max(longest, vectors.dot(v, v))
        change = v - vectors.row(previous, i, dim)
        x = vectors.row(position, i, dim) + v * dt
        way = x - vectors.row(reference, i, dim)
        vectors.put(position, i, x)
        _add_work(work, i, dt, v, forces, columns, dim)
        work[i, integration] -= 0.5 * mass[i] * vectors.dot(change, change)
        moved = vectors.dot(way, way)
        if moved > largest or math.isnan(moved):  # and stays: nothing is larger than NaN
            largest = moved
    return largest, longest * dt * dt


@kernel
def _second_kick(owned, dt, mass, velocity, previous, dilation, jacobian, work, forces, columns, integration, dim):
    for i in range(owned):
        dilation[i] *= jacobian[i]
        v, total = vectors.row(velocity, i, dim), vectors.zero(dim)
        for force in forces:
            total += vectors.row(force, i, dim)
        change = total * (0.5 * dt / mass[i])
        vectors.put(previous, i, v)
        vectors.put(velocity, i, v + change)
        _add_work(work, i, dt, v, forces, columns, dim)
        work[i, integration] += 0.5 * mass[i] * vectors.dot(change, change)


@inlined
def _add_work(work, i, dt, v, forces, columns, dim):
    """Work of each force in half a step at the velocity `v` of its middle."""
    for c, force in enumerate(forces):
        work[i, columns[c]] += 0.5 * dt * vectors.dot(vectors.row(force, i, dim), v)
