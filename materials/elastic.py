"""Isotropic hypoelasticity: Hooke's law between the objective stress rate and the rate of deformation."""

from typing import ClassVar, Self

import numpy as np
from pydantic import Field

from periporo.core.numerics.elasticity import add_elastic
from periporo.core.numerics.jit import kernel
from periporo.core.numerics.tensors import filled
from periporo.core.points.material import StateField
from periporo.materials.base import MaterialParameters


class Elastic(MaterialParameters):
    """Linear isotropic elastic law: dp = K tr(de), ds = 2 mu dev(de)."""

    density: float = Field(gt=0, description="dry bulk density", json_schema_extra={"unit": "kg/m^3"})
    bulk_modulus: float = Field(gt=0, description="bulk modulus K", json_schema_extra={"unit": "Pa"})
    shear_modulus: float = Field(gt=0, description="shear modulus mu", json_schema_extra={"unit": "Pa"})

    state_fields: ClassVar[tuple[StateField, ...]] = ()
    conservative: ClassVar[bool] = True

    @classmethod
    def example(cls) -> Self:
        """A loose soil."""
        return cls(density=1760.0, bulk_modulus=25e6, shear_modulus=15e6)

    def initial_state(self, stress, ids, volume):
        """No state: an (n, 0) array."""
        return np.zeros((len(stress), 0))

    def compute_stress(self, stress, strain_increment, state, dt):
        """Add the elastic increment to `stress` (n, 4|6) Pa in place."""
        _add_elastic_increment(self.bulk_modulus, self.shear_modulus, stress, strain_increment)

    def elastic_moduli(self, stress, state):
        """Constant moduli, two (n,) arrays in Pa."""
        n = len(stress)
        return filled(n, self.bulk_modulus), filled(n, self.shear_modulus)

    @classmethod
    def of_rows(cls, laws, components):
        """What answers for rows of which each has one of the `laws`."""
        return _ElasticRows(np.array([(law.bulk_modulus, law.shear_modulus) for law in laws]))


class _ElasticRows:
    def __init__(self, moduli):
        self._moduli = moduli

    def compute_stress(self, stress, strain_increment, state, dt):
        _add_elastic_increments(self._moduli, stress, strain_increment)

    def elastic_moduli(self, stress, state):
        return self._moduli[:, 0].copy(), self._moduli[:, 1].copy()


@kernel
def _add_elastic_increment(bulk, shear, stress, strain_increment):
    for b in range(stress.shape[0]):
        add_elastic(bulk, shear, b, stress, strain_increment)


@kernel
def _add_elastic_increments(moduli, stress, strain_increment):
    for b in range(stress.shape[0]):
        add_elastic(moduli[b, 0], moduli[b, 1], b, stress, strain_increment)
