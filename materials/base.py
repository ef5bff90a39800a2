"""Base of the built-in materials: validated, frozen parameters whose names are the input keys."""

from collections.abc import Mapping
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator
from pydantic.config import JsonDict

LARGEST = {"Pa": 1e13, "kg/m^3": 1e6, "deg": 360.0}
"""Largest size of a parameter by its unit: fifty times the stiffness of steel, fifty times the density of gold."""

LARGEST_OF_OTHERS = 1e60
"""Largest size in any other unit, such as the Pa^3 s of a viscosity: products of a few stay numbers."""


def units(*names: str) -> tuple[JsonDict, ...]:
    """For `json_schema_extra` of a parameter's `Field`: each of the units by its name."""
    return tuple({"unit": name} for name in names)


class MaterialParameters(BaseModel):
    """Strict and immutable parameters; unknown keys, NaN, wrong types and impossible sizes are errors.

    A parameter's unit stands in its field: `Field(json_schema_extra={"unit": "Pa"})`. It bounds the size.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with other values; what was found from the old ones, and kept, is found anew."""
        copied = super().model_copy(update=update, deep=deep)
        for name in copied.__dict__.keys() - type(self).model_fields.keys():
            del copied.__dict__[name]
        return copied

    @field_validator("*")
    @classmethod
    def _has_a_sane_size(cls, value: Any, info: ValidationInfo) -> Any:
        if not isinstance(value, int | float):
            return value
        extra = cls.model_fields[str(info.field_name)].json_schema_extra
        unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
        largest = LARGEST.get(unit, LARGEST_OF_OTHERS)
        if abs(value) > largest:
            raise ValueError(f"must be at most {largest:g} {unit}".rstrip(" 1") + f" in size, not {value:.10g}")
        return value
