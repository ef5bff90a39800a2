"""What a constitutive law must offer.

A law advances any number of rows in place. A row is a bond or a point: the law cannot tell. Rows are
independent of each other. Sign: tension positive. Tensor components stand in the order of
`periporo.core.numerics.tensors`: (n, 4) in plane strain, (n, 6) in three dimensions; a law serves both.
"""

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np

from periporo.core.numerics.tensors import COMPONENTS, MATRIX, VECTOR
from periporo.errors import InputError, Problem

_LABELS = {"scalar": ("",), "vector": VECTOR, "matrix": MATRIX}


@dataclass(frozen=True)
class StateField:
    """A named column, or a tensor's columns, of a law's state.

    `kind` "tensor" takes 4 or 6 columns, which the program rotates with the material like the stress; "vector" takes 3
    and "matrix" 9, row by row, in any dimension, which it does not turn.
    `merge` says how a newborn bond is initialised from its two points, and how points average their bonds:
    "mean", or "log_mean" (the sign times the exponential of the mean of ln|value|; for quantities that
    span decades and keep their sign, such as a preconsolidation pressure).
    """

    name: str
    unit: str
    kind: Literal["scalar", "tensor", "vector", "matrix"] = "scalar"
    merge: Literal["mean", "log_mean"] = "mean"

    def labels(self, components: int) -> tuple[str, ...]:
        """The axes that each column counts along, "xy" or "" for none, if a tensor has `components` components."""
        return COMPONENTS[:components] if self.kind == "tensor" else _LABELS[self.kind]

    def columns(self, components: int) -> int:
        """Columns that this field takes when a tensor has `components` stored components."""
        return len(self.labels(components))


BONDING = StateField("bonding", "1")
"""State column of a law whose grains water bonds: the bonding variable xi, which the pore water writes."""

OPENED = StateField("opened", "1")
"""State column of a law with an apex: the volumetric strain by which a row has come apart (`core.points.opening`).

It starts at 0. The program closes it, and opens it by what the law's `tension_limit` leaves out; then the law leaves it
alone. A law without that method adds to it what it expands beyond its apex."""

TIME = StateField("time", "s")
"""State column of a law that asks for the time at the end of the step, of the scene's clock."""

PLACE = StateField("place", "m", kind="vector")
"""State columns of a law that asks where its row is: x, y, z; z is 0 in the plane."""

ROTATION = StateField("rotation", "1", kind="matrix")
"""State columns of a law that asks by what rotation Q its stress was turned in the step."""

DEFORMATION_GRADIENT = StateField("deformation_gradient", "1", kind="matrix")
"""State columns of a law that asks for F at the end of the step, since the row came into being, or the rows before it
whose mean it began with."""


class StepRefused(Exception):
    """Raised by `compute_stress`: the law cannot follow this step in the `rows` (indices into the call's rows).

    The program takes the step back, restores stress and state of all rows, and tries again with half the time step;
    after some tries it ends the run with the place and the `reason`. Arrays may be left in any state. Rows without
    strain increment must not be refused.
    """

    def __init__(self, rows, reason: str = "it cannot follow the strain of the step"):
        self.rows = np.atleast_1d(np.asarray(rows, dtype=np.int64))
        self.reason = reason
        super().__init__(f"{len(self.rows)} rows refuse the step: {reason}")


class UpdatesFailed(Exception):
    """Raised by `compute_stress` when it is done: all rows are advanced but these `rows`, which stay as they were.

    The program counts them, tells so at the end of the run, and goes on. `drive` ends there.
    """

    def __init__(self, rows, reason: str = "the update failed"):
        self.rows = np.atleast_1d(np.asarray(rows, dtype=np.int64))
        self.reason = reason
        super().__init__(f"{len(self.rows)} rows stay as they were: {reason}")


@runtime_checkable
class Material(Protocol):
    """A constitutive law; see `docs/how-to/own_material.md` for how to write one."""

    @property
    def density(self) -> float:
        """Mass per bulk volume at the start, kg/m^3; of the dry material unless the law owns its pore fluid."""

    @property
    def state_fields(self) -> tuple[StateField, ...]:
        """The state's columns in order; empty for a law without memory besides stress."""

    def initial_state(self, stress: np.ndarray, ids: np.ndarray, volume: np.ndarray) -> np.ndarray:
        """State (n, k) of rows that start at `stress` (n, 4|6) Pa.

        `ids` (n, 2) int64 are the global ids of the bond's ends (equal for a point), the only permitted
        source of random numbers; `volume` (n,) m^3 is the mean volume of the two ends (of the point itself), per
        metre of thickness in plane strain: the size of the specimen that the row is.

        Raises ValueError, with the reason, where no state suits the stress: a run does not begin then.
        """

    def compute_stress(
        self, stress: np.ndarray, strain_increment: np.ndarray, state: np.ndarray, dt: float
    ) -> None:
        """Advance `stress` (n, 4|6) Pa and `state` (n, k) in place by `strain_increment` over `dt` s.

        Stress, tensor state and strain increment are rotated to the end of the step already. `dt` is
        infinite in quasi-static relaxation: a viscous law then returns its inviscid limit.

        Rows without state may stand among the others, all numbers of which are 0: bonds beyond the horizon. What
        becomes of them does not count, but it must be finite. A row that has just come into being, with the mean
        stress and state of its two points, is passed once with a strain increment of 0: make its stress and state
        consistent then.

        Raises StepRefused where the law cannot follow the step, UpdatesFailed where rows stay behind.
        """

    def elastic_moduli(self, stress: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bulk and shear modulus of unloading, two (n,) arrays in Pa; finite in rows without state, too.

        They set the time step, the stiffness of contacts and of the links of `point_state`, and the speed of waves
        that the watchdog knows. A law that answers stiffer makes steps unstable.
        """


def derived_fields(material: Material) -> tuple[StateField, ...]:
    """What the law's `derived_state` gives besides the state, if it says so."""
    return getattr(material, "derived_fields", ())


def state_column(material: Material, name: str, components: int) -> int | None:
    """First column of the state field `name` of `material`, None if it has no such field."""
    start = 0
    for field in material.state_fields:
        if field.name == name:
            return start
        start += field.columns(components)
    return None


def state_columns(material: Material, components: int) -> int:
    """Width k of the state array of `material` when a tensor has `components` stored components."""
    return sum(f.columns(components) for f in material.state_fields)


def moduli_without_stress(material) -> tuple[float, float]:
    """Bulk and shear modulus of a material that bears no stress, Pa. Raises InputError where it has no state."""
    stress = np.zeros((1, 6))
    try:
        state = material.initial_state(stress, np.zeros((1, 2), np.int64), np.ones(1))
    except ValueError as error:
        problem = Problem(("materials",), f"no start for {type(material).__name__}: {error}")
        raise InputError("scene", [problem]) from None
    bulk, shear = material.elastic_moduli(stress, state)
    return float(bulk[0]), float(shear[0])
