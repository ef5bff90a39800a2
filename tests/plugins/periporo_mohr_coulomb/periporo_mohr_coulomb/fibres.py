"""Elastic soil with fibres of one direction, which turn and stretch with it: a law that asks how its rows turn."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from periporo.materials import ROTATION, MaterialParameters, StateField, from_matrix, to_matrix


def _positive(unit, meaning):
    return Field(gt=0, description=meaning, json_schema_extra={"unit": unit})


class Fibres(MaterialParameters):
    """Hooke's law, and along the unit vector a of the fibres the stress E (a . e a) besides."""

    density: float = _positive("kg/m^3", "density")
    bulk_modulus: float = _positive("Pa", "bulk modulus of the soil")
    shear_modulus: float = _positive("Pa", "shear modulus of the soil")
    fibre_stiffness: float = _positive("Pa", "E, stiffness of the fibres per area of soil")
    direction: tuple[float, float, float] = Field((1.0, 0.0, 0.0), strict=False, description="fibres at the start")

    state_fields: ClassVar[tuple] = (StateField("fibre", "1", kind="vector"), ROTATION)

    @classmethod
    def example(cls):
        return cls(density=1700.0, bulk_modulus=2e7, shear_modulus=1e7, fibre_stiffness=3e7)

    def initial_state(self, stress, ids, volume):
        state = np.zeros((len(stress), 12))
        state[:, :3] = np.array(self.direction) / np.linalg.norm(self.direction)
        return state

    def compute_stress(self, stress, strain_increment, state, dt):
        rotation, strain = state[:, 3:].reshape(-1, 3, 3), to_matrix(strain_increment)
        a = np.einsum("nij,nj->ni", rotation, state[:, :3])  # strain comes turned to the end of the step
        stretch = np.einsum("ni,nij,nj->n", a, strain, a)
        along = np.einsum("n,ni,nj->nij", self.fibre_stiffness * stretch, a, a)
        stress += 2 * self.shear_modulus * strain_increment + from_matrix(along, stress.shape[1])
        lame = self.bulk_modulus - 2 / 3 * self.shear_modulus
        stress[:, :3] += lame * np.trace(strain, axis1=1, axis2=2)[:, None]
        a += np.einsum("nij,nj->ni", strain, a)
        length = np.linalg.norm(a, axis=1, keepdims=True)
        state[:, :3] = a / np.where(length > 0, length, 1.0)  # rows without state have no fibres

    def elastic_moduli(self, stress, state):
        bulk, shear = self.bulk_modulus + self.fibre_stiffness / 9, self.shear_modulus + self.fibre_stiffness / 3
        return np.full(len(stress), bulk), np.full(len(stress), shear)
