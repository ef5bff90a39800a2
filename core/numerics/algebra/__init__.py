"""Vectors and small matrices as tuples, for use inside kernels.

A kernel takes `dim`, a tuple of two or three zeros: its length is a compile-time constant, so one source
serves plane strain and three dimensions and the loops unroll into registers. Matrices are tuples in row
order (4 or 9 numbers), symmetric tensors follow `periporo.core.numerics.tensors` (4 or 6), symmetric d x d matrices
such as the shape tensor are (xx, yy, xy) or (xx, yy, zz, xy, yz, xz).
"""

from periporo.core.numerics.algebra.lanes import LANES, from_lane, to_lane
from periporo.core.numerics.algebra.matrices import (
    apply,
    determinant_minus,
    dyad,
    full,
    plus_dyad,
    plus_spherical,
    zero_matrix,
    zero_spin,
    zero_symmetric,
)
from periporo.core.numerics.algebra.rows import difference, matrix_at, mean_matrix, shape_at, store, symmetric_at
from periporo.core.numerics.algebra.shapes import inverse_shape, largest_eigenvalue, square, times_shape, trace_shape
from periporo.core.numerics.algebra.vectors import DIMENSION, dot, minus, scaled, zero_vector

__all__ = [
    "DIMENSION", "LANES", "apply", "determinant_minus", "difference", "dot", "dyad", "from_lane", "full",
    "inverse_shape", "largest_eigenvalue", "matrix_at", "mean_matrix", "minus", "plus_dyad", "plus_spherical",
    "scaled", "shape_at", "square", "store", "symmetric_at", "times_shape", "to_lane", "trace_shape",
    "zero_matrix", "zero_spin", "zero_symmetric", "zero_vector",
]  # fmt: skip
