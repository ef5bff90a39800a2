"""The force of a contact that is not there at both ends of a time step. For use inside kernels."""

import numpy as np

from periporo.core.numerics.jit import inlined


@inlined
def elastic_force(k, overlap, way, mobility, gained=0.0):
    """Force of a spring of stiffness k that acts at an `overlap` above zero and has come the `way` to it in a step.

    In velocity Verlet the force at an end of a step does its work on half of the way of the step before and on half
    of that of the step behind it. With k times the overlap at both ends that is the change of k overlap^2 / 2. A step
    that began outside lacks the spring on a part of the way, and one that ends outside has too much of it: what such
    a step takes too much, or gives, is made good by this force in the step and the next. The way of the next is
    foreseen: it is that of this one, by the force shorter, and longer by what this one has `gained` over the step
    before by all that is not the contact. `mobility` is the square of the time step over the reduced mass of the two.
    So the force does the work of the spring, and of a potential, whatever the time step, as long as that is stable.
    """
    before = overlap - way
    if overlap > 0.0:
        if before >= 0.0:
            return k * overlap
        # F way + F (next - mobility F) = k overlap (overlap + next - mobility F)
        ahead = way + gained
        half = 0.5 * (way + ahead + mobility * k * overlap)
        return (half - np.sqrt(max(half * half - mobility * k * overlap * (overlap + ahead), 0.0))) / mobility
    if before <= 0.0:
        return 0.0
    # -F way + F (mobility F - next) = k before overlap: a pull F < 0 on the way out
    half = way + 0.5 * gained
    return (np.sqrt(max(half * half + mobility * k * before * overlap, 0.0)) + half) / mobility
