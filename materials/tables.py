"""Parameters that follow the plastic shear strain: a number, or a table of it."""

from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

_Rows = Annotated[tuple[float, ...], Field(min_length=2, max_length=1000)]


class StrainTable(BaseModel):
    """A parameter over the plastic shear strain: linear between the values given, and constant after the last."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    plastic_shear: _Rows = Field(description="plastic shear strains, from 0 up", json_schema_extra={"unit": "1"})
    values: _Rows = Field(description="values there")

    @model_validator(mode="after")
    def _is_a_function(self):
        strain = self.plastic_shear
        if len(strain) != len(self.values):
            raise ValueError(f"{len(strain)} strains but {len(self.values)} values; give one value for each strain")
        if strain[0] != 0.0:
            raise ValueError(f"plastic_shear must begin with 0, the soil as it is, not {strain[0]:g}")
        for earlier, later in zip(strain, strain[1:], strict=False):
            if later <= earlier:
                raise ValueError(f"plastic_shear must increase, but {later:g} follows {earlier:g}")
        return self


OverStrain = Annotated[
    Annotated[float, Tag("[number]")] | Annotated[StrainTable, Field(strict=False), Tag("[table]")],
    Discriminator(lambda value: "[table]" if isinstance(value, dict | StrainTable) else "[number]"),
]
"""A number, or a table of it: what is wrong with it is said of the one that was meant."""


def strains_of(*parameters: float | StrainTable) -> np.ndarray:
    """The strains at which any of the parameters has a value, (m,) from 0 up."""
    tables = [p.plastic_shear for p in parameters if isinstance(p, StrainTable)]
    return np.unique(np.concatenate([[0.0], *tables]))


def values_at(parameter: float | StrainTable, strain: np.ndarray) -> np.ndarray:
    """The parameter at each `strain` (m,)."""
    if isinstance(parameter, StrainTable):
        return np.interp(strain, parameter.plastic_shear, parameter.values)
    return np.full(len(strain), parameter)


def extremes(parameter: float | StrainTable) -> tuple[float, float]:
    """Smallest and largest value."""
    values = parameter.values if isinstance(parameter, StrainTable) else (parameter,)
    return min(values), max(values)


def scaled(parameter: float | StrainTable, function) -> float | StrainTable:
    """The parameter with each value v replaced by function(v)."""
    if isinstance(parameter, StrainTable):
        return parameter.model_copy(update={"values": tuple(map(function, parameter.values))})
    return function(parameter)
