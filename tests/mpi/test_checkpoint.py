"""Interrupted runs: they go on bit for bit, on any number of ranks, whatever ends them."""

import os
import random
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml
from mpi4py import MPI

from periporo.core.scene.build import SCHEMES

HERE = Path(__file__).parent
CLI = ("-m", "periporo.core.cli")
QUIET = ("--quiet", "--no-plot")

SAND = {"model": "drucker_prager", "density": 1600.0, "bulk_modulus": 2e5, "shear_modulus": 1e5,
        "friction_angle": 30.0, "cohesion": 500.0}  # fmt: skip
SOFT = {"model": "elastic", "density": 1500.0, "bulk_modulus": 6e4, "shear_modulus": 3e4}
CLAY = {
    "model": "cam_clay", "grain_density": 2200.0, "porosity": 0.2, "bulk_modulus": 1e5, "shear_modulus": 6e4,
    "critical_state_slope": 1.1, "compression_index": 0.05, "swelling_index": 0.01, "viscosity": 1000.0,
    "overconsolidation_ratio": 1.25,
}  # fmt: skip


def column(scheme="bond_projected", **keys):
    """A plane column of clay settles between rollers, then falls on a moving floor."""
    scene = {
        "dimension": 2, "spacing": 0.01, "gravity": [0.0, -20.0], "correspondence": scheme,
        "materials": {"clay": CLAY},
        "bodies": [{"name": "column", "material": "clay", "jitter": 0.1,
                    "shape": {"type": "box", "lower": [-0.05, 0.0], "upper": [0.05, 0.15]}}],
        "initial_stress": {"type": "geostatic", "K0": 0.7},
        "boundaries": {"left": {"where": {"upper": [-0.04, None]}, "fix": ["x"]},
                       "right": {"where": {"lower": [0.04, None]}, "fix": ["x"]},
                       "load": {"where": {"body": "column"}, "traction": {"stress": [5.0, -20.0], "side": "y+"}}},
        "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.4, "damping": 0.1,
                      "velocity": [0.2, 0.0]}],
        "stages": [{"name": "settle", "type": "relax", "tolerance": 0.1, "max_steps": 500,
                    "boundaries": ["left", "right"]},
                   {"name": "fall", "type": "dynamics", "duration": 0.06, "damping": {"viscous": 0.5},
                    "boundaries": ["load"], "stop_when_at_rest": 1e-9}],
        "output": {"interval": 0.01},
    }  # fmt: skip
    return scene | keys


def wet_column():
    """The same of wet clay."""
    return column(pore_water={"suction": 2e4, "retention": {"set": "fitted"}})


def stacked_cubes():
    """A cube of sand slides on a soft one, which lies on the floor: contact of bodies."""

    def cube(name, material, height, velocity):
        lower, upper = [-0.06, -0.06, height], [0.06, 0.06, height + 0.08]
        return {"name": name, "material": material, "velocity": velocity,
                "shape": {"type": "box", "lower": lower, "upper": upper}}  # fmt: skip

    return {
        "dimension": 3, "spacing": 0.02, "gravity": [0.0, 0.0, -9.81], "materials": {"sand": SAND, "soft": SOFT},
        "bodies": [cube("low", "soft", 0.0, [0.0, 0.0, 0.0]), cube("high", "sand", 0.08, [1.0, 0.3, -0.5])],
        "contacts": [{"type": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "friction": 0.3},
                     {"type": "bodies", "first": "low", "second": "high", "friction": 0.4}],
        "stages": [{"name": "slide", "type": "dynamics", "duration": 0.05}],
        "output": {"interval": 0.01},
    }  # fmt: skip


@pytest.fixture(scope="module")
def interrupt_in(mpirun):
    """Function that runs the scenes below a folder on a number of ranks, with a signal after a step of each."""

    def run(folder, ranks, *words, name="SIGTERM", step=10**9):
        words = (HERE / "interrupted.py", name, step, "--no-plot", *words)
        return mpirun(ranks, *words, folder=folder, timeout=600)

    return run


@pytest.fixture
def interrupt(interrupt_in, tmp_path):
    """The same for the scene of this test alone."""
    return partial(interrupt_in, tmp_path)


def write_scene(folder, scene):
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene))


def checkpoints(folder):
    return sorted(folder.glob("scene.checkpoint-*"))


def test_the_state_at_a_step_is_the_same_however_the_run_got_there(interrupt, tmp_path, datasets, assert_same_bits):
    """One rank, or two ranks up to the middle of the relaxation and three from there."""
    write_scene(tmp_path, column())
    assert interrupt(1, step=40).returncode == 0
    state = datasets(checkpoints(tmp_path)[0])
    assert state["rows_0/ids"].shape[0] > 300 and state["points/id"].tolist() == list(range(150))
    assert state["points/contact_spring_0"].any() and state["points/work"].any()
    assert interrupt(2, "--overwrite", step=20).returncode == 0
    run = interrupt(3, "--resume", name="SIGINT", step=40)
    assert run.returncode == 0 and "resuming at t = " in run.stdout and "go on with: periporo scene.yaml" in run.stdout
    names = [path.name for path in checkpoints(tmp_path)]
    assert names == [f"scene.checkpoint-{step:012d}.h5" for step in (20, 40)]
    assert_same_bits(state, datasets(checkpoints(tmp_path)[1]))


MOVING = {scene.__name__: scene for scene in (column, wet_column, stacked_cubes)}


@pytest.fixture(scope="module")
def carried_on(interrupt_in, datasets, by_folder, tmp_path_factory):
    """Datasets by scene of runs on one rank to the end, and the files of runs in parts, on two, three and one."""
    folder, whole = tmp_path_factory.mktemp("parts"), {}
    for name, scene in MOVING.items():
        (folder / name).mkdir()
        write_scene(folder / name, scene())
    run = interrupt_in(folder, 1, name="SIGUSR1", step=20)  # a checkpoint, and on
    assert run.returncode == 0, run.stderr
    assert all("checkpoint at t = " in said for said in by_folder(run.stdout).values())
    for name in MOVING:
        whole[name] = datasets(folder / name / "scene.vtkhdf")
        assert not checkpoints(folder / name)  # a finished run needs none
    assert interrupt_in(folder, 2, "--overwrite", step=20).returncode == 0
    assert interrupt_in(folder, 3, "--resume", step=40).returncode == 0
    assert all(len(checkpoints(folder / name)) == 2 for name in MOVING)
    run = interrupt_in(folder, 1, "--resume")
    assert run.returncode == 0, run.stderr
    return whole, {name: folder / name / "scene.vtkhdf" for name in MOVING}


@pytest.mark.parametrize("scene", MOVING)
def test_interruptions_and_other_numbers_of_ranks_change_no_bit(carried_on, datasets, assert_same_bits, scene):
    whole, files = carried_on
    assert not np.isnan(whole[scene]["VTKHDF/Points"]).any()
    assert_same_bits(whole[scene], datasets(files[scene]))


def test_a_finished_run_is_not_resumed(carried_on, interrupt_in):
    folder = carried_on[1]["column"].parent
    assert "nothing to resume" in interrupt_in(folder, 1, "--resume").stdout


def test_the_batch_systems_signals_reach_the_ranks(interrupt, tmp_path, datasets, assert_same_bits):
    """mpirun passes SIGUSR1 and SIGTERM on; who signals it and every rank asks only once."""
    scene = column()
    scene["stages"] = [{"name": "fall", "type": "dynamics", "duration": 0.02}]
    write_scene(tmp_path, scene)
    run = interrupt(2, name="mpirun:SIGUSR1", step=20)
    assert run.returncode == 0 and "step 20: scene.checkpoint" in run.stdout, run.stderr
    if MPI.get_vendor()[0] == "Open MPI":
        pytest.skip("its mpirun answers SIGTERM by ending the ranks, with status 1 and without their last words")
    one = datasets(tmp_path / "scene.vtkhdf")
    for step, target, words in ((10, "mpirun", ["--overwrite"]), (20, "everyone", ["--resume"])):
        run = interrupt(2, *words, name=f"{target}:SIGTERM", step=step)
        assert run.returncode == 0 and f"step {step}; checkpoint" in run.stdout, run.stderr
    assert interrupt(1, "--resume").returncode == 0
    assert_same_bits(one, datasets(tmp_path / "scene.vtkhdf"))


OTHERS = [name for name in SCHEMES if name != "bond_projected"]
OTHERS += [{"scheme": "point_state", "sharpened": True}, {"scheme": "bond_projected", "balance": True},
            {"scheme": "point_state", "sharpened": True, "balance": True}]  # fmt: skip


@pytest.fixture(scope="module")
def every_scheme(interrupt_in, datasets, by_folder, tmp_path_factory):
    """Datasets of every scheme's run on one rank to the end, and the files of runs on one, then two, and three."""
    folder = tmp_path_factory.mktemp("schemes")
    folders = [folder / f"scheme{k}" for k in range(len(OTHERS))]
    for where, scheme in zip(folders, OTHERS, strict=True):
        where.mkdir()
        scene = column(scheme)
        scene["stages"] = [{"name": "fall", "type": "dynamics", "duration": 0.02}]
        write_scene(where, scene)
    assert interrupt_in(folder, 1).returncode == 0
    whole = [datasets(where / "scene.vtkhdf") for where in folders]
    for ranks, step, words in ((1, 10, ["--overwrite"]), (2, 20, ["--resume"])):
        run = interrupt_in(folder, ranks, *words, step=step)
        assert run.returncode == 0, run.stderr
        assert all(f"step {step}; checkpoint" in said for said in by_folder(run.stdout).values()), run.stdout
    run = interrupt_in(folder, 3, "--resume")
    assert run.returncode == 0, run.stderr
    return whole, [where / "scene.vtkhdf" for where in folders]


@pytest.mark.parametrize("scheme", OTHERS, ids=str)
def test_every_scheme_goes_on_bit_for_bit(every_scheme, datasets, assert_same_bits, scheme):
    """On one rank to the end, or on one, then on two, and on three."""
    (whole, files), k = every_scheme, OTHERS.index(scheme)
    assert_same_bits(whole[k], datasets(files[k]))


def test_a_damaged_checkpoint_is_passed_over(interrupt, tmp_path, datasets, assert_same_bits):
    write_scene(tmp_path, column())
    assert interrupt(1).returncode == 0
    one = datasets(tmp_path / "scene.vtkhdf")
    for step, words in ((20, ["--overwrite"]), (40, ["--resume"])):
        assert interrupt(1, *words, step=step).returncode == 0
    older, newer = checkpoints(tmp_path)
    data = bytearray(newer.read_bytes())
    with h5py.File(newer) as file:
        place = file["points/velocity"].id.get_chunk_info(0).byte_offset
    data[place + 17] ^= 1  # a single bit
    newer.write_bytes(data)
    run = interrupt(2, "--resume")
    assert run.returncode == 0 and f"{newer.name}: it is damaged" in run.stdout and older.name in run.stdout
    assert_same_bits(one, datasets(tmp_path / "scene.vtkhdf"))


def test_what_cannot_be_resumed_says_so(interrupt, tmp_path):
    write_scene(tmp_path, column())
    assert interrupt(1, step=20).returncode == 0
    write_scene(tmp_path, column(gravity=[0.0, -10.0]))
    run = interrupt(2, "--resume")
    assert run.returncode == 2 and "the scene has another gravity" in run.stderr and "Traceback" not in run.stderr
    checkpoints(tmp_path)[0].write_bytes(b"nothing")
    run = interrupt(1, "--resume")
    assert run.returncode == 2 and "it is damaged" in run.stderr
    checkpoints(tmp_path)[0].unlink()
    run = interrupt(1, "--resume")
    assert run.returncode == 2 and "there is no checkpoint beside it" in run.stderr and "--overwrite" in run.stderr


def test_the_wall_time_ends_a_run_in_time(mpirun, tmp_path):
    scene = column()
    scene["stages"][1]["duration"] = 1e3
    write_scene(tmp_path, scene)
    run = mpirun(2, *CLI, "scene.yaml", "--no-plot", "--walltime", "6", folder=tmp_path, timeout=100)
    assert run.returncode == 0, run.stderr
    assert "stopped at t = " in run.stdout and 1 <= len(checkpoints(tmp_path)) <= 2  # one half-way, to learn its cost


def test_killed_runs_resume_and_end_alike(tmp_path, datasets, assert_same_bits):
    """SIGKILL at three random moments; `python -m benchmarks kill` does it thirty times."""
    write_scene(tmp_path, column())
    command = [sys.executable, *CLI, "scene.yaml", *QUIET]
    assert subprocess.run(command, cwd=tmp_path, timeout=120).returncode == 0
    one = datasets(tmp_path / "scene.vtkhdf")
    (tmp_path / "scene.vtkhdf").unlink()
    write_scene(tmp_path, column(checkpoint={"interval": 0.05}))
    moments = random.Random(1)
    for _ in range(3):
        run = subprocess.Popen([*command, "--resume"], cwd=tmp_path)
        patience = time.monotonic() + 60
        while not checkpoints(tmp_path) and run.poll() is None and time.monotonic() < patience:
            time.sleep(0.02)
        time.sleep(moments.uniform(0.0, 0.3))
        os.kill(run.pid, signal.SIGKILL)
        run.wait()
    assert subprocess.run([*command, "--resume"], cwd=tmp_path, timeout=120).returncode == 0
    assert_same_bits(one, datasets(tmp_path / "scene.vtkhdf"))


def test_a_full_disk_ends_the_run_with_a_word(tmp_path):
    """A limit on the size of files stands in for the disk's: what was written before stays."""
    write_scene(tmp_path, column(checkpoint={"interval": 1e-3}))
    script = """
import resource, signal, sys
from mpi4py import MPI
from periporo.core import cli
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, 150_000))
sys.exit(cli.main(["scene.yaml", "--quiet", "--no-plot"]))
"""
    run = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, timeout=120, capture_output=True, text=True)
    assert run.returncode == 2, run.stderr
    assert "cannot write" in run.stderr and "File too large" in run.stderr and "Traceback" not in run.stderr
    assert not list(tmp_path.glob("*.partial"))
