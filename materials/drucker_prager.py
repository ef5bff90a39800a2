"""Elastic, perfectly plastic Drucker-Prager soil with an exact return to cone, cut-off and their edge.

Yield f = sqrt(J2) + eta p - xi c, flow potential sqrt(J2) + eta_bar p, p positive in tension (Drucker &
Prager 1952). eta, xi and eta_bar follow from Mohr-Coulomb's c, phi and psi (de Souza Neto, Peric & Owen 2008,
section 6.4); `_plane_strain_cone` generalises their plane strain match to psi != phi. A cone can meet Mohr-Coulomb in
one kind of test only: without `match` it is plane strain in two dimensions and triaxial compression in three.
"""

import math
from functools import cached_property
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from periporo.core.numerics.elasticity import elastic_trial
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.numerics.tensors import dimension_of, filled
from periporo.core.points.material import OPENED, StateField
from periporo.materials.base import MaterialParameters, units
from periporo.materials.friction import FrictionAngles, angles_of_cone, shown

_PRESSURE, _DENSITY, _DEGREES, _NUMBER = units("Pa", "kg/m^3", "deg", "1")

DISSIPATION = StateField("dissipation", "J/m^3")
PLASTIC_DILATION = StateField("plastic_dilation", "1")
_SAME_ANGLE = 1.0  # degrees


class DruckerPrager(MaterialParameters):
    """Drucker-Prager cone fitted to Mohr-Coulomb; friction 0 is von Mises with undrained strength c.

    The mean stress is cut off at the apex of the cone, or at `tension_cutoff` if that is lower, so that a
    cone without dilation is returned from tension as well. With `largest_dilation` the dilation fades with the plastic
    volumetric strain, d eps_v = eta_bar (1 - eps_v/largest_dilation) d gamma: soil comes to its critical state.
    """

    density: float = Field(gt=0, description="dry bulk density", json_schema_extra=_DENSITY)
    bulk_modulus: float = Field(gt=0, description="bulk modulus K", json_schema_extra=_PRESSURE)
    shear_modulus: float = Field(gt=0, description="shear modulus mu", json_schema_extra=_PRESSURE)
    cohesion: float = Field(ge=0, description="cohesion c of Mohr-Coulomb", json_schema_extra=_PRESSURE)
    friction_angle: float = Field(
        ge=0, lt=90, description="angle of friction phi of Mohr-Coulomb", json_schema_extra=_DEGREES
    )
    dilation_angle: float = Field(
        0.0, ge=0, lt=90, description="angle of dilation psi", json_schema_extra=_DEGREES
    )
    largest_dilation: float | None = Field(
        None, gt=0, le=1, description="plastic volumetric strain at which dilation has faded", json_schema_extra=_NUMBER
    )
    match: Literal["plane_strain", "compression", "extension", "inscribed"] | None = Field(
        None, description="where the cone meets Mohr-Coulomb; by default in plane strain (2D) or compression (3D)"
    )
    tension_cutoff: float | None = Field(
        None, ge=0, description="largest mean stress", json_schema_extra=_PRESSURE
    )
    report_dissipation: bool = Field(False, description="keep the plastic work of the last step in the state")

    exchanges_stress: ClassVar[bool] = True  # stress is all that it remembers

    @property
    def dilatancy(self) -> float:
        """Plastic volumetric strain over plastic shear strain, about: tan(psi)."""
        return math.tan(math.radians(self.dilation_angle))

    @model_validator(mode="after")
    def _possible_strength(self):
        if self.cohesion == 0 and self.friction_angle == 0:
            raise ValueError("cohesion and friction_angle are both 0: the material would have no strength")
        if self.dilation_angle > self.friction_angle:
            raise ValueError(
                f"dilation_angle ({self.dilation_angle:g}) must not exceed friction_angle "
                f"({self.friction_angle:g}): flow would create energy"
            )
        return self

    @classmethod
    def example(cls) -> Self:
        """A dense sand with a little cohesion."""
        return cls(
            density=1700.0,
            bulk_modulus=25e6,
            shear_modulus=15e6,
            cohesion=1e3,
            friction_angle=35.0,
            dilation_angle=5.0,
        )

    @property
    def state_fields(self) -> tuple[StateField, ...]:
        """`dissipation` if it is reported, `plastic_dilation` if that has an end, and `opened`."""
        reported = (DISSIPATION,) if self.report_dissipation else ()
        return (*reported, *((PLASTIC_DILATION,) if self._fades else ()), OPENED)

    @property
    def _fades(self) -> bool:
        return self.largest_dilation is not None and self.dilation_angle > 0

    def cone(self, dimension: int) -> tuple[float, float, float]:
        """eta, xi c in Pa and eta_bar of the yield function and the flow potential in a space of `dimension`."""
        return self._cones[dimension]

    @cached_property
    def _cones(self) -> dict[int, tuple[float, float, float]]:
        return {dimension: self._cone_in(dimension) for dimension in (2, 3)}

    def _cone_in(self, dimension: int) -> tuple[float, float, float]:
        phi, psi = math.radians(self.friction_angle), math.radians(self.dilation_angle)
        match self.match or ("plane_strain" if dimension == 2 else "compression"):
            case "compression":
                (eta, xi), (flow, _) = _edge_cone(phi, 1.0), _edge_cone(psi, 1.0)
            case "extension":
                (eta, xi), (flow, _) = _edge_cone(phi, -1.0), _edge_cone(psi, -1.0)
            case "inscribed":
                flow = _plane_dilation(psi)
                eta, xi = _plane_strain_cone(phi, _plane_dilation(phi))
            case "plane_strain":
                flow = _plane_dilation(psi)
                eta, xi = _plane_strain_cone(phi, flow)
        return eta, xi * self.cohesion, flow

    def weakened(self, factor: float) -> Self:
        """The law with cohesion, tan(friction_angle), tan(dilation_angle) and cut-off divided by `factor`."""
        angles = {
            name: math.degrees(math.atan(math.tan(math.radians(getattr(self, name))) / factor))
            for name in ("friction_angle", "dilation_angle")
        }
        cutoff = None if self.tension_cutoff is None else self.tension_cutoff / factor
        return self.model_copy(update={"cohesion": self.cohesion / factor, "tension_cutoff": cutoff, **angles})

    def largest_mean_stress(self, dimension: int) -> float:
        """Mean stress in Pa at the cut-off or the apex, whichever is lower; infinite for von Mises."""
        eta, strength, _ = self.cone(dimension)
        apex = strength / eta if eta > 0 else math.inf
        return apex if self.tension_cutoff is None else min(apex, self.tension_cutoff)

    def friction_angles(self, dimension: int) -> FrictionAngles:
        """The angles that the cone has in each kind of test."""
        eta, _, flow = self.cone(dimension)
        return angles_of_cone(eta, flow)

    def doubts(self, stress, state) -> dict[str, str]:
        """What looks wrong about the parameters in the dimension of the rows, by subject."""
        dimension = dimension_of(stress)
        angles = self.friction_angles(dimension)
        acting, where = (angles.plane_strain, "plane strain") if dimension == 2 else (angles.compression, "compression")
        doubts = {}
        if acting is None or abs(acting - self.friction_angle) > _SAME_ANGLE:
            doubts["friction"] = (
                f"friction_angle {self.friction_angle:g} acts as {shown(acting)} in {where} because of match: "
                f"{self.match}; leave match out, or choose the angle for it"
            )
        if self.dilation_angle > 0 and self.largest_dilation is None:
            doubts["dilation"] = (
                f"dilation_angle {self.dilation_angle:g} has no end: soil that flows grows without bound; give "
                "largest_dilation, the plastic volumetric strain after which it keeps its volume (0.05 to 0.2 in sand)"
            )
        return doubts

    def initial_state(self, stress, ids, volume):
        """Closed, nothing dissipated, not dilated: zeros."""
        return np.zeros((len(stress), len(self.state_fields)))

    def compute_stress(self, stress, strain_increment, state, dt):
        """Advance `stress` (n, 4|6) Pa by `strain_increment` in place; `dt` plays no part."""
        numbers = self._numbers(dimension_of(stress))
        _advance(*numbers, stress, strain_increment, state, self.report_dissipation, self._dilation_column)

    def _numbers(self, dimension: int) -> tuple[float, ...]:
        """What the return needs to know of the parameters: see `_advance`."""
        eta, strength, dilation = self.cone(dimension)
        limit = self.largest_mean_stress(dimension)
        edge = max(strength - eta * limit, 0.0) if math.isfinite(limit) else strength
        end = self.largest_dilation or 0.0
        return self.bulk_modulus, self.shear_modulus, eta, strength, dilation, end, limit, edge

    @property
    def _dilation_column(self) -> int:
        return int(self.report_dissipation) if self._fades else -1

    @classmethod
    def of_rows(cls, laws, components):
        """What answers for rows of which each has one of the `laws`."""
        return _DruckerPragerRows(laws, components)

    def tension_limit(self, stress, state):
        """Largest mean stress (n,) Pa of the rows, beyond which they open."""
        return filled(len(stress), self.largest_mean_stress(dimension_of(stress)))

    def elastic_moduli(self, stress, state):
        """Constant moduli, two (n,) arrays in Pa."""
        n = len(stress)
        return filled(n, self.bulk_modulus), filled(n, self.shear_modulus)

    def yield_surface(self, stress_row, state_row):
        """Points (p, q) in Pa of the meridian from the largest mean stress to beyond the given stress."""
        dimension = dimension_of(stress_row)
        eta, strength, _ = self.cone(dimension)
        p_now = float(np.mean(stress_row[:3]))
        high = self.largest_mean_stress(dimension)
        high = high if math.isfinite(high) else max(0.0, p_now)
        p = np.array([high, high, min(1.5 * p_now, -abs(high), -strength)])
        q = math.sqrt(3.0) * (strength - eta * p)
        q[0] = 0.0
        return p, q


class _DruckerPragerRows:
    """Rows with a law each; columns are those of `DruckerPrager._numbers`."""

    def __init__(self, laws, components):
        dimension = 2 if components == 4 else 3
        self._numbers = np.array([law._numbers(dimension) for law in laws])
        self._columns = laws[0].report_dissipation, laws[0]._dilation_column

    def compute_stress(self, stress, strain_increment, state, dt):
        _advance_each(self._numbers, stress, strain_increment, state, *self._columns)

    def tension_limit(self, stress, state):
        return self._numbers[:, 6].copy()

    def elastic_moduli(self, stress, state):
        return self._numbers[:, 0].copy(), self._numbers[:, 1].copy()


def _plane_dilation(psi: float) -> float:
    """eta_bar that gives the angle of dilation psi in plane strain."""
    return math.sqrt(3.0) * math.sin(psi) / math.sqrt(3.0 + math.sin(psi) ** 2)


def _edge_cone(phi: float, sign: float) -> tuple[float, float]:
    """eta, xi of the cone through the compression (sign 1) or extension (-1) edges of Mohr-Coulomb."""
    factor = 6.0 / (math.sqrt(3.0) * (3.0 - sign * math.sin(phi)))
    return factor * math.sin(phi), factor * math.cos(phi)


def _plane_strain_cone(phi: float, dilation: float) -> tuple[float, float]:
    """eta, xi that fail as Mohr-Coulomb does in plane strain, for flow with eta_bar = `dilation`.

    Plastic strain out of plane vanishes at failure, s_zz = -2/3 eta_bar sqrt(J2). The radius of Mohr's circle
    is then R = sqrt(J2) sqrt(1 - eta_bar^2/3), its centre p + eta_bar sqrt(J2)/3, and R = c cos(phi) - centre
    sin(phi) gives both. With psi = phi this is the textbook's 3 tan(phi)/sqrt(9 + 12 tan(phi)^2), which is
    also the inscribed cone.
    """
    divisor = math.sqrt(1.0 - dilation**2 / 3.0) + dilation * math.sin(phi) / 3.0
    return math.sin(phi) / divisor, math.cos(phi) / divisor


@inlined
def _fading_flow(excess, shear, stiffness, dilation, end, dilated):
    """Plastic shear and volumetric strain of soil that has `dilated` and dilates up to `end`; `stiffness` is K eta.

    Along the return the volume follows d v = eta_bar (1 - v/end) d gamma, exactly. What is left to find is the root of
    a convex, falling function of the shear: Newton's method from 0 comes to it from one side.
    """
    left = max(end - dilated, 0.0)
    flow = growth = 0.0
    for _ in range(50):
        growth = -left * math.expm1(-dilation * flow / end)
        rate = dilation * (left - growth) / end
        step = (excess - shear * flow - stiffness * growth) / (shear + stiffness * rate)
        flow += step
        if abs(step) <= 1e-8 * flow:
            return flow, growth + rate * step
    return flow, growth


@kernel
def _advance(
    bulk, shear, eta, strength, dilation, end, limit, edge, stress, strain_increment, state, reports, column
):  # fmt: skip
    _return_rows(
        bulk, shear, eta, strength, dilation, end, limit, edge, stress, strain_increment, state, reports, column
    )  # fmt: skip


@inlined
def _return_rows(
    bulk, shear, eta, strength, dilation, end, limit, edge, stress, strain_increment, state, reports, column
):  # fmt: skip
    """Hooke's law and return; `limit` is the largest mean stress, `edge` sqrt(J2) of the cone there.

    Dilation fades up to the plastic volumetric strain `end` in the state column `column`, never if that is -1.
    """
    components = stress.shape[1]
    for b in range(stress.shape[0]):
        p_trial, j2 = elastic_trial(bulk, shear, 0.5, b, stress, strain_increment)
        root = math.sqrt(j2)
        if reports:
            state[b, 0] = 0.0
        excess = root + eta * p_trial - strength
        if not (excess > 0.0 or p_trial > limit):
            continue

        flow = max(excess, 0.0) / (shear + bulk * eta * dilation)
        growth = dilation * flow
        if column >= 0 and excess > 0.0:
            flow, growth = _fading_flow(excess, shear, bulk * eta, dilation, end, state[b, column])
        p, new_root = p_trial - bulk * growth, root - shear * flow
        if p > limit:
            p, new_root = limit, min(root, edge)
        elif column >= 0:
            state[b, column] += growth
        scale = new_root / root if root > 0.0 else 0.0
        for k in range(3):
            stress[b, k] = p + scale * (stress[b, k] - p_trial)
        for k in range(3, components):
            stress[b, k] *= scale
        if reports:
            state[b, 0] = p * (p_trial - p) / bulk + new_root * (root - new_root) / shear


@kernel
def _advance_each(numbers, stress, strain_increment, state, reports, column):
    """`_advance` where rows have `numbers` (n, 8) of their own."""
    for b in range(stress.shape[0]):
        n, row = numbers[b], slice(b, b + 1)
        _return_rows(
            n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], stress[row], strain_increment[row], state[row], reports,
            column,
        )  # fmt: skip
