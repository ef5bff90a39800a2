"""Point-state correspondence: constitutive laws at the points only, and a stabilising link along each bond.

A point has one velocity gradient and one stress, as in `periporo.core.correspondence.standard`. What its gradient
does not see of a bond's motion, the non-affine part along the bond, meets one elastic number s for each pair, a link:

    L_i = [sum w V_j (v_j - v_i) (x) xi] K_i^-1,  L = (L_i + L_j)/2,  n = xi / max(|xi|, closest)^2,
    s = r (s + E n . (v_j - v_i - L xi) dt),  E = K + 4/3 mu of both ends in series,
    c = w V_i V_j beta_i beta_j (J_i/W_i + J_j/W_j).

The force is the conjugate of the internal power sum_i S_i : L_i + sum_b c s n . (v_j - v_i - L xi) with
S_i = J_i V_i beta_i sigma_i:

    Z_i = S_i - sum_b (c/2) s xi (x) n,  B_i = Z_i K_i^-1 / V_i,  f_ij = w V_i V_j (B_i + B_j) xi + c s n.

`sharpened`: in place of L the laws see M, with which waves are of fourth order and affine motion still exact
(`periporo.core.correspondence.sharpening`). `balance`: L is tilted, for displaced points that stay neighbours
(`periporo.core.correspondence.point_tilts`).

Where a law returns an elastic trial stress by a factor r, it returns small additions across the flow by r as well, and
so does the scheme with the bond's number. Deviator and mean of the stress sigma of a point tell the factor,

    r_i = min over both of (a + b)/(a + b + c), a = |part of sigma|, c = |part of trial - sigma|, b = 1e-4 |sigma|,

and the smaller one of both ends counts; b keeps rounding out of it. It is 1 in an elastic step. What the deviator loses
counts E/(2 mu) times, so that in steady flow s tends to the shear stress times the non-affine over the affine strain
rate, whatever the bulk modulus: it follows what the soil can bear and needs no bound of its own. As 0 <= r <= 1 the
return only takes energy away. The elastic operator is symmetric and positive semi-definite, momenta are conserved to
rounding.
"""

import numpy as np

from periporo.core.bonds.rows import PointRows
from periporo.core.correspondence import point_tilts, regularity, sharpening
from periporo.core.correspondence.bond_projected import CLOSEST
from periporo.core.correspondence.flux import add_flux_force, begin_flux
from periporo.core.correspondence.links import close_flux, find_ends, find_response, let_go, strain_links
from periporo.core.correspondence.standard import Standard
from periporo.core.points.particles import Field


class LinkedPointRows(PointRows):
    """A row for each owned point, and a link for each pair."""

    linked = True

    def __init__(self, sharpened: bool, balanced: bool, regular: bool):
        self.sharpened, self.balanced, self.regular = sharpened, balanced, regular

    def fields(self, dimension: int, components: int) -> tuple[Field, ...]:
        """What links need to know of both ends, and the gradients that rows see."""
        ends = Field("link", 4, "Pa, 1, 1, m^3", migrates=False)  # E, r, V beta J/W, V beta
        flow = (
            Field("activity", None, "1", sent=False),  # running mean of 1 - r
            Field("flowed", None, "1", sent=False),  # shear strain, weighted by the activity
            Field("viscous_stress", None, "Pa", migrates=False, sent=False),  # of the flow, on top of the laws'
            Field("uneven_rate", None, "1/s", migrates=False, sent=False),  # tr L less its mean over the neighbours
            *(regularity.fields(dimension, components) if self.regular else ()),
        )
        sharp = sharpening.fields(dimension) if self.sharpened else ()
        return (ends, *flow, *sharp, *(point_tilts.fields(dimension) if self.balanced else ()))


class PointState(Standard):
    """The scheme's two halves of a step: strain from velocity, force from stress."""

    name = "point_state"

    def __init__(
        self, horizon: float, influence_name: str, *, sharpened: float = 0.0, balance: bool = False,
        regular: bool = False,
    ):  # fmt: skip
        """`horizon` m; `influence_name` one of `influence.NAMES`.

        `sharpened` is the spacing, m, of the grid on which laws see sharpened gradients, or 0: they see L. With
        `balance` gradients are tilted; points have the field `tilt` then. `regular` keeps points regular and their
        stress smooth in a flow.
        """
        super().__init__(horizon, influence_name)
        self.closest = CLOSEST * horizon
        self.sharpened = sharpened > 0.0
        self._factors = dict.fromkeys((2, 3), 0.0)
        if self.sharpened:
            self._factors = {d: sharpening.factor(d, self.horizon / sharpened, influence_name) for d in (2, 3)}
        self.balanced = balance
        self.regular = regular
        self.viscosity = regularity.VISCOSITY if regular else 0.0
        self.rows = LinkedPointRows(self.sharpened, self.balanced, regular)
        self._ends_are_known = self._stress_is_shown = False
        self._before: list = []  # stress and moduli of the blocks before their laws are asked

    def deform(self, particles, bonds, halo, dt: float, material_dt: float) -> None:
        """Strain increment of every active row over the step that ends at the present positions.

        Stress and tensor-valued state are turned to the end of the step; points that become regular get their
        state, for which a material sees a step of `material_dt` s.
        """
        self._dt, self._is_quasi_static = dt, not np.isfinite(material_dt)
        self._ends_are_known = self._stress_is_shown = False
        super().deform(particles, bonds, halo, dt, material_dt)
        self._before = [] if dt == 0.0 else [
            (None if b.keeps_all else b.stress.copy(), *b.elastic_moduli()) for b in bonds.blocks
        ]

    def row_gradient(self, p, pairs, halo) -> np.ndarray:
        """The velocity gradients that laws see, L or M, in the first d^2 columns."""
        if self.balanced:
            point_tilts.tilt_gradients(p, pairs, self._dt)
        if not self.sharpened:
            return p.gradient
        halo.update(p, "share", "gradient")
        sharpening.sharpen(p, pairs, self._factors[p.dimension])
        return p.sharp

    def seen_gradient(self, p) -> np.ndarray:
        """The velocity gradients that laws saw in the step."""
        return p.sharp if self.sharpened else p.gradient

    def internal_force(self, particles, bonds, halo, force: np.ndarray, moment: np.ndarray | None = None) -> None:
        """Fill `force` (total, d) N with the internal force; rows of ghosts are incomplete.

        `moment` (owned, d^2) N m is that of loads on the points' faces. Bonds take up the step's non-affine strain
        here, when it is known how the laws responded: once for each `deform`.
        """
        p, pairs, links = particles, bonds.pairs, bonds.links
        if not self._ends_are_known:
            self._describe_ends(p, bonds)
            p.viscous_stress[:] = 0.0
        if not (self._stress_is_shown and all(block.total is None for block in bonds.blocks)):
            if self.sharpened:
                self._show_stress(p, bonds)
            sent = ["seen" if self.sharpened else "gradient"]
            halo.update(p, *([] if self._ends_are_known else ["link"]), *sent)
        pull = links.stress[:, 0] if bonds.tries else np.empty(len(pairs.first))
        seen = p.seen if self.sharpened else np.empty((0, p.dimension**2))
        begin_flux(p, moment)
        strain_links(
            pairs.first, pairs.second, pairs.weight, p.position, p.velocity, p.gradient, p.link, seen, self.closest,
            self._dt, links.active, links.stress, pull, p.flux, p.dim,
        )  # fmt: skip
        for block in bonds.blocks:
            if self.balanced:
                point_tilts.tilt_flux(block, p)
            close_flux(
                block.first, block.active, block.total_stress, p.volume, p.share, p.shape_inverse, p.flux, p.dim
            )
        if p.awake < p.owned:
            p.flux[p.awake : p.stirred] = p.held_flux[p.awake : p.stirred]
        halo.update(p, "flux", *(("tilt_force",) if self.balanced else ()))
        p.clear(force)
        add_flux_force(p, pairs, force, pull)
        if self.balanced:
            point_tilts.add_force(p, pairs, force)
        self.add_hoop_force(p, bonds, force)
        self._dt, self._ends_are_known, self._before = 0.0, False, []  # what is taken up is not taken up again
        self._stress_is_shown = False

    def regularise(self, particles, bonds, halo) -> None:
        """Keep stress smooth where a law took a part of it away, and say where points move before the next step."""
        flowing = [block for block in bonds.blocks if block.flows]
        if not self.regular or self._dt == 0.0 or not flowing:
            return
        p = particles
        self._describe_ends(p, bonds)
        moduli = [block.elastic_moduli() for block in flowing]
        for block, (bulk, _) in zip(flowing, moduli, strict=True):
            regularity.describe(block, bulk, p, self._dt, viscous=not self._is_quasi_static)
        exchanging = [block for block in flowing if block.exchanges]
        theirs = [of_block for block, of_block in zip(flowing, moduli, strict=True) if block.exchanges]
        if exchanging or not self.sharpened:
            halo.update(p, "link", "flow", "flow_stress")
        else:  # stress stays, so that it may go with the same message
            self._show_stress(p, bonds)
            halo.update(p, "link", "flow", "seen")
            self._stress_is_shown = True
        regularity.exchange(p, bonds.pairs, exchanging, theirs, self.horizon, self.table)
        self._ends_are_known = True

    def rearrange(self, particles, motions, contacts) -> None:
        """Move points that a flow brought too close together; what `motions` prescribe stays."""
        if self.regular:
            regularity.rearrange(particles, motions, contacts)

    def add_springs(self, particles, bonds, block, bulk, shear, limit: float, springs) -> None:
        """Add the stiffness of the points' bonds, see `Standard.add_springs`: less where gradients are not sharp."""
        if self.regular and block.flows:
            if limit > 0.0:
                bulk = bulk + 2.0 / limit * regularity.viscosity(block, particles, bulk, shear)
            if self.sharpened:
                softer = sharpening.softening(particles, block.first)
                bulk, shear = bulk * softer, shear * softer
        super().add_springs(particles, bonds, block, bulk, shear, limit, springs)

    def resist(self, particles, bonds, halo, rate: float) -> None:
        """Let bulk viscosity answer to the strain of `deform` as if it had come at the `rate` (1/s), by the way.

        That is how a trial with elastic stress goes on before `internal_force`.
        """
        p = particles
        self._describe_ends(p, bonds)
        p.viscous_stress[:] = 0.0
        for block in (block for block in bonds.blocks if block.flows):
            q = self._dt * rate * regularity.viscosity(block, p, *block.elastic_moduli())
            p.viscous_stress[block.first] = q * p.uneven_rate[block.first]
        halo.update(p, "link")
        self._ends_are_known = True

    def stop_flow(self, particles, rows: np.ndarray) -> None:
        """Points in `rows` stop to flow."""
        regularity.stop(particles, rows)

    def _describe_ends(self, p, bonds):
        """Find what links need of their ends: E, r and volumes; without a step those of the present stress, and 1."""
        before = self._before or [(None, *block.elastic_moduli()) for block in bonds.blocks]
        for block, (turned, bulk, shear) in zip(bonds.blocks, before, strict=True):
            find_ends(block.first, block.active, bulk, shear, p.volume, p.share, p.link)
            if turned is not None:
                find_response(
                    block.first, block.active, bulk, shear, turned, block.strain_increment, block.stress, p.link, p.dim
                )
            if block.opening is not None:
                let_go(block.first, block.active, block.state[:, block.opening.column], p.link)

    def _show_stress(self, p, bonds):
        """Find the stress that neighbours see of each point."""
        for block in bonds.blocks:
            sharpening.show_stress(
                block.first, block.active, block.total_stress, p.viscous_stress, self._factors[p.dimension],
                p.activity, p.flowed, p.seen, p.dim,
            )  # fmt: skip
