"""Time per row of the built-in laws.

    python -m benchmarks material_rows [rows]
"""

import time

import numpy as np

from periporo.core.numerics.tensors import equivalent_shear
from periporo.core.points.varied import VariedLaw
from periporo.materials.cam_clay import CamClay
from periporo.materials.drucker_prager import DruckerPrager
from periporo.materials.elastic import Elastic

from . import option_parser

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


def varied(law, count):
    """The law with another shear modulus in each row."""
    moduli = law.shear_modulus * np.linspace(0.9, 1.1, count)[:, None]
    whole = VariedLaw(law, ("shear_modulus",), lambda values: law.model_copy(update={"shear_modulus": values[0]}))
    return whole.for_rows(moduli)


def nanoseconds(material, stress, increment, state):
    """Shortest time per row of several calls."""
    best = np.inf
    for _ in range(REPEATS):
        s, q = stress.copy(), state.copy()
        start = time.perf_counter()
        material.compute_stress(s, increment, q, 2e-5)
        best = min(best, time.perf_counter() - start)
    return 1e9 * best / len(stress)


def main(words=None):
    """Print a row for each law and kind of step."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("rows", type=int, nargs="?", default=20_000, help="rows of a law")
    count = parser.parse_args(words).rows
    clay = CamClay.example()
    laws = {
        "elastic": Elastic.example(),
        "drucker_prager": DruckerPrager.example(),
        "cam_clay, eta = 0": clay.model_copy(update={"viscosity": 0.0}),
        "cam_clay, eta = 1e3": clay,
        "cam_clay, eta = 1e8": clay.model_copy(update={"viscosity": 1e8}),
    }
    for name in ("elastic", "drucker_prager", "cam_clay, eta = 1e3"):
        laws[f"{name}, varied"] = varied(laws[name], count)
    print(f"ns per row, {count} rows{'':16}4 components{'':4}6 components")
    for name, law in laws.items():
        for strain, what in ((1e-6, "small steps"), (1e-4, "large steps"), (-1e-6, "unloading")):
            times = [nanoseconds(law, *rows_in_shear(law, count, c, strain)) for c in (4, 6)]
            print(f"{name:28} {what:12} {times[0]:12.1f} {times[1]:15.1f}")
