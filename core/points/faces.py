"""Faces: where the loads of a surface act on its points.

A point at a surface stands for a cell that reaches half a spacing farther out, and there, on the cell's face, a load R
acts. The face is at x_i + d, moves with

    v_i + beta_i L_i d

(L the point's velocity gradient, beta its integrity, which fades the face of a degenerate neighbourhood into its
point), and the load is conjugate to that: R on the point, and its moment R (x) beta d against the point's stress, from
which the schemes make forces (`periporo.core.correspondence.flux`). The sum of all forces is R, their moment that of R
at the face. Were R to act on the point alone, no uniform stress could exist beside a loaded surface: what that exerts
on the rows of points below it are the parts 1.5, -0.5 and 0 of its load, which is where the face is, extrapolated.

Channels of force whose loads act on faces have the point field `<channel>_moment` (n, d^2) N m beside their force.
"""

import numpy as np

from periporo.core.numerics.jit import inlined, kernel


def turn(vectors: np.ndarray, gradient: np.ndarray, dt: float) -> None:
    """Turn `vectors` (n, d) of the first n points by their spin of a step of `dt` s."""
    if dt > 0.0:  # not a bit changes without
        _turn(gradient, dt, vectors)


@inlined
def face_velocity(velocity, gradient, i, lever, face):
    """Fill `face` (d,) m/s with the velocity of the face of point i at `lever` (d,) m from it."""
    d = lever.shape[0]
    for a in range(d):
        face[a] = velocity[i, a]
        for b in range(d):
            face[a] += gradient[i, d * a + b] * lever[b]


@inlined
def add_face_force(force, moment, i, load, lever):
    """Add a `load` (d,) N that acts on the face of point i at `lever` (d,) m from it."""
    d = lever.shape[0]
    for a in range(d):
        force[i, a] += load[a]
        for b in range(d):
            moment[i, d * a + b] += load[a] * lever[b]


@kernel
def _turn(gradient, dt, vectors):
    """a <- (I + dW + dW^2/2) a with its length kept; exact to fourth order if `gradient` is that of the step's end."""
    d = vectors.shape[1]
    spin, once, twice = np.zeros((d, d)), np.zeros(d), np.zeros(d)
    for i in range(vectors.shape[0]):
        before, after = 0.0, 0.0
        for a in range(d):
            before += vectors[i, a] ** 2
        if before == 0.0:
            continue
        for a in range(d):
            for b in range(d):
                spin[a, b] = 0.5 * dt * (gradient[i, d * a + b] - gradient[i, d * b + a])
        _apply(spin, vectors[i], once)
        _apply(spin, once, twice)
        for a in range(d):
            vectors[i, a] += once[a] + 0.5 * twice[a]
            after += vectors[i, a] ** 2
        for a in range(d):
            vectors[i, a] *= np.sqrt(before / after)


@inlined
def _apply(matrix, x, image):
    for a in range(x.shape[0]):
        image[a] = 0.0
        for b in range(x.shape[0]):
            image[a] += matrix[a, b] * x[b]
