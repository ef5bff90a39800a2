"""Velocity Verlet: half kicks and the drift, with each force's work."""

import math

from periporo.core.energy import INTEGRATION, ForceChannels
from periporo.core.jit import kernel
from periporo.core.particles import Particles


def first_kick(p: Particles, forces: ForceChannels, dt: float) -> None:
    """Velocity from t to t + dt/2."""
    _first_kick(p.owned, dt, p.mass, p.velocity, p.previous_velocity, forces.arrays(), p.dim)


def drift(p: Particles, forces: ForceChannels, dt: float) -> float:
    """Position from t to t + dt; the largest distance (m) of an owned point from where its neighbours were found."""
    moved = _drift(
        p.owned, dt, p.mass, p.velocity, p.previous_velocity, p.position, p.reference_position, p.work,
        forces.arrays(), forces.columns(), INTEGRATION, p.dim,
    )  # fmt: skip
    return math.sqrt(moved)


def second_kick(p: Particles, forces: ForceChannels, dt: float) -> None:
    """Velocity from t + dt/2 to t + dt; the dilation takes this step's change."""
    _second_kick(
        p.owned, dt, p.mass, p.velocity, p.previous_velocity, p.dilation, p.jacobian, p.work, forces.arrays(),
        forces.columns(), INTEGRATION, p.dim,
    )  # fmt: skip


@kernel
def _first_kick(owned, dt, mass, velocity, previous, forces, dim):
    for i in range(owned):
        factor = 0.5 * dt / mass[i]
        for a in range(len(dim)):
            total = 0.0
            for force in forces:
                total += force[i, a]
            previous[i, a] = velocity[i, a]
            velocity[i, a] += factor * total


@kernel
def _drift(owned, dt, mass, velocity, previous, position, reference, work, forces, columns, integration, dim):
    largest = 0.0
    for i in range(owned):
        moved = 0.0
        gained = 0.0
        for a in range(len(dim)):
            v = velocity[i, a]
            gained += (v - previous[i, a]) ** 2
            position[i, a] += dt * v
            moved += (position[i, a] - reference[i, a]) ** 2
        work[i, integration] -= 0.5 * mass[i] * gained
        for c in range(len(forces)):
            power = 0.0
            for a in range(len(dim)):
                power += forces[c][i, a] * velocity[i, a]
            work[i, columns[c]] += 0.5 * dt * power
        if moved > largest or math.isnan(moved):  # and stays: nothing is larger than NaN
            largest = moved
    return largest


@kernel
def _second_kick(owned, dt, mass, velocity, previous, dilation, jacobian, work, forces, columns, integration, dim):
    for i in range(owned):
        dilation[i] *= jacobian[i]
        factor = 0.5 * dt / mass[i]
        gained = 0.0
        for c in range(len(forces)):
            power = 0.0
            for a in range(len(dim)):
                power += forces[c][i, a] * velocity[i, a]
            work[i, columns[c]] += 0.5 * dt * power
        for a in range(len(dim)):
            total = 0.0
            for force in forces:
                total += force[i, a]
            previous[i, a] = velocity[i, a]
            velocity[i, a] += factor * total
            gained += (factor * total) ** 2
        work[i, integration] += 0.5 * mass[i] * gained
