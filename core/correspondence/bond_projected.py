"""Bond-projected correspondence: a constitutive law on every bond.

A bond sees the mean of its two points' velocity gradients, corrected so that it maps the bond onto its own
relative velocity (Behzadinasab, Trask & Bazilevs 2021):

    K_i = sum w V_j xi (x) xi,  L_i = [sum w V_j (v_j - v_i) (x) xi] K_i^-1,  n = xi / max(|xi|, closest)^2,
    L = (L_i + L_j)/2,  L_ij = L + (v_j - v_i - L xi) (x) n.

The force is the conjugate of the internal power sum c_ij sigma_ij : L_ij,
c_ij = w V_i V_j (beta_j beta_i) (J_i/W_i + J_j/W_j), W_i = sum w V_j, where V are the initial volumes and J V the
present ones, with Z_i = sum_b (c_b/2) (sigma_b - (sigma_b xi) (x) n):

    t_ij = c_ij sigma_ij n + w V_i V_j (B_i + B_j) xi,  B_i = Z_i K_i^-1 / V_i.

With `dilatation` = "points" a bond expands at the rate of its points alone, tr L_ij = tr L: only the deviator of the
correction is added, and in the products with xi sigma is replaced by s = sigma - tr(sigma)/d I. Bonds that each keep
their own volume leave a body less freedom than plastic flow at constant volume needs; points leave enough.

With `balance` the direction n is tilted to n + a_j - a_i: see `periporo.core.correspondence.balance`.

beta is 1 in a regular neighbourhood and falls to 0, with its width, where the neighbours do not span space any
more: such a point flies freely. Momenta are conserved to rounding, the elastic operator is symmetric and positive
semi-definite. Points closer than `closest` are a lump, which no lattice has: there the correction counts less, or its
stiffness, which grows like 1/|xi|^2, would set the time step of the whole scene.
"""

import numpy as np

from periporo.core.bonds.newborn import admit_newborn
from periporo.core.bonds.rows import BOTH, FIRST, PairRows
from periporo.core.correspondence import kinematics
from periporo.core.correspondence.flux import add_flux_force, begin_flux, close_flux
from periporo.core.correspondence.influence import influence_table, support
from periporo.core.correspondence.moments import update_neighbourhoods
from periporo.core.correspondence.springs import add_spring
from periporo.core.numerics import algebra as la
from periporo.core.numerics import vectors
from periporo.core.numerics.algebra import LANES
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.points.faces import turn
from periporo.core.ranks.reductions import any_rank

CLOSEST = 0.27  # of the horizon: with m = 2.2 what points that are a fifth of a spacing out of place keep, 0.6


@inlined
def direction(xi, closest):
    """n = xi / max(|xi|, closest)^2."""
    return la.scaled(xi, 1.0 / max(la.dot(xi, xi), closest * closest))


@inlined
def row_volume(side, wvv, share, i, j):
    """Volume c that a row stands for; `wvv` = w V_i V_j."""
    if side == BOTH:
        return wvv * (share[i, 0] * share[j, 1] + share[j, 0] * share[i, 1])
    if side == FIRST:
        return wvv * share[i, 0] * share[j, 1]
    return wvv * share[j, 0] * share[i, 1]


class BondProjected:
    """The scheme's two halves of a step: strain from velocity, force from stress."""

    name = "bond_projected"
    viscosity = 0.0
    rows = PairRows()

    def __init__(self, horizon: float, influence_name: str, dilatation: str = "bond", balance: bool = False):
        """`horizon` m; `influence_name` one of `influence.NAMES`; `dilatation` of a bond: its own or its "points".

        With `balance` the directions of bonds are tilted; points have the field `tilt` then.
        """
        self.horizon = support(influence_name, horizon)
        self.closest = CLOSEST * horizon
        self.table = influence_table(influence_name)
        self.taken = 1.0 if dilatation == "points" else 0.0  # of the spherical part of a bond's correction
        self.balanced = balance
        self._degenerate = 0  # points without a regular neighbourhood in the last step

    def deform(self, particles, bonds, halo, dt: float, material_dt: float) -> None:
        """Strain increment of every active row over the step that ends at the present positions.

        Stress and tensor-valued state are turned to the end of the step; newborn rows get their state, for
        which a material sees a step of `material_dt` s.
        """
        p, pairs = particles, bonds.pairs
        crossed, degenerate = update_neighbourhoods(p, pairs, self.horizon, self.table, dt)
        self._exchange(p, bonds, halo, crossed or degenerate or self._degenerate)
        if self.balanced:
            turn(p.tilt, p.gradient, dt)
        degenerate += int((p.share[p.owned :, 1] == 0.0).sum())
        if crossed or degenerate or self._degenerate:  # otherwise every row is as active as it was
            admit_newborn(bonds, p, material_dt)
        self._degenerate = degenerate
        for block in bonds.blocks:
            _strain_rows(
                block.pair, block.active, pairs.first, pairs.second, p.position, p.velocity, p.gradient, self.closest,
                dt, block.stress, block.strain_increment, block.state, block.tensor_columns, block.spin, block.peak,
                self.taken, self._tilt(p), p.dim,
            )  # fmt: skip

    def _tilt(self, p):
        """Tilts of the points, none without balance."""
        return p.tilt if self.balanced else np.zeros((0, p.dimension))

    def _exchange(self, p, bonds, halo, changed):
        """Tell the ghosts; of the averages only where a row may be newborn, since bonds have `changed` somewhere."""
        if halo.alone:
            return
        averages = []
        if any_rank(halo.comm, bool(changed)):
            bonds.average(p, halo.boundary_rows)
            averages = [b.average for b in bonds.blocks]
        halo.update(p, "share", "shape_inverse", "gradient", *averages)

    def regularise(self, particles, bonds, halo) -> None:
        """What the scheme does to stress once the laws have answered: nothing."""

    def rearrange(self, particles, motions, contacts) -> None:
        """Move points between steps: nothing."""

    def internal_force(self, particles, bonds, halo, force: np.ndarray, moment: np.ndarray | None = None) -> None:
        """Fill `force` (total, d) N with the internal force; rows of ghosts are incomplete.

        `moment` (owned, d^2) N m is that of loads on the points' faces.
        """
        p, pairs = particles, bonds.pairs
        begin_flux(p, moment)
        force[:] = 0.0
        for block in bonds.blocks:
            _add_own_force(
                block.pair, block.side, block.active, pairs.first, pairs.second, pairs.weight, p.position, p.volume,
                p.share, block.total_stress, self.closest, self.taken, self._tilt(p), p.flux, force,
                p.dim,
            )  # fmt: skip
        close_flux(p)
        halo.update(p, "flux")
        add_flux_force(p, pairs, force)

    def add_springs(self, particles, bonds, block, bulk, shear, limit: float, springs) -> None:
        """Add the stiffness of the points' bonds, with moduli (n,) Pa of the block's rows."""
        p, pairs = particles, bonds.pairs
        _sum_springs(
            block.pair, block.side, block.active, pairs.first, pairs.second, pairs.weight, p.position, p.volume,
            p.share, self.closest, bulk, shear, springs, p.dim,
        )  # fmt: skip


@kernel
def _strain_rows(
    pair, active, first, second, position, velocity, gradient, closest, dt, stress, strain_increment, state, tensors,
    spins, peak, taken, tilt, dim,
):  # fmt: skip
    tilted = tilt.shape[0] > 0
    tile, rows, used = kinematics.new_tile(dim), np.zeros(LANES, np.int64), 0
    extra = kinematics.extra_quantity(dim)
    for r in range(pair.shape[0]):
        if active[r]:
            i, j = first[pair[r]], second[pair[r]]
            kinematics.load_lane(tile, rows, used, r, la.mean_matrix(gradient, i, j, dim), stress, dim)
            la.to_lane(tile, extra, used, la.difference(position, i, j, dim))
            la.to_lane(tile, extra + len(dim), used, la.difference(velocity, i, j, dim))
            if tilted:
                la.to_lane(tile, extra + 2 * len(dim), used, la.difference(tilt, j, i, dim))
            used += 1
        else:
            la.store(strain_increment, r, 0, la.zero_symmetric(dim))
        if used == LANES or r == pair.shape[0] - 1:
            _correct_tile(tile, extra, closest, taken, tilted, dim)
            kinematics.turn_tile(tile, rows, used, dt, stress, strain_increment, state, tensors, spins, peak, dim)
            used = 0


@inlined
def _correct_tile(tile, extra, closest, taken, tilted, dim):
    """Mean gradients L become the bonds' own, L + (dv - L xi) (x) n, less `taken` of its spherical part."""
    for k in range(LANES):
        mean = la.from_lane(tile, 0, k, la.zero_matrix(dim))
        xi = la.from_lane(tile, extra, k, la.zero_vector(dim))
        dv = la.from_lane(tile, extra + len(dim), k, la.zero_vector(dim))
        residual = la.minus(dv, la.apply(mean, xi))
        n = direction(xi, closest)
        if tilted:
            n = la.minus(n, la.from_lane(tile, extra + 2 * len(dim), k, la.zero_vector(dim)))
        own = la.plus_dyad(mean, residual, n)
        la.to_lane(tile, 0, k, la.plus_spherical(own, -taken / len(dim) * la.dot(residual, n)))


@kernel
def _add_own_force(
    pair, side, active, first, second, weight, position, volume, share, stress, closest, taken, tilt, flux, force,
    dim,
):  # fmt: skip
    """Add the bond's own part c sigma n of t_ij to both ends, and (c/2)(sigma - (sigma n) (x) xi) to Z of both."""
    last, own_force, own_flux = -1, vectors.zero(dim), vectors.zero(la.zero_matrix(dim))
    for r in range(pair.shape[0]):
        if not active[r]:
            continue
        b = pair[r]
        i, j = first[b], second[b]
        xi = vectors.difference(position, i, j, dim)
        n = xi * (1.0 / max(vectors.dot(xi, xi), closest * closest))
        if tilt.shape[0] > 0:
            n += vectors.difference(tilt, i, j, dim)
        sigma = vectors.full(vectors.row(stress, r, la.zero_symmetric(dim)))
        c = row_volume(side[r], weight[b] * volume[i] * volume[j], share, i, j)
        along = vectors.apply(sigma, n) - n * (taken / len(dim) * vectors.trace(sigma))
        z = (sigma - vectors.dyad(along, xi)) * (0.5 * c)
        along = along * c
        _, own_force = vectors.add_to_ends(force, i, j, along, along * -1.0, last, own_force)
        last, own_flux = vectors.add_to_ends(flux, i, j, z, z, last, own_flux)


@kernel
def _sum_springs(
    pair, side, active, first, second, weight, position, volume, share, closest, bulk, shear, springs, dim
):
    for r in range(pair.shape[0]):
        if not active[r]:
            continue
        b = pair[r]
        i, j = first[b], second[b]
        xi = la.difference(position, i, j, dim)
        c = row_volume(side[r], weight[b] * volume[i] * volume[j], share, i, j)
        add_spring(springs, i, c, xi, closest, bulk[r], shear[r], dim)
        add_spring(springs, j, c, xi, closest, bulk[r], shear[r], dim)
