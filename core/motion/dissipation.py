"""Plastic dissipation of the points, for the energy ledger, where a law reports it.

A law reports it by a state column named `dissipation`: the plastic work of the last step, J/m^3.
"""

import numpy as np

from periporo.core.points.material import Material, state_column
from periporo.core.points.particles import Field

NAME = "dissipation"


class PlasticDissipation:
    """Adds up the plastic work (J) of each point's rows."""

    output = ("plastic_dissipation",)

    def attach(self, p) -> None:
        """Declare the field."""
        p.add_field(Field("plastic_dissipation", None, "J", sent=False))

    def update(self, p, bonds, dt: float) -> None:
        """Add this step's work: a row's half to either of the points that hold it."""
        for block in bonds.blocks:
            column = state_column(block.material, NAME, p.components)
            if column is None:
                continue
            rows = np.flatnonzero(block.active & (block.state[:, column] != 0.0))
            work = bonds.layout.volumes(block, bonds.pairs, p, rows) * block.state[rows, column]
            bonds.book(p, block, rows, work, p.plastic_dissipation)


def reports(material: Material) -> bool:
    """Whether the law has the state column `dissipation`."""
    return any(field.name == NAME for field in material.state_fields)
