"""Standard correspondence (Silling et al. 2007): the unstabilised reference, Menon & Song 2022, eqs 5-14.

A point has one velocity gradient and one stress,

    K_i = sum w V_j xi (x) xi,  L_i = [sum w V_j (v_j - v_i) (x) xi] K_i^-1,
    T_ij = beta_i w sigma_i K_i^-1 xi,  f_i = sum_j (T_ij - T_ji) V_i V_j,

the force being the conjugate of the internal power sum beta_i V_i sigma_i : L_i. The elastic operator is
symmetric and positive semi-definite, but many motions that are not rigid cost no energy: they show as
oscillations. beta fades degenerate neighbourhoods out (`periporo.core.correspondence.moments`).
"""

import numpy as np

from periporo.core.bonds.newborn import admit_newborn
from periporo.core.bonds.rows import PointRows
from periporo.core.correspondence import hoop, kinematics
from periporo.core.correspondence.flux import add_flux_force, begin_flux, close_flux
from periporo.core.correspondence.influence import influence_table, support
from periporo.core.correspondence.moments import update_neighbourhoods
from periporo.core.numerics import algebra as la
from periporo.core.numerics import vectors
from periporo.core.numerics.jit import kernel


class Standard:
    """The scheme's two halves of a step: strain from velocity, force from stress."""

    name = "standard"
    viscosity = 0.0
    rows = PointRows()
    axisymmetric = False
    """Whether points are rings (`periporo.core.correspondence.hoop`)."""

    def __init__(self, horizon: float, influence_name: str):
        """`horizon` m; `influence_name` one of `influence.NAMES`."""
        self.horizon = support(influence_name, horizon)
        self.table = influence_table(influence_name)

    def deform(self, particles, bonds, halo, dt: float, material_dt: float) -> None:
        """Strain increment of every active row over the step that ends at the present positions.

        Stress and tensor-valued state are turned to the end of the step; points that become regular get their
        state, for which a material sees a step of `material_dt` s.
        """
        p, pairs = particles, bonds.pairs
        _, degenerate = update_neighbourhoods(p, pairs, self.horizon, self.table, dt)
        if self.axisymmetric:
            hoop.follow_volume(p, dt)
        gradient = self.row_gradient(p, pairs, halo)
        if degenerate or not all(block.active.all() for block in bonds.blocks):  # otherwise all rows stay active
            admit_newborn(bonds, p, material_dt)
        for block in bonds.blocks:
            kinematics.strain_rows(
                block.first, block.active, gradient, dt, block.stress, block.strain_increment, block.state,
                block.tensor_columns, block.spin, block.peak, p.dim,
            )  # fmt: skip
            if self.axisymmetric:
                hoop.add_strain(block, p, dt)

    def row_gradient(self, p, pairs, halo) -> np.ndarray:
        """The velocity gradients (points, at least d^2) that the rows of owned points see."""
        return p.gradient

    def seen_gradient(self, p) -> np.ndarray:
        """What `row_gradient` returned for the step."""
        return p.gradient

    def regularise(self, particles, bonds, halo) -> None:
        """What the scheme does to stress once the laws have answered: nothing."""

    def rearrange(self, particles, motions, contacts) -> None:
        """Move points between steps: nothing."""

    def internal_force(self, particles, bonds, halo, force: np.ndarray, moment: np.ndarray | None = None) -> None:
        """Fill `force` (total, d) N with the internal force; rows of ghosts are incomplete.

        `moment` (owned, d^2) N m is that of loads on the points' faces.
        """
        p = particles
        begin_flux(p, moment)
        for block in bonds.blocks:
            _add_stress(block.first, block.active, block.total_stress, p.volume, p.share, p.flux, p.dim)
        close_flux(p)
        halo.update(p, "flux")
        force[:] = 0.0
        add_flux_force(p, bonds.pairs, force)
        self.add_hoop_force(p, bonds, force)

    def add_hoop_force(self, p, bonds, force: np.ndarray) -> None:
        """Add the force of the hoop stress, where points are rings."""
        for block in bonds.blocks if self.axisymmetric else ():
            hoop.add_force(block, p, force)

    def add_springs(self, particles, bonds, block, bulk, shear, limit: float, springs) -> None:
        """Add the stiffness of the points' bonds, with moduli (n,) Pa of the block's rows.

        A scheme's viscosity is stiffness to steps of up to `limit` s, if that is not 0.
        """
        p, pairs = particles, bonds.pairs
        sums = np.zeros_like(springs)
        _sum_springs(pairs.first, pairs.second, pairs.weight, p.position, p.volume, sums, p.dim)
        _add_springs(block.first, block.active, p.share, bulk, shear, sums, springs, p.dim)
        if self.axisymmetric:
            hoop.add_springs(block, p, bulk, shear, springs)


@kernel
def _add_stress(point, active, stress, volume, share, flux, dim):
    """Add J_i beta_i V_i sigma_i of the points with a row here."""
    for r in range(point.shape[0]):
        if active[r]:
            i = point[r]
            sigma = la.full(la.symmetric_at(stress, r, 0, dim))
            for c in range(len(sigma)):
                flux[i, c] += share[i, 2] * volume[i] * sigma[c]


@kernel
def _sum_springs(first, second, weight, position, volume, sums, dim):
    """Sum of 4 w V_i V_j/r^2 n (x) n over the bonds of each point, which share twice its volume among them."""
    last, own = -1, vectors.zero(la.shape_at(sums, 0, 0, dim))
    for b in range(first.shape[0]):
        if weight[b] == 0.0:
            continue
        i, j = first[b], second[b]
        xi = vectors.difference(position, i, j, dim)
        r2 = vectors.dot(xi, xi)
        term = vectors.square(xi) * (4.0 * weight[b] * volume[i] * volume[j] / (r2 * r2))
        last, own = vectors.add_to_ends(sums, i, j, term, term, last, own)


@kernel
def _add_springs(point, active, share, bulk, shear, sums, springs, dim):
    """Add mu tr(s) I + (K + mu/3) s of the sums s, with the share of each point that has a row here."""
    d = len(dim)
    for r in range(point.shape[0]):
        if not active[r]:
            continue
        i = point[r]
        trace = la.trace_shape(la.shape_at(sums, i, 0, dim))
        for c in range(springs.shape[1]):
            value = (bulk[r] + shear[r] / 3.0) * sums[i, c] + (shear[r] * trace if c < d else 0.0)
            springs[i, c] += share[i, 0] * value
