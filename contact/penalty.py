"""Forces of a penalty contact on the faces of cells: see `periporo.contact.rigid`. For all points near an obstacle."""

import numpy as np

from periporo.contact.entry import elastic_force
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.points.faces import add_face_force, face_velocity

SOON = 1.5
"""Reaches within which a point counts as one that may touch soon."""
_OFF = 0.2  # reaches off the surface, beyond which a cell has the whole reach again, or what there is room for
_WHOLE = 1.4  # reaches up to which the lever is the distance from the surface; it is 0 at 2


@inlined
def _set_lever(gap, normal, k, reach, integrity, lever):
    """Fill `lever` (d,) m with the way from a point to its face."""
    whole = (2.0 - gap[k] / reach) / (2.0 - _WHOLE)
    length = integrity * max(gap[k], 0.0) * min(max(whole, 0.0), 1.0)
    for a in range(lever.shape[0]):
        lever[a] = -length * normal[k, a]


@inlined
def _of_ring(stiffness, width, i):
    """Stiffness of a point: as much more as the ring is wide that it stands for."""
    return stiffness * width[i] if width.shape[0] > 0 else stiffness


@kernel
def resist_faces(rows, gap, normal, velocity, gradient, share, reach, stiffness, width, sticks, force, moment, dim):
    """Add to forces and moments what linear springs on the faces hold, along the surface too if it `sticks`."""
    d = len(dim)
    lever, face, load = np.zeros(d), np.zeros(d), np.zeros(d)
    for k in range(rows.shape[0]):
        i = rows[k]
        _set_lever(gap, normal, k, reach, share[i, 1], lever)
        face_velocity(velocity, gradient, i, lever, face)
        approach = 0.0
        for a in range(d):
            approach += face[a] * normal[k, a]
        for a in range(d):
            load[a] = -_of_ring(stiffness, width, i) * (face[a] if sticks else approach * normal[k, a])
        add_face_force(force, moment, i, load, lever)


@kernel
def are_at(rows, x, position):
    """Whether the points in `rows` are still at the places `x` (rows, d)."""
    for k in range(rows.shape[0]):
        for a in range(x.shape[1]):
            if x[k, a] != position[rows[k], a]:
                return False
    return True


@kernel
def guide_points(rows, gap, normal, reach, cell, room, part, way, lift, dim):
    """What leads points along the normal goes from `way` to `lift`, see `periporo.contact.rigid.RigidContact.guide`."""
    for k in range(rows.shape[0]):
        i = rows[k]
        if i >= part.shape[0] or not part[i] > 0.0:
            continue  # it sleeps, or does not flow
        along = 0.0
        for a in range(len(dim)):
            along += way[i, a] * normal[k, a]
        if not gap[k] + min(along, 0.0) - reach < max(cell[i, 0], cell[i, 1]):
            continue  # it is not held, nor would be
        up = max(along, min(room[i] - gap[k], 0.0)) + part[i] * max(room[i] - gap[k], 0.0)
        for a in range(len(dim)):
            way[i, a] -= along * normal[k, a]
            lift[i, a] += up * normal[k, a]
        cell[i, 1] += up


@kernel
def add_contact_force(
    rows, gap, normal, velocity, gradient, share, obstacle, mass, dt, reach, plane_stiffness, width, friction, damping,
    spring, cell, contact, contact_moment, shear, shear_moment, dim,
):  # fmt: skip
    """Add the force of an obstacle on the points in `rows`, whose gaps and normals (rows, d) are given.

    Moves cells and stick springs; velocities are those of the middle of a step of `dt` s. `obstacle` (rows, d) m/s,
    `friction` (rows,), or (1,) for all.
    """
    d = len(dim)
    lever, face, load = np.zeros(d), np.zeros(d), np.zeros(d)
    for k in range(rows.shape[0]):
        i = rows[k]
        stiffness = _of_ring(plane_stiffness, width, i)
        off, own, approach = gap[k] - reach - max(cell[i, 0], cell[i, 1]), 0.0, 0.0
        for a in range(d):
            own += (velocity[i, a] - obstacle[k, a]) * normal[k, a]
        gained = dt * (cell[i, 2] - own) if cell[i, 2] != 0.0 else 0.0  # way to the surface of all but this contact
        cell[i, 2] = own if gap[k] < SOON * reach else 0.0
        if off >= max(dt * own, 0.0):  # neither now nor at the start of the step
            if off > _OFF * reach:
                cell[i, 0] = cell[i, 1] = min(gap[k] - (1.0 + _OFF) * reach, 0.0)
            for a in range(d):
                spring[i, a] = 0.0
            continue
        _set_lever(gap, normal, k, reach, share[i, 1], lever)
        face_velocity(velocity, gradient, i, lever, face)
        for a in range(d):
            face[a] -= obstacle[k, a]
            approach += face[a] * normal[k, a]
        cell[i, 1] += dt * (own - approach)
        overlap = reach + cell[i, 1] - gap[k]
        way = -dt * approach
        gained = min(max(gained, -abs(way)), abs(way))
        elastic = elastic_force(stiffness, overlap, way, dt * dt / mass[i], gained)
        for a in range(d):
            load[a] = elastic * normal[k, a]
        if elastic != 0.0:
            add_face_force(contact, contact_moment, i, load, lever)
            cell[i, 2] += dt * elastic / mass[i]
        if overlap <= 0.0:
            for a in range(d):
                spring[i, a] = 0.0
            continue
        viscous = 2.0 * damping * np.sqrt(stiffness * mass[i])
        pressure = elastic - viscous * own
        if pressure < 0.0:
            pressure = 0.0
        size = 0.0
        along = 0.0
        for a in range(d):
            spring[i, a] += dt * (face[a] - approach * normal[k, a])
            along += spring[i, a] * normal[k, a]
        for a in range(d):
            spring[i, a] -= along * normal[k, a]  # the surface may have turned under the face
            size += spring[i, a] ** 2
        size = np.sqrt(size)
        limit = friction[min(k, friction.shape[0] - 1)] * pressure / stiffness
        scale = limit / size if size > limit else 1.0
        for a in range(d):
            spring[i, a] *= scale
            shear[i, a] += (pressure - elastic) * normal[k, a]
            load[a] = -stiffness * spring[i, a]
        add_face_force(shear, shear_moment, i, load, lever)
