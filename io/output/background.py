"""Writing in the background: what a rank writes is done by a thread, one thing after the other, while steps go on.

HDF5 is called by one thread at a time in this way. Nothing is swallowed: what fails is raised, on all ranks alike, when
the ranks next agree, which guards do every few steps (`signs`, `look`) and every writer before its next piece
(`settle`).
"""

import os
import threading
from collections import deque
from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from periporo.errors import OutputError

BUSY, FAILED = 1, 2  # signs

_MOST_BYTES = 1 << 29  # that wait to be written on a rank; more, and the giver waits


class Background:
    """What this rank of `comm` has to write; every rank has one."""

    def __init__(self, comm: MPI.Comm):
        self.comm = comm
        self.undo: Callable[[], object] = _nothing  # what every rank does when one has failed
        self._afterwards: list[tuple] = []
        self._waiting: deque[tuple] = deque()
        self._bytes = 0  # of what waits
        self._working = False
        self._failure: tuple[str, Exception] | None = None
        self._change = threading.Condition()
        self._thread: threading.Thread | None = None

    def do(self, what: str, action: Callable, *arguments, size: int = 0) -> None:
        """Have `action(*arguments)` done after all that was given before, unless some of that fails.

        what: the words of an error, as 'cannot write run.vtkhdf'. size: bytes that are held until it is done.
        """
        with self._change:
            self._change.wait_for(lambda: self._bytes == 0 or self._bytes + size <= _MOST_BYTES)
            if self._failure is not None:
                return
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="writer", daemon=True)
                self._thread.start()
            self._waiting.append((what, action, arguments, size))
            self._bytes += size
            self._change.notify_all()

    def afterwards(self, what: str, action: Callable, *arguments) -> None:
        """The same on rank 0, when what all ranks were given before is done; every rank calls."""
        if self.comm.size == 1:
            self.do(what, action, *arguments)
        else:
            self._afterwards.append((what, action, arguments))

    def signs(self) -> int:
        """BUSY and FAILED of this rank; joined by 'or' over all ranks they are what `look` wants."""
        with self._change:
            return (BUSY if self._working or self._waiting else 0) | (FAILED if self._failure is not None else 0)

    def look(self, signs: int) -> None:
        """Go on with what waited for all ranks, or raise what failed; with the `signs` of all ranks, on all."""
        if signs & FAILED:
            self.settle()
        elif not signs & BUSY:
            self._go_on()

    def settle(self) -> None:
        """Wait until everything is written; collective. Raises OutputError on all ranks if something failed on one."""
        self._agree()
        if self._afterwards:  # on all ranks alike
            self._go_on()
            self._agree()

    def _go_on(self):
        afterwards, self._afterwards = self._afterwards, []
        for what, action, arguments in afterwards if self.comm.rank == 0 else ():
            self.do(what, action, *arguments)

    def _agree(self):
        with self._change:
            self._change.wait_for(lambda: not self._working and not self._waiting)
            failure = self._failure
        failed = np.array([self.comm.size if failure is None else self.comm.rank])
        self.comm.Allreduce(MPI.IN_PLACE, failed, MPI.MIN)
        if failed[0] == self.comm.size:
            return
        self._failure = failure or ("", OutputError())  # nothing more is begun, on any rank
        undo, self.undo = self.undo, _nothing
        undo()
        self._afterwards = []
        if failure is not None and not isinstance(failure[1], OSError | RuntimeError | OutputError):
            raise failure[1]  # a fault of the program: its traceback
        raise OutputError(self.comm.bcast(None if failure is None else _words(*failure), root=failed[0]))

    def close(self) -> None:
        """End the thread after what it is doing now; what waits is dropped."""
        with self._change:
            self._waiting.clear()
            self._waiting.append(())
            self._change.notify_all()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _work(self):
        while True:
            with self._change:
                self._change.wait_for(lambda: self._waiting)
                if self._waiting[0] == ():
                    return
                what, action, arguments, size = self._waiting.popleft()
                self._working = True
            try:
                action(*arguments)
            except Exception as error:  # raised again when the ranks agree
                failure = what, error
            else:
                failure = None
            del action, arguments
            with self._change:
                self._working = False
                self._bytes -= size
                if failure is not None:
                    self._failure = failure
                    self._waiting.clear()
                    self._bytes = 0
                self._change.notify_all()


def _words(what, error):
    if isinstance(error, OutputError):
        return str(error)
    number = getattr(error, "errno", None)
    return f"{what}: {os.strerror(number) if number else error}"


def _nothing():
    pass
