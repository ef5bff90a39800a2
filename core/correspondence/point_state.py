"""Point-state correspondence: constitutive laws at the points only, and a stabilising link along each bond.

A point has one velocity gradient and one stress, as in `periporo.core.correspondence.standard`. What its gradient
does not see of a bond's motion, the non-affine part along the bond, meets one elastic number s for each pair, a link:

    L_i = [sum w V_j (v_j - v_i) (x) xi] K_i^-1,  L = (L_i + L_j)/2,  n = xi / max(|xi|, closest)^2,
    s = r (s + E n . (v_j - v_i - L xi) dt),  E = K + 4/3 mu of both ends in series,
    c = w V_i V_j beta_i beta_j (J_i/W_i + J_j/W_j).

The force is the conjugate of the internal power sum_i S_i : L_i + sum_b c s n . (v_j - v_i - L xi) with
S_i = J_i V_i beta_i sigma_i:

    Z_i = S_i - sum_b (c/2) s xi (x) n,  B_i = Z_i K_i^-1 / V_i,  f_ij = w V_i V_j (B_i + B_j) xi + c s n.

`sharpened`: of a wave exp(ikx) the gradient sees the part 1 - a k^2, and its mean over the neighbours 1 - b k^2 of
that. With g = a/b, which the moments of the neighbourhood tell, the laws see M in place of L, and the conjugate is

    M_i = (1 + g_i) L_i - g_i sum_j w V_j beta_j L_j / N_i,  N_i = sum_j w V_j beta_j,
    g_i = d/(d + 2) (sum w V_j) (sum w V_j |xi|^4) / (sum w V_j |xi|^2)^2,
    Z_i = (1 + g_i) S_i - sum_j w V_i beta_i g_j S_j / N_j - sum_b (c/2) s xi (x) n.

Affine motion is still seen exactly, and the error of waves is of fourth order.

Where a law returns an elastic trial stress by a factor r, it returns small additions across the flow by r as well, and
so does the scheme with the bond's number. Deviator and mean of the stress sigma of a point tell the factor,

    r_i = min over both of (a + b)/(a + b + c), a = |part of sigma|, c = |part of trial - sigma|, b = 1e-4 |sigma|,

and the smaller one of both ends counts; b keeps rounding out of it. It is 1 in an elastic step. In steady flow s tends
to E/(2 mu) times the shear stress times the non-affine over the affine strain rate: it follows what the soil can bear
and needs no bound of its own. As 0 <= r <= 1 the return only takes energy away. The elastic operator is symmetric and
positive semi-definite, momenta are conserved to rounding.
"""

import numpy as np

from periporo.core import algebra as la
from periporo.core.correspondence.bond_projected import CLOSEST, direction, row_volume
from periporo.core.correspondence.standard import Standard
from periporo.core.jit import inlined, kernel
from periporo.core.particles import Field
from periporo.core.rows import BOTH, PointRows

_LEAST = 1e-4  # of the stress: a smaller deviator, or mean, counts as that


class LinkedPointRows(PointRows):
    """A row for each owned point, and a link for each pair."""

    linked = True

    def fields(self, dimension: int, components: int) -> tuple[Field, ...]:
        """What links need to know of both ends, and the gradients that rows see."""
        return (
            Field("response", 2, "Pa, 1", migrates=False),  # stiffness E, and part r of the trial stress that was kept
            Field("spread_stress", components, "N m^-2, N/m^2", migrates=False),  # g S / N
            Field("sharp", dimension**2 + 2, "1/s, m^3, 1", migrates=False),  # M, N, g
        )


class PointState(Standard):
    """The scheme's two halves of a step: strain from velocity, force from stress."""

    name = "point_state"
    rows = LinkedPointRows()

    def __init__(self, horizon: float, influence_name: str, *, sharpened: bool = False):
        """`horizon` m; `influence_name` one of `influence.NAMES`; `sharpened`: the gradient that laws see."""
        super().__init__(horizon, influence_name)
        self.closest = CLOSEST * horizon
        self.sharpened = sharpened

    def deform(self, particles, bonds, halo, dt: float, material_dt: float) -> None:
        """Strain increment of every active row over the step that ends at the present positions.

        Stress and tensor-valued state are turned to the end of the step; points that become regular get their
        state, for which a material sees a step of `material_dt` s.
        """
        super().deform(particles, bonds, halo, dt, material_dt)
        self._dt = dt
        self._before = [(block.stress.copy(), *block.elastic_moduli()) for block in bonds.blocks]

    def row_gradient(self, p, pairs, halo) -> np.ndarray:
        """The velocity gradients that laws see: L, or M (points, d^2 + 2) with N and g in the last columns."""
        if not self.sharpened:
            return p.gradient
        halo.update(p, "share", "gradient")
        _sum_gradients(
            pairs.first, pairs.second, pairs.weight, p.position, p.volume, p.share, p.gradient, p.sharp, p.dim
        )
        _sharpen(p.owned, p.volume, p.sums, p.gradient, p.sharp, p.dim)
        return p.sharp

    def internal_force(self, particles, bonds, halo, force: np.ndarray) -> None:
        """Fill `force` (total, d) N with the internal force; rows of ghosts are incomplete.

        Bonds take up the step's non-affine strain here, when it is known how the laws responded: once for each
        `deform`.
        """
        p, pairs, links = particles, bonds.pairs, bonds.links
        p.response[:], p.spread_stress[:] = 0.0, 0.0
        for block, (turned, bulk, shear) in zip(bonds.blocks, self._before, strict=True):
            _find_response(
                block.first, block.active, bulk, shear, turned, block.strain_increment, block.stress, p.response, p.dim
            )
            _spread_stress(block.first, block.active, block.total_stress, p.volume, p.share, p.sharp, p.spread_stress)
        halo.update(p, "response", *(("spread_stress",) if self.sharpened else ("share", "gradient")))
        _strain_links(
            pairs.first, pairs.second, pairs.weight, p.position, p.velocity, p.volume, p.share, p.gradient, p.response,
            p.spread_stress, self.sharpened, self.closest, self._dt, links.active, links.stress, p.flux, p.dim,
        )  # fmt: skip
        for block in bonds.blocks:
            _close_flux(
                block.first, block.active, block.total_stress, p.volume, p.share, p.sharp, p.shape_inverse, p.flux,
                p.dim,
            )  # fmt: skip
        halo.update(p, "flux")
        force[:] = 0.0
        _add_force(
            pairs.first, pairs.second, pairs.weight, p.position, p.volume, p.share, self.closest, p.flux, links.stress,
            force, p.dim,
        )  # fmt: skip


@inlined
def _lengths(s):
    """Lengths of the deviator and of the mean part of a symmetric tensor (4|6)."""
    mean = (s[0] + s[1] + s[2]) / 3.0
    square = (s[0] - mean) ** 2 + (s[1] - mean) ** 2 + (s[2] - mean) ** 2
    for c in range(3, len(s)):
        square += 2.0 * s[c] ** 2
    return np.sqrt(square), np.sqrt(3.0) * abs(mean)


@inlined
def _kept_share(kept, lost):
    return kept / (kept + lost) if kept + lost != 0.0 else 1.0


@kernel
def _find_response(point, active, bulk, shear, turned, strain, stress, response, dim):
    """Stiffness E of the points' bonds, and the part r of the trial stress that the laws kept.

    `turned` is the stress before the laws were asked, and becomes what they took away.
    """
    for n in range(point.shape[0]):
        if not active[n]:
            continue
        volumetric = (bulk[n] - 2.0 / 3.0 * shear[n]) * (strain[n, 0] + strain[n, 1] + strain[n, 2])
        for c in range(stress.shape[1]):
            turned[n, c] += 2.0 * shear[n] * strain[n, c] + (volumetric if c < 3 else 0.0)
            turned[n, c] -= stress[n, c]
        deviator, mean = _lengths(la.symmetric_at(stress, n, 0, dim))
        lost_deviator, lost_mean = _lengths(la.symmetric_at(turned, n, 0, dim))
        least = _LEAST * np.sqrt(deviator**2 + mean**2)
        response[point[n], 0] = bulk[n] + 4.0 / 3.0 * shear[n]
        response[point[n], 1] = min(_kept_share(deviator + least, lost_deviator), _kept_share(mean + least, lost_mean))


@kernel
def _sum_gradients(first, second, weight, position, volume, share, gradient, sharp, dim):
    """Sums of w V beta L, w V beta and w V |xi|^4 over the neighbours of each point."""
    sharp[:] = 0.0
    n = len(dim) * len(dim)
    for b in range(first.shape[0]):
        if weight[b] == 0.0:
            continue
        i, j = first[b], second[b]
        xi = la.difference(position, i, j, dim)
        r2 = la.dot(xi, xi)
        wi = weight[b] * volume[j]
        wj = weight[b] * volume[i]
        la.add(sharp, i, 0, la.matrix_at(gradient, j, 0, dim), wi * share[j, 1])
        la.add(sharp, j, 0, la.matrix_at(gradient, i, 0, dim), wj * share[i, 1])
        sharp[i, n] += wi * share[j, 1]
        sharp[j, n] += wj * share[i, 1]
        sharp[i, n + 1] += wi * r2 * r2
        sharp[j, n + 1] += wj * r2 * r2


@kernel
def _sharpen(owned, volume, sums, gradient, sharp, dim):
    """M, N and g of the owned points."""
    d = len(dim)
    n = d * d
    for i in range(owned):
        total = sharp[i, n]
        g = 0.0
        if total > 0.0:
            square = la.trace_shape(la.shape_at(sums, i, 1, dim))  # sums are times the point's volume
            g = d / (d + 2.0) * sums[i, 0] * volume[i] * sharp[i, n + 1] / square**2
            for c in range(n):
                sharp[i, c] /= total
        for c in range(n):
            sharp[i, c] = (1.0 + g) * gradient[i, c] - g * sharp[i, c]
        sharp[i, n + 1] = g


@kernel
def _spread_stress(point, active, stress, volume, share, sharp, spread_stress):
    """g S / N of the points with a row here."""
    n = sharp.shape[1] - 2
    for r in range(point.shape[0]):
        i = point[r]
        if active[r] and sharp[i, n] > 0.0:
            factor = volume[i] * share[i, 2] * sharp[i, n + 1] / sharp[i, n]
            for c in range(stress.shape[1]):
                spread_stress[i, c] = factor * stress[r, c]


@kernel
def _strain_links(
    first, second, weight, position, velocity, volume, share, gradient, response, spread_stress, sharpened, closest,
    dt, active, stress, flux, dim,
):  # fmt: skip
    """New s of every pair; what neighbours and links give to Z of both ends, in `flux`."""
    flux[:] = 0.0
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        w = weight[b]
        c = row_volume(BOTH, w * volume[i] * volume[j], share, i, j)
        active[b] = c != 0.0
        if c == 0.0:
            stress[b, 0] = 0.0
            continue
        xi = la.difference(position, i, j, dim)
        dv = la.difference(velocity, i, j, dim)
        mean = la.mean_matrix(gradient, i, j, dim)
        residual = la.minus(dv, la.apply(mean, xi))
        residual = la.minus(residual, la.scaled(la.apply(mean, residual), -0.5 * dt))  # from the start of the step
        middle = la.minus(xi, la.scaled(dv, 0.5 * dt))  # to its middle
        rate = la.dot(direction(middle, closest), residual)
        e = 2.0 * response[i, 0] * response[j, 0] / (response[i, 0] + response[j, 0])
        s = min(response[i, 1], response[j, 1]) * (stress[b, 0] + e * dt * rate)
        stress[b, 0] = s
        part = -0.5 * c * s
        dyad = la.dyad(xi, direction(xi, closest))
        la.add(flux, i, 0, dyad, part)
        la.add(flux, j, 0, dyad, part)
        if sharpened:
            la.add(flux, i, 0, la.full(la.symmetric_at(spread_stress, j, 0, dim)), -w * volume[i] * share[i, 1])
            la.add(flux, j, 0, la.full(la.symmetric_at(spread_stress, i, 0, dim)), -w * volume[j] * share[j, 1])


@kernel
def _close_flux(point, active, stress, volume, share, sharp, shape_inverse, flux, dim):
    """B_i of the points with a row here."""
    n = len(dim) * len(dim)
    for r in range(point.shape[0]):
        if active[r]:
            i = point[r]
            own = (1.0 + sharp[i, n + 1]) * share[i, 2] * volume[i]
            la.add(flux, i, 0, la.full(la.symmetric_at(stress, r, 0, dim)), own)
            z = la.scaled(la.matrix_at(flux, i, 0, dim), 1.0 / volume[i])
            la.store(flux, i, 0, la.times_shape(z, la.shape_at(shape_inverse, i, 0, dim)))


@kernel
def _add_force(first, second, weight, position, volume, share, closest, flux, stress, force, dim):
    """Add f_ij to both ends of each pair."""
    for b in range(first.shape[0]):
        if weight[b] == 0.0:
            continue
        i, j = first[b], second[b]
        xi = la.difference(position, i, j, dim)
        wvv = weight[b] * volume[i] * volume[j]
        along = row_volume(BOTH, wvv, share, i, j) * stress[b, 0]
        n = direction(xi, closest)
        t = la.apply(la.mean_matrix(flux, i, j, dim), xi)
        for a in range(len(dim)):
            f = 2.0 * wvv * t[a] + along * n[a]
            force[i, a] += f
            force[j, a] -= f
