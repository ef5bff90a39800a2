"""Base of the built-in materials: validated, frozen parameters whose names are the input keys."""

from pydantic import BaseModel, ConfigDict


class MaterialParameters(BaseModel):
    """Strict and immutable parameters; unknown keys, NaN and wrong types are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)
