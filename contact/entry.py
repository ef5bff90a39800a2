"""The force of a contact that is not there at both ends of a time step. For use inside kernels."""

import numpy as np

from periporo.core.numerics.jit import inlined


@inlined
def elastic_force(k, overlap, way, mobility):
    """Force of a spring of stiffness k that acts at an `overlap` above zero and has come the `way` to it in a step.

    In velocity Verlet the force at an end of a step does its work on half of the way of the step before and on half of
    that of the step behind it. With k times the overlap at both ends that is the change of k overlap^2 / 2. A step that
    began outside lacks the spring on a part of the way, and one that ends outside has too much of it: what such a step
    takes too much, or gives, is made good by this force in the step and the next, whose way is foreseen as that of two
    points that nothing else pushes. `mobility` is the square of the time step over their reduced mass. So one that does
    the work of the spring, and of a potential, whatever the time step, as long as that is stable.
    """
    before = overlap - way
    if overlap > 0.0:
        if before >= 0.0:
            return k * overlap
        # F way + F (way - mobility F) = k overlap (overlap + way - mobility F)
        half = way + 0.5 * mobility * k * overlap
        return (half - np.sqrt(max(half * half - mobility * k * overlap * (overlap + way), 0.0))) / mobility
    if before <= 0.0:
        return 0.0
    # -F way + F (-way - mobility F) = k before overlap: a pull F < 0 on the way out
    return (np.sqrt(max(way * way + mobility * k * before * overlap, 0.0)) + way) / mobility
