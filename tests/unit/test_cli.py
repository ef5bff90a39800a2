"""The command line, in process: results, refusals on one screen, exit status."""

import copy
import gc
import os
import random
import re
import subprocess
import sys
from importlib import resources

import h5py
import pytest
import yaml
from mpi4py import MPI

from periporo.core import cli
from periporo.core.bonds.bonds import RefusedStep
from periporo.core.numerics import jit
from periporo.core.simulation import Simulation
from periporo.errors import SCREEN_LINES, SCREEN_WIDTH, ContactError
from periporo.io.input.examples import write_example
from periporo.io.input.load import parse_scene


@pytest.fixture
def call(call, monkeypatch):
    """As in other files, but without a word on kernels that are compiled."""
    monkeypatch.setattr(jit, "cache_is_warm", lambda: True)
    return call


@pytest.fixture
def scene(scene_of, tmp_path):
    """The function that writes a scene, with changes, to scene.yaml."""

    def write(**keys):
        (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene_of() | keys))
        return "scene.yaml"

    return write


def assert_refused(result, folder, *words, left=("scene.yaml",), width=SCREEN_WIDTH + 10):
    """One screen on standard error, after "periporo: ", that holds the words; nothing else, and no file written."""
    status, out, error = result
    assert status == 2 and out == ""
    lines = error.splitlines()
    assert 1 <= len(lines) <= SCREEN_LINES + 1 and max(map(len, lines)) <= width
    assert "Traceback" not in error
    for word in words:
        assert word in error, error
    assert sorted(p.name for p in folder.iterdir()) == sorted(left)


def test_a_scene_runs_from_its_file(call, scene, tmp_path):
    status, out, error = call(scene(), "--no-plot")
    text = out + error
    assert status == 0
    for word in ("energy ledger", "kinetic energy", "unexplained", "run-out", "height", "results: scene.vtkhdf"):
        assert word in text
    assert sorted(p.name for p in tmp_path.iterdir()) == ["scene.vtkhdf", "scene.yaml"]
    with h5py.File("scene.vtkhdf") as file:
        run = dict(file["Run"].attrs)
        assert 0.0 < run["height_m"] < run["run_out_m"] * 3.0 and run["free_flying_points"] == 0
        assert run["ranks"] == 1 and run["rebuilds"] >= 1 and run["messages"] == run["migrated_points"] == 0
        assert yaml.safe_load(run["configuration"])["spacing"] == 0.01
        assert all(name in run["versions"] for name in ("periporo", "numpy", "numba", "h5py", "mpi4py"))
        assert run["cpu"] == jit.processor()[0]
        assert run["wall_time_s"] > 0.0 and "strain" in yaml.safe_load(run["timing"])
        assert file["History/time"][-1] >= 1e-3
        assert set(file["VTKHDF/PointData"]) == {"id", "displacement", "velocity", "stress", "equivalent_shear_strain",
                                                "volumetric_strain", "material", "body"}  # fmt: skip


def test_vtk_knows_the_file_by_its_name_and_shows_obstacles_that_move(call, scene):
    """As ParaView does: by the ending, through the pipeline, at times."""
    hdf = pytest.importorskip("vtkmodules.vtkIOHDF")
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline

    plate = {"type": "box", "lower": [-0.5, 0.1], "upper": [0.5, 0.2], "velocity": [0.0, 20.0], "friction": 0.0}
    floor = {"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.5}
    assert call(scene(contacts=[floor, plate]), "--no-plot", "--quiet")[0] == 0
    reader = hdf.vtkHDFReader()
    assert reader.CanReadFile("scene.vtkhdf")
    reader.SetFileName("scene.vtkhdf")
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(Pipeline.TIME_STEPS())
    for time in (times[0], times[-1]):
        reader.UpdateTimeStep(time)
        parts = reader.GetOutputDataObject(0)
        if not hasattr(parts, "GetPartition"):
            pytest.skip("VTK up to 9.4 merges the parts")
        points, obstacles = parts.GetPartition(0), parts.GetPartition(1)
        assert points.GetNumberOfPoints() == 80 and obstacles.GetNumberOfCells() == 2
        assert obstacles.GetCell(0).GetBounds()[2:4] == (0.0, 0.0)
        assert obstacles.GetCell(1).GetBounds()[:4] == pytest.approx((-0.5, 0.5, 0.1 + 20 * time, 0.2 + 20 * time))


def test_quiet_says_nothing_about_progress(call, scene):
    status, out, error = call("run", scene(), "--no-plot", "--quiet")
    assert status == 0 and out + error == ""


def test_pictures_are_drawn_unless_told_not_to(call, scene, tmp_path):
    pytest.importorskip("matplotlib")
    status, out, error = call(scene())
    assert status == 0 and "picture: " in out + error and list(tmp_path.glob("*.png"))


def test_output_options(call, scene):
    options = {"file": "other.vtkhdf", "fields": ["density", "internal_force"], "interval": 5e-4, "history_interval": 1}
    assert call(scene(output=options), "--no-plot", "--quiet")[0] == 0
    with h5py.File("other.vtkhdf") as file:
        assert set(file["VTKHDF/PointData"]) == {"id", "density", "internal_force"}
        assert file["VTKHDF/Steps"].attrs["NSteps"] in (3, 4)
        steps = file["History/step"][:]
        assert steps.tolist() == list(range(len(steps)))


def test_existing_results_are_kept_unless_told_to_replace_them(call, scene, tmp_path):
    scene()
    (tmp_path / "scene.vtkhdf").write_bytes(b"precious")
    result = call("scene.yaml", "--quiet")
    assert_refused(result, tmp_path, "scene.vtkhdf", "--overwrite", left=("scene.vtkhdf", "scene.yaml"), width=300)
    assert (tmp_path / "scene.vtkhdf").read_bytes() == b"precious"
    assert call("scene.yaml", "--quiet", "--no-plot", "--overwrite")[0] == 0
    assert h5py.is_hdf5(tmp_path / "scene.vtkhdf")


def test_check_says_what_a_scene_will_cost_and_writes_nothing(call, scene, tmp_path):
    status, out, error = call("check", scene())
    assert status == 0 and error == ""
    for word in ("scene.yaml: valid", "points        80,", "memory", "time step", "about", "run time"):
        assert word in out
    assert [p.name for p in tmp_path.iterdir()] == ["scene.yaml"]


def test_check_tells_what_ends_the_first_steps_first(call, scene, monkeypatch):
    """A point that passes a wall within them ends a run: so the status is that of the run, and the screen is whole."""
    step = Simulation.step

    def pass_a_wall(sim):
        step(sim)
        if sim.step_number == 3:
            raise ContactError("contacts[0]: a point at (0, 0) has passed")

    monkeypatch.setattr(Simulation, "step", pass_a_wall)
    status, out, error = call("check", scene())
    assert status == 3 and error == "" and "scene.yaml: valid" in out and "run time" in out
    assert "a run ends after 3 steps: contacts[0]: a point at (0, 0) has passed" in " ".join(out.split())


def test_check_shows_its_screen_though_a_law_refuses_a_step(call, scene, monkeypatch):
    """A run would take the step back and go on with half of it."""

    def refuse(self):
        raise RefusedStep("step 0: refused by Reluctant: too much", "Reluctant: too much", [])

    monkeypatch.setattr(Simulation, "step", refuse)
    status, out, _ = call("check", scene())
    assert status == 0 and "points" in out
    assert "doubtful      a law refuses step 0 (Reluctant: too much): a run tries half of it" in out


def test_check_tells_flow_in_equilibrium_from_motion(call, scene_of, tmp_path):
    """A month of flow is no billion steps."""
    water = {"suction": 0, "drainage": "flowing", "porosity": 0.4, "conductivity": 1e-8}
    elastic = {"model": "elastic", "density": 1600.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
    keys = scene_of(materials=elastic, pore_water=water)
    keys["stages"] = [{"name": "wait", "type": "quasi_static", "duration": 2.6e6}]
    for stages, said in ((keys["stages"], "about 0 s"), ([*keys["stages"], scene_of()["stages"][0]], "motion   ")):
        (tmp_path / "scene.yaml").write_text(yaml.safe_dump(keys | {"stages": stages}))
        status, out, _ = call("check", "scene.yaml")
        assert status == 0 and "equilibrium   2.6e+06 s of flow" in out and said in out


def test_check_counts_the_memory_of_points_and_rows_and_links(call, scene_of, tmp_path):
    found = []
    for scheme in ("standard", "point_state"):  # rows of points both, and the second has a number for each pair
        keys = scene_of(counts=(60, 50), correspondence=scheme)
        (tmp_path / "scene.yaml").write_text(yaml.safe_dump(keys))
        _, out, _ = call("check", "scene.yaml")
        pairs = int(re.search("pairs ([0-9,]+),", out)[1].replace(",", ""))
        sim = Simulation.from_scene(keys, MPI.COMM_SELF)
        sim.start()
        points = sum(getattr(sim.particles, name).nbytes for name in sim.particles.fields)
        found.append(1e6 * float(re.search("memory +([0-9.]+) MB", out)[1]) - points)
    links = pairs * (8 + 1)  # stress, and whether it is active
    assert found[1] - found[0] >= 0.9 * links - 1e5  # of the rounding of both texts
    assert found[0] > pairs * (2 * 4 + 2 * 8 + 8)  # ends, ids and influence of pairs


def test_check_doubts_a_step_that_is_too_long_and_moduli_that_are_too_small(call, scene, scene_of):
    assert "doubtful" not in call("check", scene())[1]
    _, out, _ = call("check", scene(time_step={"fixed": 1e-3}))
    assert "doubtful" in out and "0.001 s is longer than the stability limit" in out
    materials = scene_of()["materials"]
    name, law = next(iter(materials.items()))
    soft = {key: value / 1e6 if key.endswith("modulus") else value for key, value in law.items()}
    _, out, _ = call("check", scene(materials={name: soft}, gravity=[0.0, -9.81]))
    assert "doubtful" in out and f"material '{name}'; are its moduli in Pa?" in out


def test_check_tells_the_angles_of_friction_and_doubts_cones_of_other_tests(call, scene, scene_of):
    soil = {"model": "drucker_prager", "density": 1700.0, "bulk_modulus": 25e6, "shear_modulus": 15e6, "cohesion": 0.0,
            "friction_angle": 30.0}  # fmt: skip
    clay = {"model": "cam_clay", "grain_density": 2650.0, "porosity": 0.4, "bulk_modulus": 25e6, "shear_modulus": 15e6,
            "critical_state_slope": 1.1, "compression_index": 0.1, "swelling_index": 0.02}  # fmt: skip
    laws = {"plain": soil, "tilted": soil | {"match": "compression"}, "clay": clay, "sand": {"model": "arena"}}
    status, out, _ = call("check", scene(materials=scene_of()["materials"] | laws))
    assert status == 0
    assert re.search(r"friction +plain: 22\.2 degrees in compression, .* 30\.0 degrees in plane strain", out)
    assert re.search(r"friction +clay: 27\.7 degrees in compression, .* 39\.4 degrees in plane strain", out)
    assert out.count("doubtful") == 3
    assert "material 'tilted': friction_angle 30 acts as 43.9 degrees in plane strain" in out
    assert "material 'clay': critical_state_slope 1.1 acts as 39.4 degrees in plane strain, 27.7" in out
    assert "material 'sand': FSLOPE 0.453 has no limit in plane strain at low pressure" in out


@pytest.mark.parametrize("word", ["run", "check"])
def test_a_missing_file(call, tmp_path, word):
    assert_refused(call(word, "nowhere.yaml"), tmp_path, "nowhere.yaml", "no such file", left=())


def test_yaml_syntax(call, tmp_path):
    (tmp_path / "scene.yaml").write_text("dimension: 2\nspacing: [1, 2\nhorizon: 3\n")
    assert_refused(call("scene.yaml"), tmp_path, "scene.yaml", "line 3")


SOIL = {"model": "elastic", "density": 1760.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}


def body(name="block", lower=(0.0, 0.0), upper=(0.1, 0.1)):
    return {"name": name, "material": "soil", "shape": {"type": "box", "lower": [*lower], "upper": [*upper]}}


BAD = {
    "unknown key": ({"horizn": 2.0}, ["horizn", "did you mean 'horizon'?"]),
    "wrong type": ({"spacing": "wide"}, ["spacing", "wide"]),
    "negative stiffness": ({"materials": {"soil": SOIL | {"bulk_modulus": -1.0}}}, ["bulk_modulus", "-1"]),
    "unknown law": ({"materials": {"soil": SOIL | {"model": "elastc"}}}, ["soil.model", "did you mean", "'elastic'"]),
    "overlap": ({"bodies": [body(), body("other", (0.05, 0.05), (0.2, 0.2))]}, ["block", "bodies[1].shape", "overlap"]),
    "empty body": ({"bodies": [body(upper=(0.0, 0.1))]}, ["bodies[0].shape.upper", "must exceed"]),
    "spacing larger than the body": ({"spacing": 1.0}, ["bodies[0].shape", "less than one spacing (1 m)"]),
    "nothing where a boundary holds": (
        {"boundaries": {"wall": {"where": {"lower": [9.0, None]}, "fix": ["x"]}},
         "stages": [{"name": "a", "type": "dynamics", "duration": 1e-3, "boundaries": ["wall"]}]}, ["wall"]),
    "unknown field": ({"output": {"fields": ["stres"]}}, ["stres", "stress"]),
    "a point alone in the air": ({"bodies": [body(lower=(0.0, 1.0), upper=(0.01, 1.01))]},
                                 ["time_step.fixed", "no point has a bond"]),
    "path out of the folder": ({"output": {"file": "../scene.vtkhdf"}}, ["../scene.vtkhdf"]),
}  # fmt: skip


@pytest.mark.parametrize("word", ["run", "check"])
@pytest.mark.parametrize("case", BAD)
def test_bad_input(call, scene, tmp_path, word, case):
    changes, words = BAD[case]
    assert_refused(call(word, scene(**changes)), tmp_path, *words)


def test_an_unwritable_output(call, scene, tmp_path):
    """A folder that cannot be made, since a file stands in its place; also for root."""
    scene(output={"file": "taken/scene.vtkhdf"})
    (tmp_path / "taken").write_text("")
    assert_refused(call("scene.yaml", "--quiet"), tmp_path, "taken", left=("scene.yaml", "taken"), width=300)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder(call, scene, tmp_path):
    scene()
    tmp_path.chmod(0o500)
    try:
        assert_refused(call("scene.yaml", "--quiet"), tmp_path, "scene.vtkhdf", width=300)
    finally:
        tmp_path.chmod(0o700)


def test_a_column_that_cannot_come_to_rest_fails_with_status_3(call, scene):
    stages = [{"name": "settle", "type": "relax", "tolerance": 1e-10, "max_steps": 5}]
    status, _, error = call(scene(stages=stages), "--quiet", "--no-plot")
    assert status == 3 and "stage 'settle'" in error and "max_steps" in error and "Traceback" not in error


def test_a_misspelt_command_is_recognised_unless_there_is_such_a_file(call, scene, tmp_path):
    status, _, error = call("plott", "run.vtkhdf")
    assert status == 2 and "did you mean 'plot'?" in error
    status, _, error = call("run.vtkhdf")
    assert status == 2 and "did you mean 'periporo plot run.vtkhdf'?" in error
    os.rename(scene(), "runn")
    assert call("runn", "--no-plot")[0] == 0


@pytest.mark.parametrize("on", [True, False])
def test_modules_are_loaded_without_the_collector_which_is_as_it_was_afterwards(on):
    was = gc.isenabled()
    try:
        (gc.enable if on else gc.disable)()
        with pytest.raises(ImportError), cli._without_collector():
            assert not gc.isenabled()
            raise ImportError
        assert gc.isenabled() == on
    finally:
        (gc.enable if was else gc.disable)()


def test_version(call):
    status, out, _ = call("--version")
    assert status == 0 and re.fullmatch(r"periporo \d+\.\d+\.\d+\n", out)


def test_a_fault_of_the_program_ends_with_its_traceback_and_status_3(call, scene, monkeypatch):
    monkeypatch.setattr(Simulation, "start", lambda self: 1 / 0)
    status, _, error = call(scene(), "--no-plot")
    assert status == 3 and "rank 0 failed" in error and "ZeroDivisionError" in error


def test_a_run_goes_on_when_nobody_reads_what_it_says(scene, tmp_path):
    command = f"{sys.executable} -m periporo.core.cli {scene()} --no-plot | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stderr == ""
    with h5py.File(tmp_path / "scene.vtkhdf") as file:
        assert file["Run"].attrs["finished"] == 1
    command = f"{sys.executable} -m periporo.core.cli check {scene()} | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stderr == ""


def test_command_line_mistakes(call):
    for words in ((), ("run",), ("scene.yaml", "--overwrit3"), ("plot",)):
        status, _, error = call(*words)
        assert status == 2 and "usage: periporo" in error
    status, out, _ = call("--help")
    assert status == 0 and all(tool in out for tool in ("run", "check", *cli.TOOLS))


@pytest.mark.parametrize("tool", ["plot", "info", "compare", "export", "report"])
def test_tools_refuse_a_file_that_is_not_there(call, tool):
    second = ["other.vtkhdf"] if tool == "compare" else []
    status, _, error = call(tool, "nowhere.vtkhdf", *second)
    assert status == 2 and error.startswith(f"periporo {tool}: ") and "nowhere.vtkhdf" in error


def test_tools_work_on_a_result(call, scene):
    assert call(scene(), "--quiet", "--no-plot")[0] == 0
    status, out, _ = call("info", "scene.vtkhdf")
    assert status == 0 and "stress" in out and "unfinished" not in out
    with h5py.File("scene.vtkhdf", "a") as file:
        del file["Run"].attrs["finished"]
    assert "unfinished" in call("info", "scene.vtkhdf")[1]
    assert call("compare", "scene.vtkhdf", "scene.vtkhdf")[0] == 0


@pytest.mark.parametrize(
    ("variable", "words"),
    [
        ("OMPI_COMM_WORLD_SIZE", ("Open MPI's mpirun as 4 processes", "mpirun that belongs to it")),
        ("PMI_SIZE", ("MPICH's mpirun as 4 processes", "mpirun that belongs to it")),
        ("SLURM_STEP_NUM_TASKS", ("srun as 4 processes", "--mpi=pmi2")),
    ],
)
def test_foreign_launcher_is_told_apart(call, scene, tmp_path, monkeypatch, variable, words):
    for name in cli.LAUNCHERS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(variable, "4")
    assert_refused(call(scene()), tmp_path, *words, width=400)


def test_one_process_may_come_from_any_launcher(call, scene, monkeypatch):
    """As below mpirun -n 1 in a step of a job that has more tasks: the innermost launcher counts."""
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "1")
    monkeypatch.setenv("SLURM_STEP_NUM_TASKS", "4")
    assert call("check", scene())[0] == 0


def test_console_script_and_module_are_the_same(tmp_path):
    script = "import sys; from periporo.core.cli import main; sys.exit(main())"
    for command in (["-m", "periporo.core.cli"], ["-c", script]):
        run = subprocess.run([sys.executable, *command, "nowhere.yaml"], cwd=tmp_path, capture_output=True, text=True,
                             timeout=120)  # fmt: skip
        assert run.returncode == 2 and "no such file" in run.stderr and run.stdout == ""


def places(value, path=()):
    """Paths of everything in a nest of mappings and lists."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for part, entry in list(items):
        yield (*path, part)
        yield from places(entry, (*path, part))


def shipped():
    folder = resources.files("periporo.configs")
    return sorted(f.name for f in folder.iterdir() if f.name.endswith(".yaml"))


class Accepted(BaseException):
    """The scene was found valid, and would now run."""


def mutated(original, draw):
    """A copy of a scene with one entry replaced, removed or renamed."""
    wrong = [None, True, -1.0, 0, 1e300, float("nan"), "text", "", [], {}, [1.0], {"a": 1}, "../x.h5", "\u202e", 10**30]
    damaged = copy.deepcopy(original)
    path = draw.choice(list(places(original)))
    parent = damaged
    for part in path[:-1]:
        parent = parent[part]
    action = draw.choice(["replace", "replace", "remove", "rename"])
    if action == "replace":
        parent[path[-1]] = draw.choice(wrong)
    elif action == "remove" or isinstance(parent, list):
        del parent[path[-1]]
    else:
        parent[str(path[-1]) + "x"] = parent.pop(path[-1])
    return damaged


@pytest.mark.parametrize("config", shipped())
def test_damaged_scenes_are_refused_or_valid_but_never_crash(call, tmp_path, monkeypatch, config):
    """A hundred mutations of each shipped scene, up to where it would start; nothing is written."""

    def stop(sim):
        raise Accepted

    monkeypatch.setattr(Simulation, "start", stop)
    original = yaml.safe_load((resources.files("periporo.configs") / config).read_text())
    write_example(config.removesuffix(".yaml"), tmp_path / "scene.yaml")  # with the files that it needs
    left = [path.name for path in tmp_path.iterdir()]
    draw, refused = random.Random(config), 0
    for _ in range(100):
        (tmp_path / "scene.yaml").write_text(yaml.safe_dump(mutated(original, draw), allow_unicode=True))
        try:
            result = call("check", "scene.yaml")
        except Accepted:
            continue
        refused += 1
        assert_refused(result, tmp_path, "problem", left=left)
        assert "pydantic" not in result[2]
    assert refused > 60


LAUNCHED = {"PMI_SIZE": "", "SLURM_STEP_NUM_TASKS": "", "OMPI_COMM_WORLD_SIZE": "none"}


def test_launchers_are_asked_only_when_ranks_matter(call, scene, monkeypatch):
    """Empty variables say nothing; an interactive shell of SLURM may have four tasks and still check a scene alone."""
    for name, value in LAUNCHED.items():
        monkeypatch.setenv(name, value)
    assert call(scene(), "--no-plot", "--quiet")[0] == 0
    monkeypatch.setenv("SLURM_STEP_NUM_TASKS", "4")
    monkeypatch.delenv("PMI_SIZE"), monkeypatch.delenv("OMPI_COMM_WORLD_SIZE")
    assert call("check", "scene.yaml")[0] == 0 and call("info", "scene.vtkhdf")[0] == 0
    status, _, error = call("scene.yaml", "--overwrite", "--quiet")
    assert status == 2 and "started by srun as 4 processes" in error and "unset SLURM_STEP_NUM_TASKS" in error


def test_a_scene_as_pyyaml_reads_it_runs(scene, tmp_path):
    """YAML 1.1 makes text of 25e6."""
    text = (tmp_path / scene()).read_text().replace("25000000.0", "25e6").replace("0.001", "1e-3")
    data = yaml.safe_load(text)
    assert data["materials"]["soil"]["bulk_modulus"] == "25e6" and data["stages"][0]["duration"] == "1e-3"
    read = parse_scene(data)
    assert read.materials["soil"].parameters["bulk_modulus"] == 25e6 and read.stages[0].duration == 1e-3


def test_a_law_of_another_package_is_not_taken_for_a_misspelt_one(call, scene):
    soil = SOIL | {"model": "barodesy"}
    _, _, error = call("check", scene(materials={"soil": soil}))
    assert "no material model of this name is installed" in error and "did you mean" not in error


@pytest.mark.parametrize("word", ["check", "run"])
def test_points_without_company_are_counted(call, scene, scene_of, word):
    """A beam one point thick falls like dust."""
    beam = {"name": "beam", "material": "soil",
            "shape": {"type": "box", "lower": [-0.2, 0.2], "upper": [0.2, 0.21]}}  # fmt: skip
    scene(bodies=[*scene_of()["bodies"], beam])
    status, out, error = call(word, "scene.yaml", *(["--no-plot"] if word == "run" else []))
    assert status == 0 and "run-out nan" not in out
    assert "40 of the 40 points of body 'beam' bear no stress" in " ".join(out.split())
    assert "'block'" not in out + error


@pytest.mark.parametrize("word", ["check", "run"])
def test_units_of_water_that_seem_to_be_others_are_told_once(call, scene, word):
    """A permeability as large as a conductivity, and rain in mm/h: said before the run, which goes on."""
    water = {"suction": 0, "drainage": "flowing", "porosity": 0.4, "bulk_modulus": 1e7, "viscosity": 1e3}
    rain = {"rain": {"where": {"body": "block"}, "water": {"rain": 20.0, "side": "y+"}}}
    scene(pore_water=water | {"permeability": 1e-5}, boundaries=rain)
    status, out, _ = call(word, "scene.yaml", *(["--no-plot"] if word == "run" else []))
    said = " ".join(out.split())
    assert status == 0
    assert said.count("doubtful pore_water: a permeability" if word == "check" else "doubtful: pore_water: a perm") == 1
    assert said.count("a rain of 20 m/s is more than ever fell") == 1


def test_a_scene_of_dust_has_no_run_out(call, scene):
    dust = {"name": "dust", "material": "soil", "shape": {"type": "box", "lower": [-0.05, 0], "upper": [0.05, 0.01]}}
    status, out, _ = call(scene(bodies=[dust]), "--no-plot")
    assert status == 0 and "run-out none" in out


def test_a_container_without_shared_memory_is_told(call, scene, monkeypatch):
    access = os.access
    monkeypatch.setattr(cli.os, "access", lambda path, mode: path != "/dev/shm" and access(path, mode))
    status, _, error = call("check", scene())
    assert status == 0 and "/dev/shm cannot be written, and MPI may not start without it" in error
