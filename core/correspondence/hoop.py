"""Axial symmetry: the points of a plane scene are rings about the axis x = 0, and bear hoop stress.

x is the radius r, y runs along the axis, and zz is the direction around it. The volume of a ring is 2 pi r A at the
start, with its area A in the plane; with it neighbourhoods, masses and forces are those of rings, and the schemes stay
as they are. What is added is local to a point. With its velocity v along r

    L_tt = v/r,   J = J_plane r / (r - dt v),   strain dt v / (r - dt v/2),

the last at the middle of the step that ends at r; the power S_i sigma_tt L_tt, S_i = J_i V_i beta_i, has the conjugate

    f_r = -S_i sigma_tt / r.

In a uniform stress p I the forces along bonds of a lattice add up to V p / r, since volumes grow with r, and the hoop
takes it away. On the axis a ring has no face: nothing pushes there, but the rings beside it have neighbours on one
side alone. What is left of the balance then depends on how neighbours are weighted: with V as elsewhere 0.5 V p / h on
the first ring, h being the spacing, with the area A -0.5, and 0.08 with the root of V, which is why influences are
divided by 2 pi sqrt(r_i r_j) of the start.
"""

import numpy as np

from periporo.core.numerics.jit import kernel


def follow_volume(p, dt: float) -> None:
    """Bring the change of radius over the last `dt` s into the volume ratios of the owned points."""
    _follow_volume(p.awake, dt, p.position, p.velocity, p.jacobian, p.share)


def add_strain(block, p, dt: float) -> None:
    """Add the hoop strain over `dt` s of the points with a row in `block`."""
    _add_strain(block.first, block.active, dt, p.position, p.velocity, block.strain_increment)


def add_force(block, p, force: np.ndarray) -> None:
    """Add the force of the hoop stress of the points with a row in `block` to `force` (total, d) N."""
    _add_force(block.first, block.active, block.total_stress, p.position, p.volume, p.share, force)


def add_springs(block, p, bulk, shear, springs: np.ndarray) -> None:
    """Add the stiffness of the hoops, with moduli (n,) Pa of the rows of `block`."""
    _add_springs(block.first, block.active, bulk, shear, p.position, p.volume, p.share, springs)


@kernel
def _follow_volume(owned, dt, position, velocity, jacobian, share):
    for i in range(owned):
        if share[i, 2] == 0.0:
            continue
        r = position[i, 0]
        ratio = r / (r - dt * velocity[i, 0])
        jacobian[i] *= ratio
        share[i, 0] *= ratio
        share[i, 2] *= ratio


@kernel
def _add_strain(point, active, dt, position, velocity, strain):
    for n in range(point.shape[0]):
        if active[n]:
            way = dt * velocity[point[n], 0]
            strain[n, 2] += way / (position[point[n], 0] - 0.5 * way)


@kernel
def _add_force(point, active, stress, position, volume, share, force):
    for n in range(point.shape[0]):
        if active[n]:
            i = point[n]
            force[i, 0] -= share[i, 2] * volume[i] * stress[n, 2] / position[i, 0]


@kernel
def _add_springs(point, active, bulk, shear, position, volume, share, springs):
    for n in range(point.shape[0]):
        if active[n]:
            i = point[n]
            springs[i, 0] += (bulk[n] + 4.0 / 3.0 * shear[n]) * share[i, 2] * volume[i] / position[i, 0] ** 2
