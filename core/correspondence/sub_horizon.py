"""Sub-horizon correspondence with an energy-consistent force.

Each bond ij of a point i has the state of its sub-family H_ij, the neighbours k of i with |x_k - x_j| <= horizon
(it holds j, not i; Menon & Song 2022, eqs 22-26):

    K_ij = sum_k w_ik V_k xi_ik (x) xi_ik,  L_ij = [sum_k w_ik V_k (v_k - v_i) (x) xi_ik] K_ij^-1.

The bonds share the volume of their point, a_ij = w_ij V_j / sum_b w_ib V_b, and the force is the conjugate of the
internal power sum_i V_i sum_b a_ib sigma_ib : L_ib, which sends the stress of a bond to all of its sub-family:

    T_ij = w_ij [sum_{b: j in H_ib} a_ib sigma_ib K_ib^-1] xi_ij,  f_i = sum_j (T_ij - T_ji) V_i V_j.

Then sum_j T_ij (x) xi_ij V_j = sum_b a_ib sigma_ib exactly, at surfaces too; momenta are conserved to rounding and
the elastic operator is symmetric and positive semi-definite. Where a sub-family does not span space its bond has no
state and the others take its share.
"""

import numpy as np

from periporo.core.bonds.newborn import admit_newborn
from periporo.core.bonds.rows import DirectedRows
from periporo.core.correspondence import kinematics
from periporo.core.correspondence.flux import add_flux_force, begin_flux, close_flux
from periporo.core.correspondence.influence import CLOSED, influence_table, support
from periporo.core.correspondence.moments import update_neighbourhoods
from periporo.core.correspondence.springs import add_spring
from periporo.core.numerics import algebra as la
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.ranks.pair_exchange import PairExchange

_LANES = 8  # numbers in a vector of the processor
_DEGENERATE, _REGULAR = 0.01, 0.1  # of det K / (tr K / d)^d of a sub-family
_LEAST_SHARE = 0.1  # of a point's bonds: with less the point itself fades out


class SubHorizon:
    """The scheme's two halves of a step: strain from velocity, force from stress."""

    name = "sub_horizon"
    viscosity = 0.0
    rows = DirectedRows()

    def __init__(self, horizon: float, influence_name: str):
        """`horizon` m; `influence_name` one of `influence.NAMES`."""
        self.horizon = support(influence_name, horizon)
        self.sub_horizon = horizon * CLOSED
        self.table = influence_table(influence_name)
        self._pair_exchange: PairExchange | None = None

    def deform(self, particles, bonds, halo, dt: float, material_dt: float) -> None:
        """Strain increment of every active row over the step that ends at the present positions.

        Stress and tensor-valued state are turned to the end of the step; newborn rows get their state, for
        which a material sees a step of `material_dt` s.
        """
        p, pairs = particles, bonds.pairs
        update_neighbourhoods(p, pairs, self.horizon, self.table, dt)
        for block in bonds.blocks:
            self._measure(p, pairs, block)
        self._combine_ends(p, bonds, halo)
        if halo.comm.size > 1:
            bonds.average(p, halo.boundary_rows)
            halo.update(p, *[b.average for b in bonds.blocks])
        admit_newborn(bonds, p, material_dt)
        for block in bonds.blocks:
            own = np.arange(len(block.pair), dtype=np.uint32)
            kinematics.strain_rows(
                own, block.active, block.gradient, dt, block.stress, block.strain_increment, block.state,
                block.tensor_columns, block.spin, block.peak, p.dim,
            )  # fmt: skip

    def _measure(self, p, pairs, block):
        """Gradient, shape, integrity and share of the volume of every row."""
        volume = np.empty(len(block.pair))
        _sum_sub_families(
            block.start, block.pair, block.second, pairs.weight, p.position, p.velocity, p.volume, p.share,
            self.sub_horizon, block.shape_inverse, block.gradient, block.integrity, volume, p.dim,
        )  # fmt: skip
        self._share_volume(p, pairs, block, volume)

    def _share_volume(self, p, pairs, block, sub_family_volume):
        _share_among_bonds(
            block.start, block.pair, block.second, pairs.weight, p.volume, p.share, block.integrity, block.fraction
        )

    def _combine_ends(self, p, bonds, halo):
        """What the rows of both ends of a pair make of their gradients: nothing here."""

    def regularise(self, particles, bonds, halo) -> None:
        """What the scheme does to stress once the laws have answered: nothing."""

    def rearrange(self, particles, motions, contacts) -> None:
        """Move points between steps: nothing."""

    def internal_force(self, particles, bonds, halo, force: np.ndarray, moment: np.ndarray | None = None) -> None:
        """Fill `force` (total, d) N with the internal force; rows of ghosts are incomplete.

        `moment` (owned, d^2) N m is that of loads on the points' faces, which move with the gradient of the whole
        horizon.
        """
        p, pairs = particles, bonds.pairs
        states = np.zeros((len(pairs.first), 2, p.dimension))
        for block in bonds.blocks:
            self._fill_force_states(p, pairs, block, states)
        self.exchange(p, pairs, halo, states)
        force[:] = 0.0
        _add_force(pairs.first, pairs.second, pairs.weight, p.volume, states, force, p.dim)
        if moment is not None:
            begin_flux(p, moment)
            close_flux(p)
            halo.update(p, "flux")
            add_flux_force(p, pairs, force)

    def _fill_force_states(self, p, pairs, block, states):
        _distribute_stress(
            block.start, block.pair, block.side, block.second, block.active, pairs.weight, p.position, self.sub_horizon,
            block.fraction, block.total_stress, block.shape_inverse, states, p.dim,
        )  # fmt: skip

    def exchange(self, p, pairs, halo, sides) -> None:
        """Fill the sides (pairs, 2, k) that ghost ends have to give."""
        if halo.comm.size > 1:
            if self._pair_exchange is None or not self._pair_exchange.is_for(pairs):
                self._pair_exchange = PairExchange(halo, p, pairs)
            self._pair_exchange.run(sides)

    def add_springs(self, particles, bonds, block, bulk, shear, limit: float, springs) -> None:
        """Add the stiffness of the points' bonds, with moduli (n,) Pa of the block's rows."""
        p = particles
        _sum_springs(
            block.first, block.second, block.active, block.fraction, p.position, p.volume, bulk, shear, springs, p.dim
        )


@inlined
def _neighbours(begin, end, pair, second, weight, i, position, horizon, row, xi, inside, dim):
    """Number of neighbours of point i; their rows, bonds `xi` (d, n) and who is in whose sub-family (n, n)."""
    count = 0
    for r in range(begin, end):
        if weight[pair[r]] > 0.0:
            row[count] = r
            for a in range(len(dim)):
                xi[a, count] = position[second[r], a] - position[i, a]
            count += 1
    padded = _padded(count)
    for a in range(len(dim)):
        xi[a, count:padded] = np.inf  # nobody's neighbours
    square = horizon * horizon
    for k in range(count):
        for j in range(padded):
            r2 = 0.0
            for a in range(len(dim)):
                r2 += (xi[a, k] - xi[a, j]) ** 2
            inside[k, j] = 1.0 if r2 < square else 0.0
    return count


@inlined
def _sum_inside(count, inside, terms, sums):
    """sums[c, j] = sum over k of inside[k, j] terms[c, k], in ascending k.

    Whole vectors of j and four k at a time keep the processor's vector units busy.
    """
    sums[:] = 0.0
    padded = _padded(count)
    for k in range(count, padded):
        terms[:, k] = 0.0
        inside[k, :padded] = 0.0
    for k in range(0, count, 4):
        for c in range(terms.shape[0]):
            t0, t1, t2, t3 = terms[c, k], terms[c, k + 1], terms[c, k + 2], terms[c, k + 3]
            for j in range(padded):
                s = sums[c, j] + inside[k, j] * t0
                s += inside[k + 1, j] * t1
                s += inside[k + 2, j] * t2
                sums[c, j] = s + inside[k + 3, j] * t3


@inlined
def _padded(count):
    """`count` rounded up to whole vectors."""
    return (count + _LANES - 1) // _LANES * _LANES


@inlined
def _widest(start):
    """Largest number of rows of a point, rounded up to whole vectors."""
    widest = 0
    for i in range(start.shape[0] - 1):
        widest = max(widest, start[i + 1] - start[i])
    return _padded(widest)


@inlined
def _inverse_and_regularity(k):
    """Inverse of a shape tensor, and det K / (tr K / d)^d: 1 if it is isotropic, 0 if it does not span space."""
    d = 2 if len(k) == 3 else 3
    inverse, determinant = la.inverse_shape(k)
    mean = la.trace_shape(k) / d
    return inverse, determinant / mean**d if mean > 0.0 else 0.0


@inlined
def _integrity_of(regularity):
    """beta of a sub-family, which is narrow by nature: only its shape counts."""
    if not regularity > _DEGENERATE:
        return 0.0
    return min((regularity - _DEGENERATE) / (_REGULAR - _DEGENERATE), 1.0) ** 2


@kernel
def _sum_sub_families(
    start, pair, second, weight, position, velocity, volume, share, horizon, shape_inverse, gradient, integrity,
    sub_family_volume, dim,
):  # fmt: skip
    """Inverse shape, velocity gradient, integrity and volume of the sub-family of every row."""
    d = len(dim)
    n_shape = d * (d + 1) // 2
    widest = _widest(start)
    row, xi, inside = np.empty(widest, np.int64), np.empty((d, widest)), np.empty((widest, widest))
    terms, sums = np.empty((1 + n_shape + d * d, widest)), np.empty((1 + n_shape + d * d, widest))
    column = np.empty((1, 1 + n_shape + d * d))
    integrity[:] = 0.0
    for i in range(start.shape[0] - 1):
        if share[i, 1] == 0.0:
            continue
        count = _neighbours(start[i], start[i + 1], pair, second, weight, i, position, horizon, row, xi, inside, dim)
        for k in range(count):
            j = second[row[k]]
            bond = la.difference(position, i, j, dim)
            wv = weight[pair[row[k]]] * volume[j]
            dyad = la.square(bond)
            moment = la.dyad(la.difference(velocity, i, j, dim), bond)
            terms[0, k] = volume[j]
            for c in range(n_shape):
                terms[1 + c, k] = wv * dyad[c]
            for c in range(d * d):
                terms[1 + n_shape + c, k] = wv * moment[c]
        _sum_inside(count, inside, terms, sums)
        for k in range(count):
            for c in range(sums.shape[0]):
                column[0, c] = sums[c, k]
            r = row[k]
            sub_family_volume[r] = column[0, 0]
            inverse, regularity = _inverse_and_regularity(la.shape_at(column, 0, 1, dim))
            integrity[r] = _integrity_of(regularity)
            if integrity[r] > 0.0:
                la.store(shape_inverse, r, 0, inverse)
                la.store(gradient, r, 0, la.times_shape(la.matrix_at(column, 0, 1 + n_shape, dim), inverse))


@kernel
def _share_among_bonds(start, pair, second, weight, volume, share, integrity, fraction):
    """a_ij of the bonds of each point: they sum to J times the point's integrity."""
    for i in range(start.shape[0] - 1):
        total = 0.0
        present = 0.0
        for r in range(start[i], start[i + 1]):
            part = weight[pair[r]] * volume[second[r]]
            total += part
            present += integrity[r] * part
        whole = max(present, _LEAST_SHARE * total)
        for r in range(start[i], start[i + 1]):
            part = integrity[r] * weight[pair[r]] * volume[second[r]]
            fraction[r] = share[i, 2] * part / whole if part > 0.0 else 0.0


@kernel
def _distribute_stress(
    start, pair, side, second, active, weight, position, horizon, fraction, stress, shape_inverse, states, dim
):
    """T_ij of every row, as the side of its pair."""
    d = len(dim)
    widest = _widest(start)
    row, xi, inside = np.empty(widest, np.int64), np.empty((d, widest)), np.empty((widest, widest))
    terms, sums, column = np.empty((d * d, widest)), np.empty((d * d, widest)), np.empty((1, d * d))
    for i in range(start.shape[0] - 1):
        count = _neighbours(start[i], start[i + 1], pair, second, weight, i, position, horizon, row, xi, inside, dim)
        for k in range(count):
            r = row[k]
            for c in range(d * d):
                terms[c, k] = 0.0
            if active[r]:
                s = la.scaled(la.full(la.symmetric_at(stress, r, 0, dim)), fraction[r])
                s = la.times_shape(s, la.shape_at(shape_inverse, r, 0, dim))
                for c in range(d * d):
                    terms[c, k] = s[c]
        _sum_inside(count, inside, terms, sums)
        for k in range(count):
            r = row[k]
            for c in range(d * d):
                column[0, c] = sums[c, k]
            t = la.apply(la.matrix_at(column, 0, 0, dim), la.difference(position, i, second[r], dim))
            for a in range(d):
                states[pair[r], side[r] - 1, a] = weight[pair[r]] * t[a]


@kernel
def _add_force(first, second, weight, volume, states, force, dim):
    """Add (T_ij - T_ji) V_i V_j to both ends of each pair."""
    for b in range(first.shape[0]):
        if weight[b] == 0.0:
            continue
        i, j = first[b], second[b]
        for a in range(len(dim)):
            f = (states[b, 0, a] - states[b, 1, a]) * volume[i] * volume[j]
            force[i, a] += f
            force[j, a] -= f


@kernel
def _sum_springs(first, second, active, fraction, position, volume, bulk, shear, springs, dim):
    """Springs of the points that hold the rows: the bonds of a point share twice its volume among them."""
    for r in range(first.shape[0]):
        if active[r]:
            i = first[r]
            xi = la.difference(position, i, second[r], dim)
            add_spring(springs, i, 2.0 * fraction[r] * volume[i], xi, 0.0, bulk[r], shear[r], dim)
