"""Several ranks: the same bits as on one, one voice, and no hang when something fails."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml

from periporo.io.output.results import open_results

CONFIGS = Path(__file__).parents[2] / "configs"

SOFT_CLAY = {
    "model": "cam_clay", "grain_density": 2200.0, "porosity": 0.2, "bulk_modulus": 1e5, "shear_modulus": 6e4,
    "critical_state_slope": 1.1, "compression_index": 0.05, "swelling_index": 0.01, "viscosity": 1000.0,
    "overconsolidation_ratio": 1.25,
}  # fmt: skip
SOFT = {"model": "elastic", "density": 1500.0, "bulk_modulus": 6e4, "shear_modulus": 3e4}
SAND = {"model": "drucker_prager", "density": 1600.0, "bulk_modulus": 2e5, "shear_modulus": 1e5,
        "friction_angle": 30.0, "cohesion": 500.0}  # fmt: skip


def collapse(duration=0.07):
    """A plane column settles between rollers, then falls on a rough floor and against a wall."""
    return {
        "dimension": 2, "spacing": 0.01, "gravity": [0.0, -20.0], "correspondence": "bond_projected",
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
        "stages": [{"name": "hit", "type": "dynamics", "duration": 0.03}],
        "output": {"interval": 0.006},
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
        "stages": [{"name": "slide", "type": "dynamics", "duration": 0.06}], "time_step": {"added_inertia": 2},
        "output": {"interval": 0.015},
    }  # fmt: skip


def varied():
    """Sand whose strength is a random field falls askew and comes apart, bonds between other points form."""
    cohesion = {"field": "random", "mean": 400.0, "variation": 0.5, "length": 0.04, "seed": 2}
    angle = {"field": "depth", "at": [0.0, 0.1], "values": [20.0, 35.0]}
    scene = impact() | {"correspondence": "bond_projected"}
    return scene | {"materials": {"sand": SAND | {"cohesion": cohesion, "friction_angle": angle}}}


ROCK = "".join(f"v {x} {y} {z}\n" for x in (1450, 1550) for y in (1000, 1400) for z in (600, 900)) + (
    "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
)  # a box


def landslide():
    """Debris slides down natural ground that all ranks share, onto a rock of triangles."""
    ground, release = (str(CONFIGS / name) for name in ("mountain.asc", "mountain_release.asc"))
    return {
        "dimension": 3, "spacing": 30.0, "gravity": [0.0, 0.0, -9.81],
        "materials": {"debris": SAND | {"density": 2000.0, "bulk_modulus": 5e7, "shear_modulus": 2e7}},
        "bodies": [{"name": "slide", "material": "debris",
                    "shape": {"type": "raster", "ground": ground, "thickness": release}}],
        "contacts": [{"type": "terrain", "ground": ground, "friction": 0.1},
                     {"type": "mesh", "name": "rock", "file": "../../rock.obj", "friction": 0.3}],
        "stages": [{"name": "slide", "type": "dynamics", "duration": 8.0}],
        "output": {"interval": 2.0},
    }  # fmt: skip


def sled():
    """A block slides on a deformable base."""
    boxes = {"base": ([0.0, 0.0], [0.6, 0.1]), "block": ([0.1, 0.1], [0.4, 0.2])}
    return {
        "dimension": 2, "spacing": 0.025, "gravity": [0.0, -9.81], "materials": {"soft": SOFT},
        "bodies": [{"name": name, "material": "soft", "velocity": [1.0 if name == "block" else 0.0, 0.0],
                    "shape": {"type": "box", "lower": low, "upper": high}} for name, (low, high) in boxes.items()],
        "boundaries": {"ground": {"where": {"body": "base", "upper": [None, 0.05]}, "fix": ["x", "y"]}},
        "contacts": [{"type": "bodies", "first": "block", "second": "base", "friction": 0.5, "damping": 0.3}],
        "stages": [{"name": "slide", "type": "dynamics", "duration": 0.1, "boundaries": ["ground"]}],
        "output": {"interval": 0.02},
    }  # fmt: skip


FIRM = {"cohesion": 2e4, "bulk_modulus": 5e6, "shear_modulus": 2e6}


def construction():
    """A bank is dug off, filled up, treated, shaken through a base that absorbs, and weakened until it falls."""
    held = ["base", "left"]
    return {
        "dimension": 2, "spacing": 0.5, "gravity": [0.0, -10.0],
        "materials": {"sand": SAND | FIRM | {"cohesion": 5e3}, "treated": SAND | FIRM | {"density": 1700.0}},
        "bodies": [{"name": "bank", "material": "sand", "shape": {"type": "box", "lower": [0, 0], "upper": [6, 3]}},
                   {"name": "fill", "material": "sand", "shape": {"type": "box", "lower": [4, 1], "upper": [5, 2]}}],
        "boundaries": {"base": {"where": {"upper": [None, 0.5]}, "fix": ["x", "y"]},
                       "left": {"where": {"upper": [0.5, None]}, "fix": ["x"]},
                       "rock": {"where": {"upper": [None, 0.5]}, "absorb": {
                           "side": "y-", "beyond": "treated",
                           "velocity": {"x": {"times": [0, 0.05, 0.1], "values": [0, 0.1, 0]}}}}},
        "stages": [{"name": "dig", "type": "relax", "tolerance": 0.02, "boundaries": held,
                    "remove": [{"lower": [4, 1]}]},
                   {"name": "fill", "type": "relax", "tolerance": 0.02, "boundaries": held, "place": ["fill"],
                    "change": [{"lower": [1, 1], "upper": [3, 2], "into": "treated"}], "gravity_factor": 0.9},
                   {"name": "shake", "type": "dynamics", "duration": 0.3, "boundaries": ["rock", "left"]},
                   {"name": "safety", "type": "strength_reduction", "trial": 0.5, "damping": {"viscous": 20.0},
                    "accuracy": 0.5, "boundaries": held}],
        "output": {"interval": 0.05},
    }  # fmt: skip


def tied():
    """A strip whose sides move alike is shaken."""
    sides = {"where": {"upper": [0.5, None]}, "tie": {"to": {"lower": [5.5, None]}, "components": ["x", "y"]}}
    pulse = {"times": [0, 0.05, 0.1], "values": [0, 0.1, 0]}
    return {
        "dimension": 2, "spacing": 0.5, "materials": {"sand": SAND | FIRM},
        "bodies": [{"name": "strip", "material": "sand", "shape": {"type": "box", "lower": [0, 0], "upper": [6, 5]}}],
        "boundaries": {"sides": sides, "base": {"where": {"upper": [None, 0.5]}, "velocity": {"x": pulse, "y": 0.0}}},
        "stages": [{"name": "shake", "type": "dynamics", "duration": 0.3, "boundaries": ["sides", "base"],
                    "damping": {"viscous": 2.0, "relative_to": "base"}}],
        "output": {"interval": 0.05},
    }  # fmt: skip


def five_laws():
    """Sensitive clay, grains, dense sand, loose silt and mud fall beside each other onto an incline."""
    common = {"density": 1600.0, "bulk_modulus": 2e5, "shear_modulus": 1e5}
    clay = {"model": "mohr_coulomb", "cohesion": 400.0, "friction_angle": 0.0, "tension_cutoff": 0.0,
            "sensitivity": 5.0, "remoulding_shear": 0.2, "length": 0.02, "rate_coefficient": 0.1,
            "reference_rate": 0.1}  # fmt: skip
    grains = {"model": "granular_mu_i", "grain_density": 2600.0, "grain_diameter": 1e-3, "static_friction": 0.38,
              "largest_friction": 0.64, "inertial_number": 0.28}  # fmt: skip
    sand = {"model": "hypoplastic_sand", "density": 1600.0, "initial_void_ratio": 0.7, "hardness": 1e7,
            "critical_friction_angle": 33.0, "exponent": 0.25, "densest_void_ratio": 0.55, "alpha": 0.25,
            "critical_void_ratio": 0.95, "loosest_void_ratio": 1.05, "beta": 1.5}  # fmt: skip
    silt = {"model": "norsand", "density": 1600.0, "initial_state_parameter": 0.05, "critical_state_slope": 1.3,
            "critical_void_ratio": 0.9, "compression_index": 0.05, "dilatancy": 4.0, "coupling": 0.3,
            "hardening": 80.0, "shear_modulus": 1e6, "report_dissipation": True}  # fmt: skip
    mud = {"model": "herschel_bulkley", "yield_stress": 50.0, "consistency": 5.0, "exponent": 0.5}
    laws = {"clay": clay | common, "grains": grains | common, "sand": sand, "silt": silt, "mud": mud | common}
    return {
        "dimension": 2, "spacing": 0.01, "gravity": [2.0, -9.81], "materials": laws,
        "bodies": [{"name": name, "material": name, "velocity": [0.5, -0.5],
                    "shape": {"type": "box", "lower": [0.08 * k, 0.0], "upper": [0.08 * (k + 1), 0.08]}}
                   for k, name in enumerate(laws)],
        "initial_stress": {"type": "geostatic", "K0": 0.6},
        "contacts": [{"type": "plane", "point": [0, 0], "normal": [0.05, 1], "friction": 0.5}],
        "stages": [{"name": "fall", "type": "dynamics", "duration": 0.02}],
        "output": {"interval": 0.004},
    }  # fmt: skip


def rings():
    """A cylinder of sand falls to the floor, and around a disc."""
    return {
        "dimension": 2, "axisymmetric": True, "spacing": 0.01, "gravity": [0.0, -20.0],
        "materials": {"sand": SAND | {"match": "compression"}},
        "bodies": [{"name": "cylinder", "material": "sand", "shape": {"type": "box", "lower": [0, 0],
                                                                      "upper": [0.1, 0.1]}}],
        "contacts": [{"type": "plane", "point": [0, 0], "normal": [1, 0], "friction": 0},
                     {"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.4, "damping": 0.1},
                     {"type": "disc", "center": [0.15, 0.0], "radius": 0.04, "friction": 0.2, "name": "torus"}],
        "stages": [{"name": "fall", "type": "dynamics", "duration": 0.1}],
        "output": {"interval": 0.02},
    }  # fmt: skip


MOVING = [collapse, impact, two_soils]


@pytest.fixture(scope="module")
def simulated(launch, by_folder, tmp_path_factory, scene_of):
    """The result files, and what is said, by number of ranks and name: each number is started once for all scenes."""
    few = scene_of(counts=(3, 1), stages=[{"name": "fall", "type": "dynamics", "duration": 4e-4}],
                   time_step={"fixed": 2e-5}, output={"interval": 1e-4})  # fmt: skip
    monitored = scene_of(counts=(30, 8), monitor={"points": [[-0.1, 0.08], [0.1, 0.0]]})
    cases = [(scene.__name__, scene(), (1, 2, 3, 4)) for scene in MOVING]
    cases += [("sled", sled(), (1, 3)), ("few", few, (1, 4)), ("monitored", monitored, (1, 3))]
    cases += [("landslide", landslide(), (1, 3)), ("construction", construction(), (1, 3))]
    cases += [("varied", varied(), (1, 3)), ("tied", tied(), (1, 3))]
    cases += [("five_laws", five_laws(), (1, 3)), ("rings", rings(), (1, 3))]
    parent, files, said = tmp_path_factory.mktemp("simulated"), {}, {}
    (parent / "rock.obj").write_text(ROCK)
    for ranks in (1, 2, 3, 4):
        for name, scene, numbers in cases:
            if ranks in numbers:
                folder = parent / str(ranks) / name
                folder.mkdir(parents=True)
                (folder / "scene.yaml").write_text(yaml.safe_dump(scene))
                files[ranks, name] = folder / "scene.vtkhdf"
        run = launch(ranks, "simulate", "--no-plot", folder=parent / str(ranks), timeout=600)
        whispers = [file.read_text() for file in sorted((parent / str(ranks)).glob("rank*.txt"))]
        assert run.returncode == 0, (run.stderr, whispers)
        assert whispers == [""] * (ranks - 1), "others than rank 0 speak"
        said |= {(ranks, name): text for name, text in by_folder(run.stdout).items()}
    return files, said


def attributes(path):
    """What a run says of itself."""
    with h5py.File(path) as file:
        return dict(file["Run"].attrs)


@pytest.mark.parametrize("name", ["landslide", "construction", "varied", "five_laws", "tied", "rings"])
def test_ground_and_strength_that_ranks_share_give_the_same_bits(simulated, datasets, assert_same_bits, name):
    files = simulated[0]
    one = datasets(files[1, name])
    assert len(one["VTKHDF/Steps/Values"]) >= 5 and not np.isnan(one["VTKHDF/Points"]).any()
    assert_same_bits(one, datasets(files[3, name]))


@pytest.mark.parametrize("scene", MOVING, ids=lambda s: s.__name__)
def test_results_have_the_same_bits_on_one_to_four_ranks(simulated, datasets, assert_same_bits, scene):
    files, name = simulated[0], scene.__name__
    one, alone = datasets(files[1, name]), attributes(files[1, name])
    assert alone["rebuilds"] > 20 and alone["migrated_points"] == alone["messages"] == 0
    assert len(one["VTKHDF/Steps/Values"]) >= 5
    assert not np.isnan(one["VTKHDF/Points"]).any()
    for ranks in (2, 3, 4):
        assert_same_bits(one, datasets(files[ranks, name]))
        run = attributes(files[ranks, name])
        assert run["ranks"] == ranks and run["rebuilds"] == alone["rebuilds"]
        assert run["migrated_points"] > 30 and run["messages"] > 0 and run["bytes_sent"] > run["messages"]


def test_contact_of_bodies_has_the_same_bits_on_three_ranks(simulated, datasets, assert_same_bits):
    files = simulated[0]
    assert attributes(files[1, "sled"])["rebuilds"] > 5
    assert_same_bits(datasets(files[1, "sled"]), datasets(files[3, "sled"]))


def test_more_ranks_than_points(simulated, datasets, assert_same_bits):
    files = simulated[0]
    one = datasets(files[1, "few"])
    assert set(one["VTKHDF/PointData/id"]) == {0, 1, 2, -1}  # and the corners of the obstacle
    assert_same_bits(one, datasets(files[4, "few"]))


def test_monitored_points_have_the_same_histories_on_any_number_of_ranks(simulated):
    found = []
    for ranks in (1, 3):
        with open_results(simulated[0][ranks, "monitored"]) as results:
            found.append({n: results.history(n).tolist() for n in results.history_names if n.startswith("point_")})
    assert found[0] == found[1] and len(found[0]) == 8
    assert any(found[0]["point_0_velocity_y"]) and found[0]["point_0_velocity_y"] != found[0]["point_1_velocity_y"]


def test_plain_lines_show_energies_speed_rebuilds_and_imbalance(simulated):
    said = simulated[1][3, "monitored"]
    lines = [line for line in said.splitlines() if line.startswith("fall  ")]
    assert len(lines) >= 1
    for words in ("t = ", "step 1", "dt ", "kinetic ", "internal ", "residual ", "max speed ", "rebuilds 1"):
        assert words in lines[0]
    assert 1.0 <= float(lines[0].split("imbalance ")[1].split()[0]) < 1.3
    assert said.count("energy ledger") == 1


@pytest.mark.parametrize("ranks", [1, 2, 3, 4])
def test_parts_of_the_core(simulated, ranks):
    names = simulated[1][ranks, "parts"].split()
    assert len(names) == 10 and all(name.startswith("check_") for name in names)


def test_a_fault_on_one_rank_ends_the_job_with_its_traceback(launch, tmp_path, scene_of):
    scene = scene_of(stages=[{"name": "fall", "type": "dynamics", "duration": 1e3}])  # hours, unless it is ended
    (tmp_path / "fault").mkdir()
    (tmp_path / "fault" / "scene.yaml").write_text(yaml.safe_dump(scene))
    run = launch(2, "failing", "--quiet", folder=tmp_path, timeout=180)
    assert run.returncode != 0
    assert "periporo: rank 1 failed:" in run.stderr and "Traceback" in run.stderr
    assert "ZeroDivisionError: injected fault" in run.stderr
    assert "rank 0 failed" not in run.stderr


FAILURES = {  # folder of failing.py -> what standard error says
    "lost": "No such file or directory", "full results": "File too large", "full checkpoints": "File too large",
    "taken": "scene.vtkhdf", "refused": "reaches 0.004 m into this plane",
}  # fmt: skip


@pytest.fixture(scope="module")
def failed(launch, by_folder, tmp_path_factory, scene_of):
    """What two ranks say on standard output and error of each of the FAILURES, and the folder of the runs."""
    folder = tmp_path_factory.mktemp("failed")
    stages = [{"name": "fall", "type": "dynamics", "duration": 1e3}]  # hours, unless it is ended
    plane = {"type": "plane", "point": [0, 0.004], "normal": [0, 1], "friction": 0.5}
    often, never = {"interval": 1e-4}, {"interval": 1.0}
    scenes = {
        "lost": scene_of(stages=stages, output=often),
        "full results": scene_of(counts=(20, 10), stages=stages, output=often),
        "full checkpoints": scene_of(counts=(20, 10), stages=stages, output=never, checkpoint={"interval": 1e-3}),
        "taken": scene_of(), "refused": scene_of(contacts=[plane]),
    }  # fmt: skip
    for name, scene in scenes.items():
        (folder / name).mkdir()
        (folder / name / "scene.yaml").write_text(yaml.safe_dump(scene))
    (folder / "taken" / "scene.vtkhdf").mkdir()
    run = launch(2, "failing", "--quiet", "--overwrite", folder=folder, timeout=180)
    assert run.returncode == 2, run.stderr
    return by_folder(run.stdout), by_folder(run.stderr), folder


@pytest.mark.parametrize("name", FAILURES)
def test_what_fails_ends_all_ranks_and_is_reported_once(failed, name):
    out, error, folder = failed
    assert out[name] == "" and error[name].count(FAILURES[name]) == 1, error[name]
    assert "Traceback" not in error[name] and error[name].count("periporo: ") == 1, error[name]
    assert not list((folder / name).glob("*.partial")) and not list((folder / name).glob("*.lock"))
    if name == "refused":
        assert "scene.yaml: 1 problem\n  line" in error[name]
        assert [file.name for file in (folder / name).iterdir()] == ["scene.yaml"]
    elif name != "taken":
        assert "cannot write" in error[name]
