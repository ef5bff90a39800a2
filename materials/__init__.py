"""Constitutive laws, and all that the author of one needs: this address does not move, whatever lies behind it.

A law is a `Material` with `StateField`s, and may raise `StepRefused` or `UpdatesFailed`; `MaterialParameters` gives
its parameters bounds, units and error messages; `COMPONENTS`, `INDEX_PAIRS`, `component_count`, `dimension_of`,
`to_matrix` and `from_matrix` are the order of tensor components; `kernel` and `inlined` compile loops over rows;
`check_material` is the conformance kit; `drive` takes one point along a path that `built_in_path`, `read_path` or
`read_test` makes. Importing the package costs nothing: names are loaded when they are asked for.
"""

from typing import TYPE_CHECKING

from periporo.lazy import offer

if TYPE_CHECKING:
    from periporo.core.numerics.jit import inlined, kernel
    from periporo.core.numerics.tensors import (
        COMPONENTS,
        INDEX_PAIRS,
        component_count,
        dimension_of,
        from_matrix,
        to_matrix,
    )
    from periporo.core.points.material import (
        BONDING,
        DEFORMATION_GRADIENT,
        OPENED,
        PLACE,
        ROTATION,
        TIME,
        Material,
        StateField,
        StepRefused,
        UpdatesFailed,
        state_columns,
    )
    from periporo.materials.base import MaterialParameters
    from periporo.materials.friction import FrictionAngles
    from periporo.materials.laboratory.drive import DriveStopped, drive
    from periporo.materials.laboratory.paths import built_in_path, read_path
    from periporo.materials.laboratory.phases import read_test
    from periporo.materials.testing import NonConformance, check_material
else:
    __getattr__, __dir__ = offer(__name__, {
        "periporo.core.numerics.jit": ("inlined", "kernel"),
        "periporo.core.numerics.tensors": (
            "COMPONENTS", "INDEX_PAIRS", "component_count", "dimension_of", "from_matrix", "to_matrix",
        ),
        "periporo.core.points.material": (
            "BONDING", "DEFORMATION_GRADIENT", "OPENED", "PLACE", "ROTATION", "TIME", "Material", "StateField",
            "StepRefused", "UpdatesFailed", "state_columns",
        ),
        "periporo.materials.base": ("MaterialParameters",),
        "periporo.materials.friction": ("FrictionAngles",),
        "periporo.materials.laboratory.drive": ("DriveStopped", "drive"),
        "periporo.materials.laboratory.paths": ("built_in_path", "read_path"),
        "periporo.materials.laboratory.phases": ("read_test",),
        "periporo.materials.testing": ("NonConformance", "check_material"),
    })  # fmt: skip

__all__ = [
    "BONDING", "COMPONENTS", "DEFORMATION_GRADIENT", "DriveStopped", "FrictionAngles", "INDEX_PAIRS", "Material",
    "MaterialParameters", "NonConformance", "OPENED", "PLACE", "ROTATION", "StateField", "StepRefused", "TIME",
    "UpdatesFailed", "built_in_path", "check_material", "component_count", "dimension_of", "drive", "from_matrix",
    "inlined", "kernel", "read_path", "read_test", "state_columns", "to_matrix",
]  # fmt: skip
