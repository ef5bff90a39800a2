"""Bonds taken as springs, for the local estimate of the highest frequency (`periporo.core.motion.timestep`)."""

from periporo.core.numerics import algebra as la
from periporo.core.numerics.jit import inlined


@inlined
def add_spring(springs, i, volume, xi, closest, bulk, shear, dim):
    """Add 2 c/r^2 [mu I + (K + mu/3) n n] of a bond xi that stands for a volume c to the stiffness of point i.

    n is the unit vector along the bond, r its length or at least `closest`.
    """
    r2 = la.dot(xi, xi)
    c = 2.0 * volume / max(r2, closest * closest)
    dyad = la.square(xi)
    for k in range(len(dyad)):
        value = c * (bulk + shear / 3.0) / r2 * dyad[k]
        if k < len(dim):
            value += c * shear
        springs[i, k] += value
