"""Base of the built-in materials: validated, frozen parameters whose names are the input keys."""

from typing import Any

from pydantic import BaseModel, ConfigDict, field_validator

LARGEST = 1e13
"""Largest size of a parameter in SI units: fifty times the stiffness of steel."""


class MaterialParameters(BaseModel):
    """Strict and immutable parameters; unknown keys, NaN, wrong types and sizes over `LARGEST` are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    @field_validator("*")
    @classmethod
    def _has_a_sane_size(cls, value: Any) -> Any:
        if isinstance(value, int | float) and abs(value) > LARGEST:
            raise ValueError(f"must be at most {LARGEST:g} in size, not {value:.10g}")
        return value
