"""When a checkpoint is written and when a run stops: by the clock, and by signals."""

import os
import signal

import pytest
from mpi4py import MPI

from periporo.core.watch import interrupt
from periporo.core.watch.interrupt import Interrupted, Keeper, Signals
from periporo.io.output import checkpoint
from periporo.io.output.background import Background


class Clock:
    """A simulation that only has a step number, and a clock that shows it in seconds."""

    comm, step_number, time, lost = MPI.COMM_SELF, 0, 0.0, 0.0

    def __call__(self):
        return self.step_number + self.lost


def keeper_of(clock, signals=None, **times):
    written = []

    def write(sim):
        written.append(sim.step_number)
        return checkpoint.path_of(checkpoint.Path("run.h5"), sim.step_number)

    writing = Background(MPI.COMM_SELF)
    return Keeper(write, signals or Signals(), writing, clock=clock, message=written.append, **times), written


def advance(keeper, clock, steps):
    for clock.step_number in range(1, steps + 1):
        keeper.check(clock)


def test_checkpoints_by_the_clock():
    clock = Clock()
    keeper, written = keeper_of(clock, interval=25.0)
    advance(keeper, clock, 100)
    assert written == [30, 60, 90]  # at the first look, every ten steps, after the interval


def test_the_wall_time_stops():
    clock = Clock()
    keeper, written = keeper_of(clock, walltime=45.0)
    with pytest.raises(Interrupted, match="stopped at t = 0 s, step 40; checkpoint run.checkpoint-000000000040.h5"):
        advance(keeper, clock, 100)
    assert written == [30, 40]  # the first one tells how long they take; at the next look it would be too late


def test_time_is_left_for_the_last_checkpoint():
    clock = Clock()
    keeper, written = keeper_of(clock, walltime=100.0)
    write = keeper.write

    def slowly(sim):
        clock.lost += 20.0
        return write(sim)

    keeper.write = slowly
    with pytest.raises(Interrupted):
        advance(keeper, clock, 100)
    assert written == [50, 60] and clock() == 100.0


def test_signals_are_wishes_until_they_are_granted():
    clock, before = Clock(), signal.getsignal(signal.SIGTERM)
    with Signals() as signals:
        keeper, written = keeper_of(clock, signals)
        os.kill(os.getpid(), signal.SIGUSR1)
        advance(keeper, clock, 20)
        assert written[0] == 10 and "checkpoint at t = " in written[1] and len(written) == 2
        os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGTERM)  # the same request, from mpirun for example
        with pytest.raises(Interrupted):
            advance(keeper, clock, 20)
    assert signal.getsignal(signal.SIGTERM) == before


def test_a_second_request_to_stop_kills(monkeypatch):
    killed = []
    monkeypatch.setattr(interrupt.os, "kill", lambda pid, number: killed.append((pid, number)))
    monkeypatch.setattr(interrupt.time, "monotonic", lambda: now)
    now = 100.0
    with Signals() as signals:
        stop = signal.getsignal(signal.SIGTERM)
        stop(signal.SIGTERM, None)
        now += 0.9 * interrupt.ECHO
        signal.getsignal(signal.SIGINT)(signal.SIGINT, None)
        assert not killed and signals.wishes
        now += 0.2 * interrupt.ECHO
        stop(signal.SIGTERM, None)
        assert killed == [(os.getpid(), signal.SIGTERM)] and signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
