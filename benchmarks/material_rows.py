"""Time per row of the built-in laws, and over that of `drucker_prager`; of the same as a UMAT in C, if there is a cc.

    python -m benchmarks material_rows [rows]
"""

import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from periporo.core.numerics.tensors import equivalent_shear
from periporo.core.points.varied import VariedLaw
from periporo.materials.arena import Arena
from periporo.materials.cam_clay import CamClay
from periporo.materials.drucker_prager import DruckerPrager
from periporo.materials.elastic import Elastic
from periporo.materials.granular_mu_i import GranularMuI
from periporo.materials.herschel_bulkley import HerschelBulkley
from periporo.materials.hypoplastic_sand import HypoplasticSand
from periporo.materials.mohr_coulomb import MohrCoulomb
from periporo.materials.norsand import NorSand
from periporo.materials.tables import StrainTable
from periporo.materials.umat import Umat

from . import ROOT, option_parser

REPEATS = 20


def rows_in_shear(material, count, components, strain):
    """Rows at 1-100 kPa that have flowed in shear before, and increments that go on."""
    rng = np.random.default_rng(0)
    stress = np.zeros((count, components))
    stress[:, :3] = -(10 ** rng.uniform(3, 5, (count, 1)))
    state = material.initial_state(stress, np.zeros((count, 2), dtype=np.int64), np.ones(count))
    direction = rng.normal(size=(count, components))
    direction[:, :3] -= direction[:, :3].mean(axis=1, keepdims=True)
    direction /= equivalent_shear(direction)[:, None]
    for _ in range(20):
        material.compute_stress(stress, 1e-3 * direction, state, 2e-5)
    return stress, strain * direction, state


def softening():
    """Dense sand whose friction falls."""
    return MohrCoulomb.example().model_copy(
        update={"friction_angle": StrainTable(plastic_shear=(0.0, 1.0), values=(40.0, 33.0))}
    )


def varied(law, count):
    """The law with another stiffness in each row."""
    name = next(n for n in ("shear_modulus", "hardness", "G0") if hasattr(law, n))
    values = getattr(law, name) * np.linspace(0.9, 1.1, count)[:, None]
    return VariedLaw(law, (name,), lambda own: law.model_copy(update={name: own[0]})).for_rows(values)


def umat(folder: Path):
    """Drucker-Prager's law in C, called by its address."""
    law, library = DruckerPrager.example(), folder / "law.so"
    source = ROOT / "tests" / "materials" / "data" / "umat" / "drucker_prager.c"
    subprocess.run(["cc", "-shared", "-fPIC", "-O2", "-o", str(library), str(source), "-lm"], check=True)
    eta, strength, dilation = law.cone(3)
    return Umat(
        density=law.density, library=str(library), props=[law.bulk_modulus, law.shear_modulus, eta, strength, dilation],
        state_variables=1, largest_mean_stress=strength / eta,
    )  # fmt: skip


def nanoseconds(laws, count, components, strain):
    """Processor time per row of each law, the median of calls that take turns: what else runs disturbs all alike."""
    rows = {name: rows_in_shear(law, count, components, strain) for name, law in laws.items()}
    times = {name: [] for name in laws}
    for _ in range(REPEATS):
        for name, law in laws.items():
            stress, increment, state = (array.copy() for array in rows[name])
            start = time.process_time()
            law.compute_stress(stress, increment, state, 2e-5)
            times[name].append(time.process_time() - start)
    return {name: 1e9 * float(np.median(t)) / count for name, t in times.items()}


def main(words=None):
    """Print a row for each law and kind of step."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("rows", type=int, nargs="?", default=20_000, help="rows of a law")
    count = parser.parse_args(words).rows
    clay = CamClay.example()
    laws = {
        "elastic": Elastic.example(),
        "drucker_prager": DruckerPrager.example(),
        "mohr_coulomb": MohrCoulomb.example(),
        "mohr_coulomb, soft": softening(),
        "granular_mu_i": GranularMuI.example(),
        "hypoplastic_sand": HypoplasticSand.example(),
        "herschel_bulkley": HerschelBulkley.example(),
        "norsand": NorSand.example(),
        "cam_clay, eta = 0": clay.model_copy(update={"viscosity": 0.0}),
        "cam_clay, eta = 1e3": clay,
        "cam_clay, eta = 1e8": clay.model_copy(update={"viscosity": 1e8}),
    }
    laws["arena"] = Arena()
    varying = ("elastic", "drucker_prager", "mohr_coulomb", "granular_mu_i", "cam_clay, eta = 1e3", "norsand")
    for name in (*varying, "hypoplastic_sand", "arena"):
        laws[f"{name}, varied"] = varied(laws[name], count)
    with tempfile.TemporaryDirectory() as folder:
        if shutil.which("cc"):
            laws["umat in C"] = umat(Path(folder))
        _print_table(laws, count)


def _print_table(laws, count):
    for strain, what in ((1e-6, "small steps"), (1e-4, "large steps"), (-1e-6, "unloading")):
        print(f"{what:28} {'4 components':>20} {'6 components':>20}   ns per row, and over drucker_prager")
        columns = [nanoseconds(laws, count, c, strain) for c in (4, 6)]
        for name in laws:
            cells = (f"{times[name]:12.1f} {times[name] / times['drucker_prager']:7.2f}" for times in columns)
            print(f"{name:28} {' '.join(cells)}", flush=True)
