"""When to write a checkpoint and when to stop: by the clock, or because a signal asks.

SIGTERM and SIGINT ask for a checkpoint and the end of the run, SIGUSR1 for a checkpoint. Any rank may receive the
signal. All ranks decide alike, by the number of the step. A second SIGTERM or SIGINT ends the program at once, unless
it follows the first so soon that it must be the same request: batch systems send one to every process of a job, mpirun
among them, which passes it on.
"""

import os
import signal
import time

import numpy as np
from mpi4py import MPI

CHECK_INTERVAL = 10
"""Steps between two looks at signals, clock and health."""

ECHO = 2.0
"""Seconds in which a request to stop may arrive more than once."""

_CHECKPOINT, _STOP, _DUE = 1, 2, 4
_OF_WRITING = 3  # bits to the left: signs of what is written in the background


class Interrupted(Exception):
    """The run was asked to stop, and a checkpoint is written; raised on all ranks alike."""


class Signals:
    """What signals have asked for since they were last looked at; a context in which they do not kill."""

    def __init__(self):
        self.wishes = 0
        self._before = {}
        self._asked_to_stop = np.inf  # when, s

    def __enter__(self):
        for number, wish in ((signal.SIGTERM, _STOP), (signal.SIGINT, _STOP), (signal.SIGUSR1, _CHECKPOINT)):
            self._before[number] = signal.signal(number, lambda n, frame, wish=wish: self._note(n, wish))
        return self

    def __exit__(self, *_):
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number, wish):
        self.wishes |= wish
        if wish == _STOP:
            now = time.monotonic()
            self._asked_to_stop = min(self._asked_to_stop, now)
            if now > self._asked_to_stop + ECHO:
                signal.signal(number, signal.SIG_DFL)
                os.kill(os.getpid(), number)


class Keeper:
    """Writes checkpoints at the times that were asked for, and stops the run by `Interrupted` when it is time.

    write: collective function of the simulation that has a checkpoint written and returns its path. signals: a
    `Signals`. background: what is written while steps go on (`io.output.background`); it is looked at as often.
    interval, walltime: s since `began` (by `clock`), None for never; rank 0's clock decides. message: function of a
    text.
    """

    def __init__(
        self, write, signals, background, *, interval=None, walltime=None, message=print, clock=time.monotonic,
        began=None,
    ):  # fmt: skip
        self.write = write
        self.signals = signals
        self.background = background
        self.interval = interval
        self.message = message
        self.clock = clock
        began = clock() if began is None else began
        self._end = np.inf if walltime is None else began + walltime
        self._next = np.inf if interval is None else began + interval
        if walltime is not None:  # one half-way tells how long they take
            self._next = min(self._next, began + 0.5 * walltime)
        self._slowest = 0.0  # checkpoint so far, s: time to leave for the last one
        self._looked = began

    def start_stage(self, sim, stage) -> None:
        """Nothing to do."""

    def refused(self, sim, refusal) -> None:
        """Nothing to do."""

    def conclude(self, sim) -> bool:
        """Nothing to do."""
        return True

    def check(self, sim) -> None:
        """After a step: write a checkpoint if it is time, and raise Interrupted if it is time to stop."""
        if sim.step_number % CHECK_INTERVAL != 0:
            return
        wishes = np.array([self._wishes(sim.comm.rank) | self.background.signs() << _OF_WRITING])
        sim.comm.Allreduce(MPI.IN_PLACE, wishes, MPI.BOR)
        self.background.look(wishes[0] >> _OF_WRITING)
        wishes &= _CHECKPOINT | _STOP | _DUE
        if wishes[0]:
            began = self.clock()
            path = self.write(sim)
            if wishes[0] != _DUE or self._end < np.inf:  # someone waits for it, or for the time that it takes
                self.background.settle()
            now = self.clock()
            self._slowest = max(self._slowest, now - began)
            self._next = np.inf if self.interval is None else now + self.interval
            if wishes[0] & _STOP:
                raise Interrupted(f"stopped at t = {sim.time:.6g} s, step {sim.step_number}; checkpoint {path.name}")
            if wishes[0] & _CHECKPOINT:
                self.message(f"checkpoint at t = {sim.time:.6g} s, step {sim.step_number}: {path.name}")
            self.signals.wishes &= ~_CHECKPOINT

    def _wishes(self, rank):
        wishes = self.signals.wishes
        if rank == 0:
            now = self.clock()
            wishes |= _DUE if now >= self._next else 0
            until_next_look = now - self._looked
            wishes |= _STOP if now + until_next_look + 1.5 * self._slowest >= self._end else 0
            self._looked = now
        return wishes
