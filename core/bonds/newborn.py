"""What a row begins with whose pair came within the horizon, and rows that end."""

import numpy as np

from periporo.core.bonds.averages import merged
from periporo.core.bonds.bonds import Bonds
from periporo.core.numerics.jit import kernel
from periporo.core.points.neighbours import original
from periporo.core.points.particles import INHERITED, Particles


def admit_newborn(bonds: Bonds, particles: Particles, dt: float) -> None:
    """Give state to rows whose pair came within the horizon, and take it from those that left.

    A newborn row takes the mean of its two points' averages (logarithmic where the state field asks for
    it), followed by one return mapping without a strain increment. A point without active rows has no
    say; a row between two such points starts from `initial_stress`, or zero.
    """
    holders = [bonds.layout.holders(b, bonds.pairs) for b in bonds.blocks]
    if not any(_changes(*h, particles.share, b.active) for h, b in zip(holders, bonds.blocks, strict=True)):
        return
    # averages still count rows that end now: so do those that arrived from the ghosts' owners
    newborn = [_newborn_rows(*h, particles.share, b.active) for h, b in zip(holders, bonds.blocks, strict=True)]
    if any(len(rows) for rows in newborn):
        _average_ends(bonds, particles, newborn)
    for block, rows, held in zip(bonds.blocks, newborn, holders, strict=True):
        _deactivate(*held, particles.share, block.active)
        if len(rows):
            _initialise(bonds, block, rows, particles, dt)
            block.active[rows] = True


def _average_ends(bonds, particles, newborn):
    ends = [end for b, rows in zip(bonds.blocks, newborn, strict=True) for end in bonds.ends(b, rows)]
    points = np.unique(np.concatenate(ends)).astype(np.int64)
    bonds.average(particles, points[points < particles.owned])


def _initialise(bonds, block, rows, particles, dt):
    average = getattr(particles, block.average)
    ends = bonds.ends(block, rows)
    first, second = average[ends[0]], average[ends[1]]
    weight = first[:, :1] + second[:, :1]
    values = merged(first[:, 1:], second[:, 1:], first[:, :1], second[:, :1], particles.components, block)
    components = particles.components
    stress = np.ascontiguousarray(values[:, :components])
    state = np.ascontiguousarray(values[:, components:])
    alone = np.flatnonzero(weight[:, 0] == 0.0)
    if len(alone):
        stress[alone] = _stress_from_nothing(bonds, particles, ends[0][alone], ends[1][alone])
        volume = 0.5 * (particles.volume[ends[0][alone]] + particles.volume[ends[1][alone]])
        ids, place = bonds.layout.keys(block, bonds.pairs)
        law = block.law_of(rows[alone])
        try:
            state[alone] = law.initial_state(stress[alone], original(ids[place[rows[alone]]]), volume)
        except ValueError as error:  # other ranks go on until all are asked: it counts as a refusal
            block.refused = rows[alone], str(error)
    if block.given is not None:
        still = np.zeros((len(rows), block.spin.shape[1]))
        block.given.tell(state, np.zeros_like(stress), still, bonds.places(particles, *ends), bonds.time)
    block.take(stress, np.zeros_like(stress), state, dt, rows)
    block.stress[rows], block.state[rows] = stress, state


def _stress_from_nothing(bonds, particles, first, second):
    if bonds.inherits:
        stress = getattr(particles, INHERITED)
        return 0.5 * (stress[first] + stress[second])
    if bonds.initial_stress is None:
        return np.zeros((len(first), particles.components))
    stress = bonds.initial_stress(0.5 * (particles.position[first] + particles.position[second]))
    if bonds.initial_stress_is_total:
        stress[:, :3] -= 0.5 * (particles.pore_stress[first] + particles.pore_stress[second])[:, None]
    return stress


@kernel
def _changes(pair, first, second, weight, share, active):
    """Whether a row becomes active, or has left the horizon or lost an end."""
    for r in range(pair.shape[0]):
        b = pair[r]
        if active[r] != (weight[b] > 0.0 and share[first[b], 1] > 0.0 and share[second[b], 1] > 0.0):
            return True
    return False


@kernel
def _newborn_rows(pair, first, second, weight, share, active):
    """Numbers of the rows that are about to become active."""
    found = 0
    for r in range(pair.shape[0]):
        found += not active[r] and weight[pair[r]] > 0.0
    rows = np.empty(found, np.int64)
    if found == 0:
        return rows
    k = 0
    for r in range(pair.shape[0]):
        b = pair[r]
        if not active[r] and weight[b] > 0.0 and share[first[b], 1] > 0.0 and share[second[b], 1] > 0.0:
            rows[k] = r
            k += 1
    return rows[:k]


@kernel
def _deactivate(pair, first, second, weight, share, active):
    """Take activity from rows that left the horizon or lost an end."""
    for r in range(pair.shape[0]):
        b = pair[r]
        if active[r] and not (weight[b] > 0.0 and share[first[b], 1] > 0.0 and share[second[b], 1] > 0.0):
            active[r] = False
