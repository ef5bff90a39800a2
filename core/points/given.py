"""What a law may ask for beside the strain of a step: time, place, rotation and deformation gradient.

A law asks by a state field of that name (`periporo.core.points.material`); the program writes its columns before the
law is called, for the end of the step. The columns are state like any other: they stay with a row through rebuilds,
checkpoints and other ranks, and a row that comes into being begins with the mean deformation gradient of its points.
"""

import numpy as np

from periporo.core.numerics.tensors import to_matrix
from periporo.core.points.material import DEFORMATION_GRADIENT, PLACE, ROTATION, TIME, Material, state_column

ASKED_FOR = (TIME, PLACE, ROTATION, DEFORMATION_GRADIENT)
"""State fields that the program writes for laws that have them."""


class Given:
    """What is told to the rows of a law, in which columns of their state."""

    def __init__(self, material: Material, components: int):
        columns = {field.name: state_column(material, field.name, components) for field in ASKED_FOR}
        self.time, self.place = columns[TIME.name], columns[PLACE.name]
        self.rotation, self.gradient = columns[ROTATION.name], columns[DEFORMATION_GRADIENT.name]

    @classmethod
    def of(cls, material: Material, components: int) -> "Given | None":
        """Of a law that asks for something, else None."""
        asks = any(state_column(material, field.name, components) is not None for field in ASKED_FOR)
        return cls(material, components) if asks else None

    @property
    def turns(self) -> bool:
        """Whether the law wants to know how its rows turn."""
        return self.rotation is not None or self.gradient is not None

    def tell(self, state, strain, spin, place, time: float) -> None:
        """Write into the `state` (n, k) of rows what is so at the `time` (s) at the end of a step.

        `strain` (n, 4|6) is that of the step, turned to its end, `spin` (n, 1|3) its axial vector, `place` (n, d) m.
        With the midpoint gradient G = H^T e H + W and the spin tensor W, stress turned by Q = c(W), H = c(W/2), and the
        deformation gradient becomes c(G) F, c(A) = (I - A/2)^-1 (I + A/2) (Hughes & Winget 1980).
        """
        n = len(state)
        if self.time is not None:
            state[:, self.time] = time
        if self.place is not None:
            state[:, self.place : self.place + place.shape[1]] = place
        if not self.turns:
            return
        turn = _skew(spin)
        if self.rotation is not None:
            state[:, self.rotation : self.rotation + 9] = _cayley(turn).reshape(n, 9)
        if self.gradient is not None:
            half = _cayley(0.5 * turn)
            change = half.transpose(0, 2, 1) @ to_matrix(strain) @ half + turn
            columns = slice(self.gradient, self.gradient + 9)
            before = state[:, columns].reshape(n, 3, 3)
            before[~before.any(axis=(1, 2))] = np.eye(3)  # of rows that have none yet
            state[:, columns] = (_cayley(change) @ before).reshape(n, 9)


def _cayley(a):
    """(I - a/2)^-1 (I + a/2) of matrices (n, 3, 3)."""
    return np.linalg.solve(np.eye(3) - 0.5 * a, np.eye(3) + 0.5 * a)


def _skew(spin):
    """Spin tensors (n, 3, 3) of axial vectors (n, 1|3)."""
    turn = np.zeros((len(spin), 3, 3))
    planes = ((1, 0),) if spin.shape[1] == 1 else ((2, 1), (0, 2), (1, 0))
    for c, (a, b) in enumerate(planes):
        turn[:, a, b], turn[:, b, a] = spin[:, c], -spin[:, c]
    return turn
