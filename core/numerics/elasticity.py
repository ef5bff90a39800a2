"""Hooke's law between increments of strain and stress, with which many laws begin: bulk and shear modulus in Pa."""

from periporo.core.numerics.jit import inlined


@inlined
def _add_normal(bulk, shear, b, stress, strain_increment):
    volumetric = strain_increment[b, 0] + strain_increment[b, 1] + strain_increment[b, 2]
    lame = (bulk - 2.0 / 3.0 * shear) * volumetric
    for c in range(3):
        stress[b, c] += lame + 2.0 * shear * strain_increment[b, c]


@inlined
def add_elastic(bulk, shear, b, stress, strain_increment):
    """Add K tr(de) 1 + 2 mu dev(de) to row `b` of `stress` (n, 4|6) Pa."""
    _add_normal(bulk, shear, b, stress, strain_increment)
    stress[b, 3] += 2.0 * shear * strain_increment[b, 3]
    if stress.shape[1] == 6:
        stress[b, 4] += 2.0 * shear * strain_increment[b, 4]
        stress[b, 5] += 2.0 * shear * strain_increment[b, 5]


@inlined
def elastic_trial(bulk, shear, weight, b, stress, strain_increment):
    """As `add_elastic`; mean p (Pa) and `weight` s:s (Pa^2) of the row then, cheapest on the way."""
    _add_normal(bulk, shear, b, stress, strain_increment)
    p = (stress[b, 0] + stress[b, 1] + stress[b, 2]) / 3.0
    square = weight * ((stress[b, 0] - p) ** 2 + (stress[b, 1] - p) ** 2 + (stress[b, 2] - p) ** 2)
    for c in range(3, stress.shape[1]):
        stress[b, c] += 2.0 * shear * strain_increment[b, c]
        square += 2.0 * weight * stress[b, c] ** 2
    return p, square
