"""Symmetric tensors as rows of components, the order defined once for the whole program.

Components stand in the order xx, yy, zz, xy, yz, xz. Plane strain keeps the first four, three dimensions
keep all six. Shear entries are tensor components (half of the engineering shear).
"""

import numpy as np

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "xz")
"""Names of the components in their order; plane strain has the first four."""

VECTOR = ("x", "y", "z")
"""Names of the components of a vector."""

MATRIX = tuple(a + b for a in VECTOR for b in VECTOR)
"""Names of the components of a matrix, row by row."""

INDEX_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
"""Row and column of each component."""


def component_count(dimension: int) -> int:
    """Stored components of a symmetric tensor: 4 in plane strain, 6 in three dimensions."""
    return 4 if dimension == 2 else 6


def dimension_of(rows: np.ndarray) -> int:
    """The dimension, 2 or 3, of the scene whose symmetric tensors are stored as `rows` (..., 4|6)."""
    return 2 if rows.shape[-1] == 4 else 3


def to_matrix(rows: np.ndarray) -> np.ndarray:
    """Full tensors (n, 3, 3) from rows (n, 4) or (n, 6).

    >>> to_matrix(np.array([[1.0, 2.0, 3.0, 4.0]]))[0].tolist()
    [[1.0, 4.0, 0.0], [4.0, 2.0, 0.0], [0.0, 0.0, 3.0]]
    """
    full = np.zeros((len(rows), 3, 3))
    for c, (a, b) in enumerate(INDEX_PAIRS[: rows.shape[1]]):
        full[:, a, b] = full[:, b, a] = rows[:, c]
    return full


def from_matrix(full: np.ndarray, components: int) -> np.ndarray:
    """Rows (n, components) from full tensors (n, 3, 3)."""
    return np.stack([full[:, a, b] for a, b in INDEX_PAIRS[:components]], axis=1)


def filled(n: int, value: float) -> np.ndarray:
    """An array (n,) of one value: as `np.full`, whose call costs three times as much."""
    rows = np.empty(n)
    rows.fill(value)
    return rows


def mean(rows: np.ndarray) -> np.ndarray:
    """Mean p = tr/3 of each row, (n,); negative in compression."""
    return (rows[:, 0] + rows[:, 1] + rows[:, 2]) / 3.0


def deviator_norm(rows: np.ndarray) -> np.ndarray:
    """|s| = sqrt(s:s) of each row's deviator, (n,)."""
    p = mean(rows)
    normal = sum((rows[:, c] - p) ** 2 for c in range(3))
    return np.sqrt(normal + 2.0 * np.sum(rows[:, 3:] ** 2, axis=1))


def equivalent_shear(rows: np.ndarray) -> np.ndarray:
    """q = sqrt(3/2) |s| of each row, (n,)."""
    return np.sqrt(1.5) * deviator_norm(rows)


def square_lengths(vectors: np.ndarray) -> np.ndarray:
    """|v|^2 (n,) of vectors (n, d), column by column: along rows of two or three numbers NumPy is five times slower."""
    return sum(column * column for column in vectors.T)


def moments(arm: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Moments (n, k) N m of forces (n, d) N with arms (n, d) m: one in the plane, three in space."""
    pairs = [(0, 1)] if arm.shape[1] == 2 else [(1, 2), (2, 0), (0, 1)]
    return np.column_stack([arm[:, a] * force[:, b] - arm[:, b] * force[:, a] for a, b in pairs])
