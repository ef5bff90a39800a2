"""Several ranks: the same bits as on one, one voice, and no hang when something fails."""

import json
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml

from periporo.core.scene.build import SCHEMES

HERE = Path(__file__).parent
CONFIGS = HERE.parents[1] / "configs"
CLI = ("-m", "periporo.core.cli")

SOFT_CLAY = {
    "model": "cam_clay", "grain_density": 2200.0, "porosity": 0.2, "bulk_modulus": 1e5, "shear_modulus": 6e4,
    "critical_state_slope": 1.1, "compression_index": 0.05, "swelling_index": 0.01, "viscosity": 1000.0,
    "overconsolidation_ratio": 1.25,
}  # fmt: skip
SOFT = {"model": "elastic", "density": 1500.0, "bulk_modulus": 6e4, "shear_modulus": 3e4}
SAND = {"model": "drucker_prager", "density": 1600.0, "bulk_modulus": 2e5, "shear_modulus": 1e5,
        "friction_angle": 30.0, "cohesion": 500.0}  # fmt: skip


def collapse(scheme="bond_projected", duration=0.12):
    """A plane column settles between rollers, then falls on a rough floor and against a wall."""
    return {
        "dimension": 2, "spacing": 0.01, "gravity": [0.0, -20.0], "correspondence": scheme,
        "materials": {"soil": SOFT_CLAY},
        "bodies": [{"name": "column", "material": "soil", "jitter": 0.1,
                    "shape": {"type": "box", "lower": [-0.05, 0.0], "upper": [0.05, 0.15]}}],
        "initial_stress": {"type": "geostatic", "K0": 0.7},
        "boundaries": {"left": {"where": {"upper": [-0.04, None]}, "fix": ["x"]},
                       "right": {"where": {"lower": [0.04, None]}, "fix": ["x"]},
                       "load": {"where": {"body": "column"}, "traction": {"stress": [5.0, -20.0], "side": "y+"}}},
        "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.4, "damping": 0.1},
                     {"type": "box", "lower": [0.1, -0.1], "upper": [0.12, 0.05], "friction": 0.2}],
        "stages": [{"name": "settle", "type": "relax", "tolerance": 0.1, "boundaries": ["left", "right"]},
                   {"name": "fall", "type": "dynamics", "duration": duration, "damping": {"viscous": 0.5},
                    "boundaries": ["load"]}],
        "output": {"interval": duration / 5},
    }  # fmt: skip


def impact():
    """A cube of sand hits the floor askew."""
    return {
        "dimension": 3, "spacing": 0.02, "gravity": [0.0, 0.0, -9.81], "materials": {"sand": SAND},
        "bodies": [{"name": "cube", "material": "sand", "velocity": [3.0, 1.0, -3.0],
                    "shape": {"type": "box", "lower": [-0.06, -0.06, 0.02], "upper": [0.06, 0.06, 0.14]}}],
        "contacts": [{"type": "plane", "point": [0, 0, 0], "normal": [0.1, 0, 1], "friction": 0.3}],
        "stages": [{"name": "hit", "type": "dynamics", "duration": 0.05}],
        "output": {"interval": 0.01},
    }  # fmt: skip


def two_soils():
    """Clay on a soft layer slides down an incline and turns over, in pieces."""
    return {
        "dimension": 2, "spacing": 0.01, "gravity": [3.0, -9.81],
        "materials": {"clay": SOFT_CLAY, "soft": SOFT},
        "bodies": [{"name": "block", "material": "soft", "velocity": [1.5, -0.5], "jitter": 0.2,
                    "layers": [{"above": 0.06, "material": "clay"}],
                    "shape": {"type": "box", "lower": [0.0, 0.0], "upper": [0.12, 0.1]}}],
        "contacts": [{"type": "plane", "point": [0, 0], "normal": [0.1, 1], "friction": 0.5}],
        "stages": [{"name": "slide", "type": "dynamics", "duration": 0.12}],
        "output": {"interval": 0.03},
    }  # fmt: skip


def landslide():
    """Debris slides down natural ground that all ranks share."""
    ground, release = (str(CONFIGS / name) for name in ("mountain.asc", "mountain_release.asc"))
    return {
        "dimension": 3, "spacing": 30.0, "gravity": [0.0, 0.0, -9.81],
        "materials": {"debris": SAND | {"density": 2000.0, "bulk_modulus": 5e7, "shear_modulus": 2e7}},
        "bodies": [{"name": "slide", "material": "debris",
                    "shape": {"type": "raster", "ground": ground, "thickness": release}}],
        "contacts": [{"type": "terrain", "ground": ground, "friction": 0.1}],
        "stages": [{"name": "slide", "type": "dynamics", "duration": 8.0}],
        "output": {"interval": 2.0},
    }  # fmt: skip


OTHERS = [name for name in SCHEMES if name != "bond_projected"]
OTHERS += [{"scheme": "point_state", "sharpened": True, "regular": True}, {"scheme": "bond_projected", "balance": True},
            {"scheme": "point_state", "sharpened": True, "balance": True}]  # fmt: skip
MOVING = [collapse, impact, two_soils]


@pytest.fixture(scope="module")
def simulated(mpirun, tmp_path_factory, scene_of):
    """The result files by number of ranks and name: every number of ranks is started once for all its scenes."""
    few = scene_of(counts=(3, 1), stages=[{"name": "fall", "type": "dynamics", "duration": 2e-3}],
                   time_step={"fixed": 2e-5})  # fmt: skip
    cases = [(scene.__name__, scene(), (1, 2, 3, 4)) for scene in MOVING]
    cases += [(f"scheme{k}", collapse(scheme, duration=0.02), (1, 3)) for k, scheme in enumerate(OTHERS)]
    cases += [("few", few, (1, 5)), ("landslide", landslide(), (1, 3))]
    parent, files = tmp_path_factory.mktemp("simulated"), {}
    for ranks in (1, 2, 3, 4, 5):
        for name, scene, numbers in cases:
            if ranks in numbers:
                folder = parent / str(ranks) / name
                folder.mkdir(parents=True)
                (folder / "scene.yaml").write_text(yaml.safe_dump(scene))
                files[ranks, name] = folder / "scene.vtkhdf"
        run = mpirun(ranks, HERE / "folders.py", "--quiet", "--no-plot", folder=parent / str(ranks), timeout=600)
        assert run.returncode == 0, run.stderr
    return files


def attributes(path):
    """What a run says of itself."""
    with h5py.File(path) as file:
        return dict(file["Run"].attrs)


def test_ground_that_ranks_share_gives_the_same_bits(simulated, datasets, assert_same_bits):
    one = datasets(simulated[1, "landslide"])
    assert len(one["VTKHDF/Steps/Values"]) >= 5 and not np.isnan(one["VTKHDF/Points"]).any()
    assert_same_bits(one, datasets(simulated[3, "landslide"]))


@pytest.mark.parametrize("scene", MOVING, ids=lambda s: s.__name__)
def test_results_have_the_same_bits_on_one_to_four_ranks(simulated, datasets, assert_same_bits, scene):
    one, alone = datasets(simulated[1, scene.__name__]), attributes(simulated[1, scene.__name__])
    assert alone["rebuilds"] > 50 and alone["migrated_points"] == alone["messages"] == 0
    assert len(one["VTKHDF/Steps/Values"]) >= 5
    assert not np.isnan(one["VTKHDF/Points"]).any()
    for ranks in (2, 3, 4):
        file = simulated[ranks, scene.__name__]
        assert_same_bits(one, datasets(file))
        run = attributes(file)
        assert run["ranks"] == ranks and run["rebuilds"] == alone["rebuilds"]
        assert run["migrated_points"] > 50 and run["messages"] > 0 and run["bytes_sent"] > run["messages"]


@pytest.mark.parametrize("scheme", OTHERS, ids=str)
def test_every_scheme_has_the_same_bits_on_three_ranks(simulated, datasets, assert_same_bits, scheme):
    name = f"scheme{OTHERS.index(scheme)}"
    assert_same_bits(datasets(simulated[1, name]), datasets(simulated[3, name]))


def test_more_ranks_than_points(simulated, datasets, assert_same_bits):
    one = datasets(simulated[1, "few"])
    assert set(one["VTKHDF/PointData/id"]) == {0, 1, 2, -1}  # and the corners of the obstacle
    assert_same_bits(one, datasets(simulated[5, "few"]))


@pytest.mark.parametrize("ranks", [1, 2, 3, 4])
def test_parts_of_the_core(mpirun, tmp_path, ranks):
    run = mpirun(ranks, HERE / "parts.py", folder=tmp_path)
    assert run.returncode == 0, run.stderr
    assert len(run.stdout.split()) == 7


def test_a_fault_on_one_rank_ends_the_job_with_its_traceback(mpirun, tmp_path, scene_of):
    scene = scene_of(stages=[{"name": "fall", "type": "dynamics", "duration": 1e3}])  # hours, unless it is ended
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene))
    run = mpirun(3, HERE / "program.py", "fault", "scene.yaml", "--quiet", folder=tmp_path, timeout=180)
    assert run.returncode != 0
    assert "periporo: rank 1 failed:" in run.stderr and "Traceback" in run.stderr
    assert "ZeroDivisionError: injected fault" in run.stderr
    assert "rank 0 failed" not in run.stderr and "rank 2 failed" not in run.stderr


@pytest.mark.parametrize(("word", "reason"), [("lost", "No such file or directory"), ("full", "File too large")])
def test_a_disk_that_fails_ends_all_ranks_with_a_line(mpirun, tmp_path, scene_of, word, reason):
    stages = [{"name": "fall", "type": "dynamics", "duration": 1e3}]  # hours, unless it is ended
    scene = scene_of(counts=(20, 10), stages=stages, output={"interval": 1e-4}, checkpoint={"interval": 0.1})
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene))
    run = mpirun(2, HERE / "program.py", word, "scene.yaml", "--quiet", folder=tmp_path, timeout=180)
    assert run.returncode == 2, run.stderr
    assert run.stderr.count("cannot write") == 1 and reason in run.stderr and "Traceback" not in run.stderr
    assert not list(tmp_path.glob("*.partial")) and not list(tmp_path.glob("*.lock"))


def test_only_rank_0_speaks(mpirun, tmp_path, scene_of):
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene_of()))
    run = mpirun(3, HERE / "program.py", "tap", "scene.yaml", "--no-plot", folder=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "energy ledger" in run.stdout + run.stderr
    assert [(tmp_path / f"rank{r}.txt").read_text() for r in (1, 2)] == ["", ""]


@pytest.mark.parametrize("word", ["run", "check"])
def test_bad_input_is_reported_once_and_the_same_as_on_one_rank(mpirun, tmp_path, scene_of, word):
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump(scene_of(spacing=0.01) | {"spacing": -1.0, "horizn": 2}))
    runs = [mpirun(ranks, *CLI, word, "bad.yaml", folder=tmp_path) for ranks in (1, 2)]
    assert [run.returncode for run in runs] == [2, 2]
    assert runs[0].stderr.strip() == runs[1].stderr.strip() and runs[1].stderr.count("horizn") == 1
    assert not runs[1].stdout.strip() and "Traceback" not in runs[1].stderr
    assert [f.name for f in tmp_path.iterdir()] == ["bad.yaml"]


def test_an_unwritable_result_is_reported_once_by_all_ranks(mpirun, tmp_path, scene_of):
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene_of()))
    (tmp_path / "scene.vtkhdf").mkdir()
    began = time.monotonic()
    run = mpirun(2, *CLI, "scene.yaml", "--quiet", "--overwrite", folder=tmp_path)
    assert run.returncode == 2 and run.stderr.count("scene.vtkhdf") == 1, run.stderr
    assert "Traceback" not in run.stderr and time.monotonic() - began < 120


SHARES = """
import json, sys
from mpi4py import MPI
from periporo import Simulation
sim = Simulation.from_scene(json.loads(sys.argv[1]))
sim.start()
shares = []
while sim.rebuild_count < 5:
    sim.step()
    shares.append(MPI.COMM_WORLD.allgather(len(sim.bonds.pairs.first)))
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps([max(s) * len(s) / sum(s) for s in shares]))
"""


def test_ranks_share_pairs_and_not_points(mpirun, scene_of, tmp_path):
    """A strip of two rows has as many points as the block beside it, and a third fewer pairs."""
    scene = scene_of(counts=(20, 20), contacts=[], gravity=[0.0, 0.0])
    block, d = scene["bodies"][0], scene["spacing"]
    (_, y), right = block["shape"]["lower"], block["shape"]["upper"][0]
    strip = {"type": "box", "lower": [right + 5 * d, y], "upper": [right + 205 * d, y + 2 * d]}
    moving = {"material": block["material"], "velocity": [3.0, 0.0]}
    scene["bodies"] = [block | moving, {"name": "strip", "shape": strip} | moving]
    done = mpirun(2, "-c", SHARES, json.dumps(scene), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    imbalance = json.loads(done.stdout)
    assert imbalance[0] > 1.15 and imbalance[-1] < 1.08, imbalance
