"""What obstacles and boundaries bear, added up over all ranks at the end of every step."""

import numpy as np
from mpi4py import MPI

from periporo.core.ranks.reductions import exact_sums
from periporo.core.watch.observers import Observer


class Reactions(Observer):
    """Adds up the reactions of the `obstacles` that are told, with the same bits on any number of ranks.

    The first of the observers: others look at what it fills. `touching` are the contacts between obstacles, by which
    free ones end their step.
    """

    def __init__(self, obstacles, touching=None):
        self.obstacles = list(obstacles)
        self.touching = touching
        self._present: tuple = None, []  # contacts of the stage, and the obstacles among them
        self._near: tuple = None, []  # point ids for which neighbours were found, and the obstacles that they are near

    def start_stage(self, sim, stage) -> None:
        """The forces with which the stage begins; none on what is not there."""
        self._add_up(sim, 0.0)

    def after_step(self, sim) -> None:
        """The forces at the end of the step; while relaxation holds the time they have no impulse."""
        self._add_up(sim, 0.0 if sim.rate_independent else sim.dt)

    def memory(self) -> dict:
        """The springs between obstacles."""
        return {} if self.touching is None else {"springs": self.touching.memory()}

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        self.touching.recall(memory["springs"])

    def _add_up(self, sim, dt):
        if self._present[0] is not sim.contacts:
            self._present = sim.contacts, [o for o in self.obstacles if o in sim.contacts]
            self._near = None, []
            for obstacle in self.obstacles:
                if obstacle not in self._present[1]:
                    obstacle.reaction.vanish()
        if self._near[0] is not sim.particles.id:  # found anew, or put back to where they were
            self._near = sim.particles.id, self._found(sim)
        near = self._near[1]
        if near:
            sums = exact_sums(sim.comm, [o.reaction.rows for o in near])
            for obstacle, of_obstacle in zip(near, sums, strict=True):
                obstacle.reaction.add_up(of_obstacle, dt)
        if self.touching is not None:
            self.touching.close(sim.contacts, sim.time, dt)

    def _found(self, sim):
        """The obstacles that points of any rank are near, or that have just borne something."""
        present, p = self._present[1], sim.particles
        near = np.array([not o.is_idle(p) or o.reaction.loads.any() for o in present], bool)
        sim.comm.Allreduce(MPI.IN_PLACE, near, MPI.LOR)
        return [obstacle for obstacle, found in zip(present, near, strict=True) if found]
