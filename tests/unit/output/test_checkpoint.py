"""Checkpoint files and the decision when to write one."""

import json
import os
import signal

import h5py
import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.watch import interrupt
from periporo.core.watch.interrupt import Interrupted, Keeper, Signals
from periporo.core.watch.state import State, StateError, capture, install, memory, point_fields, resume, tables
from periporo.errors import OutputError
from periporo.io.output import checkpoint


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

    return Keeper(write, signals or Signals(), clock=clock, message=written.append, **times), written


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


def write(sim, target, configuration, keep):
    return checkpoint.write(sim.comm, target, sim.step_number, memory(sim), tables(sim), configuration, keep)


def read(path, *arguments):
    return State.of_tables(*checkpoint.read(path, MPI.COMM_SELF, *arguments))


@pytest.fixture
def sim(started, scene_of):
    result = started(scene_of(counts=(6, 5), stages=[{"name": "fall", "type": "dynamics", "duration": 1.0}]))
    for _ in range(10):
        result.step()
    return result


def test_a_file_holds_the_state(sim, tmp_path):
    path = write(sim, tmp_path / "run.h5", json.dumps({"a": 1}), keep=2)
    state, kept = read(path, json.dumps({"a": 1})), capture(sim)
    assert path.name == "run.checkpoint-000000000010.h5" and set(state.points) == set(point_fields(sim))
    assert all(np.array_equal(state.points[name], kept.points[name]) for name in kept.points)
    assert np.array_equal(state.rows[0].stress, kept.rows[0].stress) and state.memory == kept.memory
    assert sim.bonds.blocks[0].active.sum() == len(state.rows[0].ids)


def test_the_last_ones_are_kept_and_halves_swept_away(sim, tmp_path):
    (tmp_path / "run.checkpoint-000000000007.h5.partial").write_bytes(b"half")
    (tmp_path / "other.checkpoint-000000000001.h5").write_bytes(b"another run's")
    for sim.step_number in (10, 20, 30):
        write(sim, tmp_path / "run.h5", "{}", keep=2)
    names = sorted(p.name for p in tmp_path.iterdir())
    assert names == ["other.checkpoint-000000000001.h5", *(f"run.checkpoint-{n:012d}.h5" for n in (20, 30))]
    assert [p.name for p in checkpoint.existing(tmp_path / "run.h5")] == names[:0:-1]


def test_damage_and_another_scene_are_told_apart(sim, tmp_path):
    path = write(sim, tmp_path / "run.h5", json.dumps({"gravity": 1, "spacing": 2}), keep=1)
    with pytest.raises(OutputError, match="the scene has another gravity"):
        read(path, json.dumps({"gravity": 2, "spacing": 2}))
    with h5py.File(path, "r+") as file:
        del file["rows_0/state"]
    with pytest.raises(checkpoint.CheckpointError, match="it is damaged"):
        read(path, json.dumps({"gravity": 1, "spacing": 2}))


def test_another_versions_checkpoint_is_told_and_refused_where_it_does_not_fit(sim, tmp_path):
    path = write(sim, tmp_path / "run.h5", "{}", keep=1)
    said = []
    state = read(path, "{}", said.append)
    assert not said
    with h5py.File(path, "r+") as file:
        file.attrs["program"] = "0123456789abcdef"
    read(path, "{}", said.append)
    assert len(said) == 1 and path.name in said[0] and "not to the last bit" in said[0]
    del state.memory["time_step"]["ratio"]
    with pytest.raises(StateError, match="it does not remember 'ratio'"):
        resume(sim, state)
    state.points["spin"] = state.points.pop("work")
    with pytest.raises(StateError, match=r"other fields of the points \(spin, work\)"):
        resume(sim, state)


def test_a_lost_folder_is_a_clear_error(sim, tmp_path):
    with pytest.raises(OutputError, match="cannot write the checkpoint .*gone/run.checkpoint-.*: No such file"):
        write(sim, tmp_path / "gone" / "run.h5", "{}", keep=1)


def test_a_state_put_back_goes_on_to_the_last_bit(sim):
    state = capture(sim)
    for _ in range(15):
        sim.step()
    first = {name: getattr(sim.particles, name).copy() for name in point_fields(sim)}
    clock = sim.memory()
    install(sim, state)
    for _ in range(15):
        sim.step()
    assert sim.memory() == clock
    for name, values in first.items():
        n = sim.particles.owned
        assert np.array_equal(values[:n], getattr(sim.particles, name)[:n]), name


def test_what_cannot_take_its_place_is_swept_away(sim, tmp_path):
    checkpoint.path_of(tmp_path / "run.h5", sim.step_number).mkdir()
    with pytest.raises(OutputError, match="cannot write the checkpoint .*: Is a directory"):
        write(sim, tmp_path / "run.h5", "{}", keep=1)
    assert not list(tmp_path.glob("*.partial"))
