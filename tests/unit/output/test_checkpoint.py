"""Checkpoint files: what they hold, what is kept, and what is refused."""

import json

import h5py
import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.watch.state import State, StateError, capture, for_file, install, point_fields, resume
from periporo.errors import OutputError
from periporo.io.output import checkpoint
from periporo.io.output.background import Background


def write(sim, target, configuration, keep, parts=None):
    background = Background(sim.comm)
    path = checkpoint.write(background, target, *for_file(sim), configuration, keep, parts)
    background.settle()
    background.close()
    return path


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


def test_parts_are_read_as_one_and_told_by_name(sim, tmp_path):
    path = write(sim, tmp_path / "run.h5", "{}", keep=1, parts=3)
    state, kept, folder = read(path, "{}"), capture(sim), path.with_name(f"{path.name}.parts")
    assert all(np.array_equal(state.points[name], kept.points[name]) for name in kept.points)
    assert np.array_equal(state.rows[0].state, kept.rows[0].state)
    part = folder / "0001.h5"
    whole = part.read_bytes()
    with h5py.File(part) as file:
        place = file["points/velocity"].id.get_chunk_info(0).byte_offset
    flipped = bytearray(whole)
    flipped[place + 9] ^= 1
    for spoilt in (flipped, whole[:3000]):
        part.write_bytes(spoilt)
        with pytest.raises(checkpoint.CheckpointError, match=r"it is damaged.*.h5.parts 0001.h5 is damaged"):
            read(path, "{}")
    part.unlink()
    with pytest.raises(checkpoint.CheckpointError, match="0001.h5 is missing"):
        read(path, "{}")
    sim.step_number = 20
    write(sim, tmp_path / "run.h5", "{}", keep=1, parts=3)
    assert not path.exists() and not folder.exists()


def test_the_last_ones_are_kept_and_halves_swept_away(sim, tmp_path):
    (tmp_path / "run.checkpoint-000000000007.h5.parts").mkdir()
    (tmp_path / "run.checkpoint-000000000007.h5.partial").write_bytes(b"half")
    (tmp_path / "other.checkpoint-000000000001.h5").write_bytes(b"another run's")
    for sim.step_number in (10, 20, 30):
        write(sim, tmp_path / "run.h5", "{}", keep=2)
    names = sorted(p.name for p in tmp_path.iterdir())
    assert names == ["other.checkpoint-000000000001.h5", *(f"run.checkpoint-{n:012d}.h5" for n in (20, 30))]
    assert [p.name for p in checkpoint.existing(tmp_path / "run.h5")] == names[:0:-1]


def test_what_is_after_the_one_just_written_is_swept_away(sim, tmp_path):
    """It is damaged, or of a motion that was taken back: the next run would go on from it."""
    for sim.step_number, keep in ((10, 3), (30, 3), (40, 3), (20, 1)):
        path = write(sim, tmp_path / "run.h5", "{}", keep=keep, parts=2)
    assert checkpoint.existing(tmp_path / "run.h5") == [path]
    assert len(list(tmp_path.glob("*.parts"))) == 1


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
