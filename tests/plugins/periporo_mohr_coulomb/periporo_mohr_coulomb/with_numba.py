"""The same law in a compiled loop: Jacobi rotations give the principal stresses of each row."""

import math

import numpy as np

from periporo.materials import INDEX_PAIRS, kernel
from periporo_mohr_coulomb.with_numpy import MohrCoulomb

_A, _B = (np.array(c) for c in zip(*INDEX_PAIRS, strict=True))


class MohrCoulombNumba(MohrCoulomb):
    """Parameters and return maps of the NumPy law, another loop."""

    def compute_stress(self, stress, strain_increment, state, dt):
        strength, apex, maps = self.return_maps()
        normals, maps = np.concatenate([n for n, _ in maps]), np.hstack([a for _, a in maps])
        moduli = self.bulk_modulus - 2 / 3 * self.shear_modulus, 2 * self.shear_modulus
        psi = math.sin(math.radians(self.dilation_angle))
        _advance(*moduli, psi, strength, apex, normals, maps, stress, strain_increment)


@kernel
def _diagonalise(work):
    """Turn work[:3], symmetric, into its eigenvalues; the columns of work[3:] become their directions."""
    for turn in range(30):
        i, j = turn % 3, (turn + 1) % 3
        difference = work[j, j] - work[i, i]
        half = 0.5 * math.atan2(math.copysign(2.0, difference) * work[i, j], abs(difference))
        c, s = math.cos(half), math.sin(half)
        for k in range(6):
            first, second = work[k, i], work[k, j]
            work[k, i], work[k, j] = c * first - s * second, s * first + c * second
        for k in range(3):
            first, second = work[i, k], work[j, k]
            work[i, k], work[j, k] = c * first - s * second, s * first + c * second


@kernel
def _advance(lame, double_shear, psi, strength, apex, normals, maps, stress, strain_increment):
    work, order, result = np.empty((6, 3)), np.empty(3, np.int64), np.empty(3)
    for b in range(stress.shape[0]):
        volumetric = strain_increment[b, 0] + strain_increment[b, 1] + strain_increment[b, 2]
        work[:] = 0.0
        for c in range(stress.shape[1]):
            stress[b, c] += double_shear * strain_increment[b, c] + (lame * volumetric if c < 3 else 0.0)
            work[_A[c], _B[c]] = work[_B[c], _A[c]] = stress[b, c]
        for i in range(3):
            work[3 + i, i] = 1.0
            order[i] = i
        _diagonalise(work)
        for i, j in ((0, 1), (1, 2), (0, 1)):  # descending
            if work[order[i], order[i]] < work[order[j], order[j]]:
                order[i], order[j] = order[j], order[i]
        s1, s2, s3 = work[order[0], order[0]], work[order[1], order[1]], work[order[2], order[2]]
        if not normals[0, 0] * s1 + normals[0, 2] * s3 > strength:
            continue
        to_right = (1.0 - psi) * s1 + (1.0 + psi) * s3 > 2.0 * s2  # s2 and s3 meet before s1 and s2 do
        for first, last in ((0, 1), (1, 3) if to_right else (3, 5)):  # face, edge s2 = s3 or s1 = s2
            result[0], result[1], result[2] = s1, s2, s3
            for k in range(first, last):
                excess = normals[k, 0] * s1 + normals[k, 1] * s2 + normals[k, 2] * s3 - strength
                for i in range(3):
                    result[i] -= maps[i, k] * excess
            if (first == 3 or result[0] >= result[1]) and (first == 1 or result[1] >= result[2]):
                break
        else:
            result[:] = apex
        for c in range(stress.shape[1]):
            stress[b, c] = 0.0
            for i in range(3):
                stress[b, c] += result[i] * work[3 + _A[c], order[i]] * work[3 + _B[c], order[i]]
