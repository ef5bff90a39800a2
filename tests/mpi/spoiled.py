"""Runs the command line in folders named by a fault (see folders.py): it spoils the state after a step, once or always.

    mpirun -n 2 python spoiled.py --no-plot ...     in folders "nan", "nan again", ...

Point and bond are named by ids, whichever rank has them: the fault is the same on any number of ranks.
"""

import sys
from unittest import mock

import folders
import numpy as np

from periporo.core.points.material import StepRefused
from periporo.core.watch.watchdog import Watchdog, wave_speeds

STEP = 31
ENERGY_STEP = 111  # nobody looks at the energy before
POINT, BOND = 17, (16, 17)


def rows_of_point(particles):
    return np.flatnonzero(particles.id == POINT)


def nan(sim):
    p = sim.particles
    p.velocity[rows_of_point(p)] = np.nan


def nan_stress(sim):
    ids, place = sim.bonds.layout.keys(sim.bonds.blocks[0], sim.bonds.pairs)
    sim.bonds.blocks[0].stress[np.isin(ids[place], BOND).all(axis=1), 1] = np.nan


def speed(sim):
    p, fastest = sim.particles, wave_speeds(sim)[0]
    p.velocity[rows_of_point(p), 0] = 3.0 * fastest


def energy(sim):
    sim.particles.velocity *= 1.5


def strain(sim):
    """A point leaps and is back within the next step, and the law does not notice: only its bonds' strain tells."""
    kind, deform = type(sim.scheme), type(sim.scheme).deform

    def leap(scheme, particles, *arguments):
        kind.deform = deform
        kept = particles.velocity.copy()
        particles.velocity[rows_of_point(particles)] += 5.0 * sim.spacing / sim.dt
        deform(scheme, particles, *arguments)
        particles.velocity[:] = kept
        for block in sim.bonds.blocks:
            block.strain_increment[:] = 0.0

    kind.deform = leap


def refused(sim):
    """The law refuses a point's rows in the next step, and leaves them spoiled."""
    law, block = type(sim.materials[0]), sim.bonds.blocks[0]
    advance = law.compute_stress

    def refuse(self, stress, *others):
        law.compute_stress = advance
        ids, place = sim.bonds.layout.keys(block, sim.bonds.pairs)
        rows = np.flatnonzero((ids[place] == POINT).any(axis=1))
        stress[rows] = np.nan
        if len(rows):
            raise StepRefused(rows, "it is tired")

    law.compute_stress = refuse


FAULTS = {
    "nan": nan, "nan_stress": nan_stress, "speed": speed, "strain": strain, "energy": energy, "refused": refused,
}  # fmt: skip


def spoiling(name):
    """The context in which the fault happens that a folder is named by."""
    kind, _, again = name.partition(" ")
    spoils, step = [FAULTS[kind]] * (99 if again else 1), ENERGY_STEP if kind == "energy" else STEP

    def check_spoiled(self, sim, check=Watchdog.check):
        if spoils and sim.step_number == step:
            spoils.pop()(sim)
        check(self, sim)

    return mock.patch.object(Watchdog, "check", check_spoiled)


def main(words):
    """The exit status."""
    return folders.main(words, spoiling)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
