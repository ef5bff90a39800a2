"""Interrupted runs: they go on bit for bit, on any number of ranks, whatever ends them."""

import os
import random
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest
import yaml
from mpi4py import MPI

from periporo.core.scene.build import SCHEMES

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
    """A plane column of clay settles between rollers, then falls on a moving floor, with a stone and a turning vane."""
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
                      "velocity": [0.2, 0.0]},
                     {"type": "disc", "name": "stone", "center": [0.0, 0.171], "radius": 0.02, "friction": 0.3,
                      "free": {"density": 2500, "velocity": [1.0, -2.0]}},
                     {"type": "box", "name": "vane", "lower": [0.052, 0.05], "upper": [0.1, 0.06], "friction": 0.3,
                      "reference": [0.1, 0.055], "rotation": {"rate": 500}}],
        "stages": [{"name": "settle", "type": "relax", "tolerance": 0.1, "max_steps": 500,
                    "boundaries": ["left", "right"]},
                   {"name": "fall", "type": "dynamics", "duration": 0.06, "damping": {"viscous": 0.5},
                    "boundaries": ["load"], "stop_when_at_rest": 1e-9}],
        "output": {"interval": 0.01},
    }  # fmt: skip
    return scene | keys


def wet_column():
    """The same of wet clay, whose water flows, while it rains on the column and the stone that falls on it drinks."""
    water = {"suction": 2e3, "retention": {"set": "fitted"}, "drainage": "flowing", "conductivity": 1e-3,
             "bulk_modulus": 1e6, "bishop": {"air_entry": 1e3}}  # fmt: skip
    scene = column({"scheme": "point_state", "sharpened": True, "regular": True}, pore_water=water)
    scene["boundaries"]["sky"] = {"where": {"lower": [None, 0.13]}, "water": {"rain": 5e-3}}
    scene["boundaries"]["sponge"] = {"where": {"body": "column"}, "water": {"pressure": -3e3, "obstacle": "stone"}}
    scene["stages"][1]["boundaries"] = ["sky", "sponge"]
    return scene


def waiting_column():
    """Wet clay of a heap settles for minutes under rain and its own weight, then moves."""
    scene = wet_column()
    del scene["boundaries"]["sponge"]
    scene["materials"] = {"clay": CLAY | {"overconsolidation_ratio": 3.0}}
    wait = {"name": "wait", "type": "quasi_static", "duration": 20.0, "accuracy": 0.1, "tolerance": 0.01,
            "boundaries": ["left", "right", "sky"]}  # fmt: skip
    scene["stages"] = [wait, {"name": "fall", "type": "dynamics", "duration": 0.002, "boundaries": ["sky"]}]
    return scene | {"contacts": scene["contacts"][:1], "output": {"interval": 5.0}}


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


def dozing():
    """One end of a slab of sand is thrown against the rest, which sleeps until it feels it."""

    def part(name, left, right, velocity):
        return {"name": name, "material": "sand", "velocity": velocity, "jitter": 0.1,
                "shape": {"type": "box", "lower": [left, 0.0], "upper": [right, 0.05]}}  # fmt: skip

    return {
        "dimension": 2, "spacing": 0.01, "gravity": [0.0, -1.0], "materials": {"sand": SAND},
        "bodies": [part("slab", -0.5, 0.0, [0.0, 0.0]), part("end", 0.0, 0.05, [-0.5, 0.2])],
        "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.4, "damping": 0.1}],
        "stages": [{"name": "hit", "type": "dynamics", "duration": 0.06}],
        "sleep": {"speed": 0.02, "steps": 10}, "time_step": {"added_inertia": 1},
        "output": {"interval": 0.02, "history_interval": 1},
    }  # fmt: skip


def softening():
    """A block of clay slumps whose softening strain is averaged over four spacings, farther than bonds reach.

    Written in three parts."""
    clay = {"model": "mohr_coulomb", "density": 1600.0, "bulk_modulus": 2e5, "shear_modulus": 1e5, "friction_angle": 0,
            "cohesion": 600.0, "sensitivity": 5.0, "remoulding_shear": 0.05, "length": 0.04}  # fmt: skip
    return column("point_state", materials={"clay": clay}) | {
        "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.4, "damping": 0.1}],
        "stages": [{"name": "fall", "type": "dynamics", "duration": 0.04}],
        "output": {"interval": 0.01, "fields": ["displacement", "plastic_shear"], "parts": 3},
    }


def channel():
    """Clay between a plane of symmetry and a free surface crosses the seam of a periodic cell, row by row."""
    scene = column(periodic={"lower": [0.0, None], "upper": [0.1, None]}, symmetry={"lower": [None, 0.0]})
    body = {"name": "heap", "material": "clay", "jitter": 0.1, "velocity": [5.0, 0.0],
            "shape": {"type": "box", "lower": [0.0, 0.0], "upper": [0.1, 0.15]}}  # fmt: skip
    return scene | {
        "gravity": [20.0, 0.0], "bodies": [body], "contacts": [], "boundaries": {}, "initial_stress": {
            "type": "uniform", "components": {"xx": -300.0, "yy": -200.0, "zz": -200.0}},
        "stages": [{"name": "flow", "type": "dynamics", "duration": 0.03}],
    }  # fmt: skip


OTHERS = [name for name in SCHEMES if name != "bond_projected"]
OTHERS += [{"scheme": "point_state", "sharpened": True}, {"scheme": "point_state", "sharpened": True, "regular": True},
           {"scheme": "bond_projected", "balance": True},
           {"scheme": "point_state", "sharpened": True, "balance": True}]  # fmt: skip


def falling(scheme):
    """The column falls at once, with another scheme."""
    return column(scheme, stages=[{"name": "fall", "type": "dynamics", "duration": 0.03}])


SCENES = {
    scene.__name__: scene() for scene in (column, wet_column, waiting_column, stacked_cubes, dozing, softening, channel)
}
SCENES |= {f"scheme {number}": falling(scheme) for number, scheme in enumerate(OTHERS)}


def write_scene(folder, scene):
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene))


def checkpoints(folder):
    return sorted(folder.glob("scene.checkpoint-*.h5"))


@pytest.fixture(scope="module")
def carried_on(launch, datasets, by_folder, tmp_path_factory):
    """The folder of runs in parts, and what runs on one rank have given: results at the end, states at step 20.

    The parts: on two ranks to step 10, on three to step 20, and on one to the end; then the checkpoints are gone,
    of which the states are returned third.
    """
    folder, steps = tmp_path_factory.mktemp("parts"), (10, 20)
    for name, scene in SCENES.items():
        (folder / name).mkdir()
        write_scene(folder / name, scene)

    def states():
        return {name: datasets(checkpoints(folder / name)[-1]) for name in SCENES}

    assert launch(1, "folders", "--no-plot", folder=folder).returncode == 0
    whole = {name: datasets(folder / name / "scene.vtkhdf") for name in SCENES}
    assert not any(checkpoints(folder / name) for name in SCENES)  # a finished run needs none
    assert launch(1, "interrupted", "SIGTERM@20", "--no-plot", "--overwrite", folder=folder).returncode == 0
    alone = states()
    run = launch(2, "interrupted", "SIGTERM@10", "--no-plot", "--overwrite", folder=folder)
    assert run.returncode == 0, run.stderr
    run = launch(3, "interrupted", "SIGINT@20", "--no-plot", "--resume", folder=folder)
    assert run.returncode == 0, run.stderr
    for name, said in by_folder(run.stdout).items():
        assert "resuming at t = " in said and "go on with: periporo scene.yaml" in said
        names = [path.name for path in checkpoints(folder / name)]
        if name == "waiting_column":  # kept is the state in which an increment began
            assert 1 <= len(names) <= len(steps) and max(names) <= f"scene.checkpoint-{steps[-1]:012d}.h5"
            continue
        assert names == [f"scene.checkpoint-{step:012d}.h5" for step in steps]
    together = states()
    assert launch(1, "folders", "--no-plot", "--resume", folder=folder).returncode == 0
    return folder, whole, alone, together


@pytest.mark.parametrize("name", SCENES)
def test_the_state_at_a_step_is_the_same_however_the_run_got_there(carried_on, assert_same_bits, name):
    """On one rank, or on two and then on three."""
    _, _, alone, together = carried_on
    assert_same_bits(alone[name], together[name])
    state = alone[name]
    assert state["rows_0/ids"].shape[0] > 100 and (np.diff(state["points/id"]) > 0).all()
    assert state["points/work"].any()
    assert name != "channel" or 0 < np.count_nonzero(state["points/sheet"]) < len(state["points/id"])
    if "column" in name:
        assert state["points/contact_spring_0"].any() and state["points/id"].tolist() == list(range(150))


@pytest.mark.parametrize("name", SCENES)
def test_interruptions_and_other_numbers_of_ranks_change_no_bit(carried_on, datasets, assert_same_bits, name):
    folder, whole, _, _ = carried_on
    assert not np.isnan(whole[name]["VTKHDF/Points"]).any() and whole[name]["History/step"][-1] > 20
    assert_same_bits(whole[name], datasets(folder / name / "scene.vtkhdf"))


def test_a_finished_run_is_not_resumed(carried_on, launch):
    run = launch(1, "folders", "--resume", folder=carried_on[0] / "column")
    assert "nothing to resume" in run.stdout


def test_the_batch_systems_signals_reach_the_ranks(launch, tmp_path, datasets, assert_same_bits):
    """mpirun passes SIGUSR1 and SIGTERM on; who signals it and every rank asks only once."""
    if MPI.get_vendor()[0] == "Open MPI":
        pytest.skip("its mpirun answers SIGTERM by ending the ranks, with status 1 and without their last words")
    write_scene(tmp_path, falling("bond_projected"))
    assert launch(1, "folders", "--no-plot", folder=tmp_path).returncode == 0
    one = datasets(tmp_path / "scene.vtkhdf")
    run = launch(2, "interrupted", "mpirun:SIGUSR1@10,mpirun:SIGTERM@20", "--overwrite", folder=tmp_path)
    assert run.returncode == 0 and "step 10: scene.checkpoint" in run.stdout, run.stderr
    assert "step 20; checkpoint" in run.stdout
    run = launch(2, "interrupted", "everyone:SIGTERM@30", "--resume", folder=tmp_path)
    assert run.returncode == 0 and "step 30; checkpoint" in run.stdout, run.stderr
    assert launch(1, "folders", "--no-plot", "--resume", folder=tmp_path).returncode == 0
    assert_same_bits(one, datasets(tmp_path / "scene.vtkhdf"))


def damage(file):
    """Turn a single bit of a checkpoint."""
    data = bytearray(file.read_bytes())
    with h5py.File(file) as checkpoint:
        place = checkpoint["points/velocity"].id.get_chunk_info(0).byte_offset
    data[place + 17] ^= 1
    file.write_bytes(data)


@pytest.fixture(scope="module")
def spoiled(launch, by_folder, tmp_path_factory):
    """The folder of columns that two ranks resume from checkpoints that do not fit, and what they say."""
    folder = tmp_path_factory.mktemp("spoiled")
    for name in ("whole", "one damaged", "all damaged", "none left", "other gravity"):
        (folder / name).mkdir()
        write_scene(folder / name, falling("bond_projected"))
    assert launch(1, "folders", "--no-plot", folder=folder / "whole").returncode == 0
    (folder / "whole" / "scene.yaml").unlink()
    assert launch(1, "interrupted", "SIGUSR1@10,SIGTERM@20", "--no-plot", folder=folder).returncode == 0
    for number, file in enumerate(checkpoints(folder / "none left")):
        damage(checkpoints(folder / "all damaged")[number])
        file.unlink()
    damage(checkpoints(folder / "one damaged")[1])
    write_scene(folder / "other gravity", falling("bond_projected") | {"gravity": [0.0, -10.0]})
    run = launch(2, "folders", "--no-plot", "--resume", folder=folder)
    assert run.returncode == 2 and "Traceback" not in run.stderr, run.stderr
    return folder, by_folder(run.stdout), by_folder(run.stderr)


def test_a_damaged_checkpoint_is_passed_over(spoiled, datasets, assert_same_bits):
    folder, said, _ = spoiled
    names = [f"scene.checkpoint-{step:012d}.h5" for step in (10, 20)]
    assert f"{names[1]}: it is damaged" in said["one damaged"] and names[0] in said["one damaged"]
    assert_same_bits(*(datasets(folder / name / "scene.vtkhdf") for name in ("whole", "one damaged")))


@pytest.mark.parametrize("name, reason", [
    ("all damaged", "it is damaged"), ("none left", "there is no checkpoint beside it"),
    ("other gravity", "the scene has another gravity"),
])  # fmt: skip
def test_what_cannot_be_resumed_says_so(spoiled, name, reason):
    error = spoiled[2][name]
    assert reason in error and error.count("periporo: ") == 1
    assert name != "none left" or "--overwrite" in error


def test_the_wall_time_ends_a_run_in_time(mpirun, tmp_path):
    scene = column()
    scene["stages"][1]["duration"] = 1e3
    write_scene(tmp_path, scene)
    run = mpirun(2, *CLI, "scene.yaml", "--no-plot", "--walltime", "3", folder=tmp_path, timeout=100)
    assert run.returncode == 0, run.stderr
    assert "stopped at t = " in run.stdout and 1 <= len(checkpoints(tmp_path)) <= 2  # one half-way, to learn its cost


def test_killed_runs_resume_and_end_alike(launch, tmp_path, datasets, assert_same_bits):
    """SIGKILL at two random moments; `python -m benchmarks kill` does it thirty times."""
    write_scene(tmp_path, column())
    assert launch(1, "folders", *QUIET, folder=tmp_path).returncode == 0
    one = datasets(tmp_path / "scene.vtkhdf")
    (tmp_path / "scene.vtkhdf").unlink()
    write_scene(tmp_path, column(checkpoint={"interval": 0.05}))
    moments = random.Random(1)
    for _ in range(2):
        run = subprocess.Popen([sys.executable, *CLI, "scene.yaml", *QUIET, "--resume"], cwd=tmp_path)
        patience = time.monotonic() + 60
        while not checkpoints(tmp_path) and run.poll() is None and time.monotonic() < patience:
            time.sleep(0.02)
        time.sleep(moments.uniform(0.0, 0.3))
        os.kill(run.pid, signal.SIGKILL)
        run.wait()
    assert launch(1, "folders", *QUIET, "--resume", folder=tmp_path).returncode == 0
    assert_same_bits(one, datasets(tmp_path / "scene.vtkhdf"))
