"""Conformance kit: does a constitutive law keep the contract of `periporo.materials.Material`?

from periporo.materials import check_material
check_material(MyLaw(...), dimension=2)
check_material(MyLaw(...), dimension=3)
"""

from dataclasses import dataclass

import numpy as np

from periporo.core.numerics.tensors import component_count
from periporo.core.points.material import Material
from periporo.materials.testing import contract, response
from periporo.materials.testing.apart import check_limit, check_opening
from periporo.materials.testing.breaches import (
    CycleEnergyError,
    DeclarationError,
    FrameError,
    ModuliError,
    NonConformance,
    NonFiniteError,
    OpeningError,
    RefusalError,
    ShapeError,
    SplitError,
    ZeroIncrementError,
)
from periporo.materials.testing.rows import Rows

__all__ = [
    "CycleEnergyError", "DeclarationError", "FrameError", "ModuliError", "NonConformance", "NonFiniteError",
    "OpeningError", "RefusalError", "Report", "ShapeError", "SplitError", "ZeroIncrementError", "check_material",
]  # fmt: skip


@dataclass(frozen=True)
class Report:
    """What was measured.

    cycle_energy: work of a closed cycle of strain, of a row's K strain^2. stiffness: the largest response to a small
    strain, of that of the row's declared moduli; 1 for an elastic law. failures: updates in which rows stayed behind.
    """

    law: str
    dimension: int
    cycle_energy: float
    stiffness: float
    failures: int


def check_material(material: Material, dimension: int = 3, seed: int = 0, pressure: float = 1e4) -> Report:
    """Check `material` in plane strain (`dimension` 2) or 3D; random strains are drawn from `seed`.

    Rows start from isotropic compression up to `pressure` Pa and are strained by up to about 1 % a step.

    Returns a `Report`. Raises a subclass of `NonConformance`, which is an AssertionError, at the first breach. A law
    with the attribute `conservative = True` must also return the work of a closed cycle of strain.

    >>> from periporo.materials.elastic import Elastic
    >>> report = check_material(Elastic(density=1800, bulk_modulus=25e6, shear_modulus=15e6), dimension=2)
    >>> round(report.stiffness, 6)
    1.0
    """
    contract.check_declaration(material)
    rows = Rows(material, component_count(dimension), np.random.default_rng(seed), pressure)
    contract.check_start(rows)
    contract.check_derived(rows)
    check_limit(rows)
    contract.check_calls(rows)
    contract.check_rows_without_state(rows)
    stress, state = response.check_walk(rows)
    contract.check_zero_increment(rows, stress, state)
    contract.check_split(rows, stress, state)
    response.check_components(rows)
    response.check_frame(rows, stress, state)
    stiffness = max(response.check_moduli(rows, *start) for start in ((rows.stress, rows.state), (stress, state)))
    check_opening(rows)  # measures by the moduli, so they must be right
    return Report(rows.law, dimension, response.check_cycle(rows), stiffness, rows.failures)
