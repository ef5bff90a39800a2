"""What tests in several folders share: clouds of points in motion, small scenes, and the MPI launcher."""

import copy
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.correspondence.bond_projected import BondProjected
from periporo.core.motion.timestep import StableTimeStep
from periporo.core.points.extent import Extent
from periporo.core.points.particles import Particles
from periporo.core.scene.build import build
from periporo.core.simulation import Simulation
from periporo.io.input.load import parse_scene
from periporo.materials.elastic import Elastic

ELASTIC = {"model": "elastic", "density": 1760.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
SOFT = {"model": "elastic", "density": 2100.0, "bulk_modulus": 10e6, "shear_modulus": 4e6}
# Ranks and other tests share the cores: MPICH waits busily, so let it sleep; Open MPI refuses many ranks, so allow it
PATIENT = {"MPIR_CVAR_ENABLE_HEAVY_YIELD": "1", "OMPI_MCA_rmaps_base_oversubscribe": "1"}
LONGEST = ("verification/test_cases.py", "materials/test_testing.py", "mpi/test_checkpoint.py", "mpi/test_mpi.py")
CAM_CLAY = {
    "model": "cam_clay", "grain_density": 2200.0, "porosity": 0.2, "bulk_modulus": 25e6, "shear_modulus": 15e6,
    "critical_state_slope": 1.1, "compression_index": 0.12, "swelling_index": 0.04, "viscosity": 1000.0,
    "overconsolidation_ratio": 1.25,
}  # fmt: skip


def pytest_configure(config):
    """Have xdist keep the order of modules: it would begin with those of many tests, which need not be long."""
    config.option.loadscopereorder = False


def pytest_collection_modifyitems(items):
    """Long modules first, so that processes side by side end together.

    The second begins with laws while the first compiles what moves points: else both would compile the same.
    """

    def place(item):
        path = item.path.relative_to(Path(__file__).parent)
        if path.as_posix() in LONGEST:
            return LONGEST.index(path.as_posix())
        return len(LONGEST) + (path.parts[0] not in ("mpi", "verification"))

    items.sort(key=place)


def _grid(*counts, spacing=0.01, jitter=0.0, seed=3):
    """Positions (n, d) of a grid of `counts` points along each axis, each moved by up to `jitter` spacings."""
    axes = np.meshgrid(*((np.arange(n) + 0.5) * spacing for n in counts), indexing="ij")
    position = np.stack([a.ravel() for a in axes], axis=1)
    return position + jitter * spacing * np.random.default_rng(seed).uniform(-1, 1, position.shape)


def _cloud(position, *, laws=None, law_of=None, spacing=0.01, horizon=2.2, influence="cubic", velocity=None,
           group=None, fixed=None, contacts=(), loads=(), start=True,
           scheme=BondProjected):  # fmt: skip
    """A simulation on this rank alone of points at `position`, each the cell of a grid of `spacing`.

    `law_of` (n,) the number of each point's law in `laws`; `fixed` a constant time step; `scheme` its class.
    """
    n, dimension = position.shape
    laws = laws or [Elastic.example()]
    particles = Particles(dimension)
    chosen = scheme(horizon * spacing, influence)
    sim = Simulation(MPI.COMM_SELF, particles, laws, chosen, spacing=spacing, skin=0.3 * spacing,
                     time_step=StableTimeStep(0.8, fixed, 10))  # fmt: skip
    sim.forces.need("external")
    for contact in contacts:
        contact.attach(particles, sim.forces)
    owned = {f.name: np.zeros(n if f.columns is None else (n, f.columns), f.dtype) for f in particles.migrating()}
    owned |= {"id": np.arange(n), "position": position.copy(), "volume": np.full(n, spacing**dimension)}
    owned["material"] = np.zeros(n, np.int64) if law_of is None else np.asarray(law_of, np.int64)
    owned["mass"] = owned["volume"] * np.array([law.density for law in laws])[owned["material"]]
    owned["dilation"] = np.ones(n)
    owned["initial_position"] = owned["reference_position"] = position.copy()
    if velocity is not None:
        owned["velocity"] = np.array(velocity, float)
    if group is not None:
        owned["group"] = np.asarray(group, np.int64)
    particles.replace(owned, 0)
    sim.contacts, sim.loads = list(contacts), list(loads)
    sim.extent = Extent(position.min(axis=0) - 0.5 * spacing, position.max(axis=0) + 0.5 * spacing,
                        np.eye(dimension)[-1])  # fmt: skip
    if start:
        sim.start()
    return sim


def _scene(dimension=2, counts=(10, 8), *, spacing=0.01, materials=None, **keys):
    """The dictionary of a scene: a block on a rough floor under gravity that moves for 1 ms."""
    size = [n * spacing for n in counts]
    across = [-0.5 * s for s in size[:-1]], [0.5 * s for s in size[:-1]]
    down = [0.0] * (dimension - 1) + [-9.81]
    scene = {
        "dimension": dimension,
        "spacing": spacing,
        "gravity": down,
        "materials": {"soil": ELASTIC},
        "bodies": [{"name": "block", "material": "soil",
                    "shape": {"type": "box", "lower": [*across[0], 0.0], "upper": [*across[1], size[-1]]}}],
        "contacts": [{"type": "plane", "point": [0.0] * dimension, "normal": [-g for g in down], "friction": 0.5}],
        "stages": [{"name": "fall", "type": "dynamics", "duration": 1e-3}],
        "output": {"interval": 2.5e-4},
    }  # fmt: skip
    if materials == "two":
        scene["materials"] = {"soil": ELASTIC, "top": SOFT}
        scene["bodies"][0]["layers"] = [{"above": 0.5 * size[-1], "material": "top"}]
    elif materials:
        scene["materials"] = {"soil": materials}
    return copy.deepcopy(scene | keys)


@pytest.fixture(scope="session")
def grid():
    """The function that places points on a grid, see `_grid`."""
    return _grid


@pytest.fixture(scope="session")
def cloud():
    """The function that sets a cloud of points in motion, see `_cloud`."""
    return _cloud


@pytest.fixture(scope="session")
def scene_of():
    """The function that describes a small scene, see `_scene`."""
    return _scene


@pytest.fixture(scope="session")
def started():
    """The function that builds and starts the simulation of a scene's dictionary on this rank."""

    def start(scene, folder="."):
        sim = build(parse_scene(scene, folder), MPI.COMM_SELF)
        sim.start()
        return sim

    return start


@pytest.fixture(scope="session")
def cam_clay_input():
    """Input of a Cam-Clay soil."""
    return dict(CAM_CLAY)


@pytest.fixture(scope="session")
def mpirun():
    """The function that runs a Python program on a number of ranks and returns its CompletedProcess."""
    beside = Path(sys.executable).with_name("mpirun")
    launcher = str(beside) if beside.exists() else shutil.which("mpirun")
    if launcher is None:
        pytest.skip("no mpirun; install the extra 'mpi'")

    def run(ranks, *words, folder, timeout=300):
        command = [launcher, "-n", str(ranks), sys.executable, *map(str, words)]
        return subprocess.run(command, cwd=folder, env=os.environ | PATIENT, timeout=timeout,
                              stdin=subprocess.DEVNULL, capture_output=True, text=True)  # fmt: skip

    return run
