"""The columns of a driven point: strain, stress and state, and what an engineer reads of them."""

import numpy as np

from periporo.core.numerics.tensors import COMPONENTS, deviator_norm, equivalent_shear, mean
from periporo.materials.laboratory.paths import STRAIN_COLUMNS, STRESS_COLUMNS
from periporo.materials.laboratory.point import MaterialPoint

Columns = dict[str, np.ndarray]
"""Columns (m,) by name."""

STOPPABLE = (
    "axial_strain", "volumetric_strain", "shear_strain", "gamma", "p", "q", "q_over_p", "tau", "axial_stress",
    "radial_stress", "void_ratio", "pore_pressure",
)  # fmt: skip
"""Columns for engineers: compression is positive, stresses are effective, y is the axis of the specimen.

gamma and tau are those of simple shear in the x-y plane; q is von Mises' equivalent stress, negative in extension.
"""


def observed(point: MaterialPoint) -> dict[str, float]:
    """Strain, stress, state and derived state of the point as named numbers; of the water if it has some."""
    values = dict(zip(STRAIN_COLUMNS, point.strain, strict=True))
    values |= dict(zip(STRESS_COLUMNS, point.stress[0], strict=True))
    column = 0
    for field in point.material.state_fields:
        for label in field.labels(len(COMPONENTS)):
            values[f"{field.name}_{label}" if label else field.name] = point.state[0, column]
            column += 1
    if hasattr(point.material, "derived_state"):
        for name, array in point.material.derived_state(point.stress, point.state).items():
            if array.ndim == 1:
                values[name] = array[0]
            else:
                values |= {f"{name}_{c}": v for c, v in zip(COMPONENTS, array[0], strict=True)}
    if point.water is not None:
        pressure, saturation = point.water.at(np.array([point.volumetric]))
        values |= {"pore_pressure": pressure[0], "saturation": saturation[0]}
    return {name: float(value) for name, value in values.items()}


def engineering(columns: Columns, porosity: float | None = None) -> Columns:
    """The columns of `STOPPABLE` that follow from strain and stress, `void_ratio` from the `porosity` at the start."""
    strain = np.stack([columns[name] for name in STRAIN_COLUMNS], axis=1)
    stress = np.stack([columns[name] for name in STRESS_COLUMNS], axis=1)
    p, q = -mean(stress), equivalent_shear(stress)
    lateral = 0.5 * (stress[:, 0] + stress[:, 2])
    q = np.where(lateral - stress[:, 1] < -0.5 * q, -q, q)
    made = {
        "axial_strain": -strain[:, 1],
        "volumetric_strain": -3.0 * mean(strain),
        "shear_strain": np.sqrt(2.0 / 3.0) * deviator_norm(strain),
        "gamma": 2.0 * strain[:, 3],
        "p": p,
        "q": q,
        "q_over_p": np.divide(q, p, out=np.zeros_like(q), where=p != 0.0),  # 0 without stress
        "tau": stress[:, 3],
        "axial_stress": -stress[:, 1],
        "radial_stress": -lateral,
    }
    if porosity is not None and "void_ratio" not in columns:  # a law may keep it
        made["void_ratio"] = np.exp(3.0 * mean(strain)) / (1.0 - porosity) - 1.0
    return made
