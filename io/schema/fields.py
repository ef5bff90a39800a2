"""Parameters of laws that vary from place to place: the forms that they are given in, in place of a number."""

import functools
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, TypeAdapter, model_validator

from periporo.io.schema.base import Coordinate, Integer, Name, Real, SceneModel, key
from periporo.io.schema.files import ExistingFile
from periporo.io.schema.ground import RasterFile


class _Table(SceneModel):
    """Values between which it is linear, constant before the first and after the last."""

    at: tuple[Coordinate, ...] = key("where the values hold, increasing", "m", min_length=1, max_length=100_000)
    values: tuple[Real, ...] = key("values there", min_length=1, max_length=100_000)

    @model_validator(mode="after")
    def _is_a_function(self):
        if len(self.at) != len(self.values):
            raise ValueError(f"{len(self.at)} places but {len(self.values)} values; give one value for each")
        for lower, upper in zip(self.at, self.at[1:], strict=False):
            if upper <= lower:
                raise ValueError(f"'at' must increase, but {upper:g} follows {lower:g}")
        return self


class DepthField(_Table):
    """Linear between values at depths below the surface at the start."""

    field: Literal["depth"] = key("kind of field")


class LevelField(_Table):
    """Linear between values at levels against gravity."""

    field: Literal["level"] = key("kind of field")
    at: tuple[Coordinate, ...] = key(
        "levels, increasing", "m", min_length=1, max_length=100_000, place="level"
    )


class RasterField(RasterFile):
    """The values of a raster over x and y, see RasterFile."""

    field: Literal["raster"] = key("kind of field")


class PointsField(SceneModel):
    """A column of a CSV file headed x,y[,z] and other names: the value of the nearest of its points."""

    field: Literal["points"] = key("kind of field")
    file: ExistingFile = key("file name, relative to the scene's folder")
    column: Name = key("name of the column")
    _origin: tuple[float, ...] = PrivateAttr(default=())


class RandomField(SceneModel):
    """Random numbers that are alike at places nearer than the correlation length (needs gstools).

    Correlation at a distance r: exp(-r/l) (exponential) or exp(-pi/4 (r/l)^2) (gaussian), with l along each axis.
    """

    field: Literal["random"] = key("kind of field")
    mean: Real | DepthField | LevelField = key("mean, or how it varies with depth or level")
    deviation: Real | None = key("standard deviation", default=None, gt=0)
    variation: Real | None = key("standard deviation over the mean, in place of it", "1", default=None, gt=0, le=100)
    distribution: Literal["normal", "lognormal"] = key("distribution of the values", default="lognormal")
    correlation: Literal["exponential", "gaussian"] = key("how the correlation falls", default="exponential")
    length: Real | tuple[Real, ...] = key("correlation length, or one along each axis", "m")
    seed: Integer = key("start of its random numbers", default=0, ge=0, lt=2**31)
    lowest: Real | None = key("what is less is raised to this", default=None)
    highest: Real | None = key("what is more is lowered to this", default=None)
    _origin: tuple[float, ...] = PrivateAttr(default=())

    @model_validator(mode="after")
    def _is_a_distribution(self):
        if (self.deviation is None) == (self.variation is None):
            raise ValueError("give exactly one of: deviation, variation (deviation over mean)")
        lengths = self.length if isinstance(self.length, tuple) else (self.length,)
        if not all(length > 0.0 for length in lengths):
            raise ValueError(f"correlation lengths must be greater than 0, not {', '.join(f'{v:g}' for v in lengths)}")
        means = [self.mean] if isinstance(self.mean, float | int) else self.mean.values
        if self.distribution == "lognormal" and not all(mean > 0.0 for mean in means):
            raise ValueError("a lognormal distribution needs a mean greater than 0; choose normal")
        if self.lowest is not None and self.highest is not None and not self.lowest < self.highest:
            raise ValueError(f"highest ({self.highest:g}) must exceed lowest ({self.lowest:g})")
        return self


ParameterField = DepthField | LevelField | RasterField | PointsField | RandomField

_KINDS = (DepthField, LevelField, RasterField, PointsField, RandomField)


@functools.cache  # made when asked for: few scenes have fields
def _adapter() -> TypeAdapter[Any]:
    return TypeAdapter(Annotated[ParameterField, Field(discriminator="field")])


def is_field(value: Any) -> bool:
    """Whether the value of a parameter is a field: a mapping with the key `field`, or one that was read."""
    return isinstance(value, _KINDS) or (isinstance(value, dict) and "field" in value)


def read_field(value: Any, folder: str | Path) -> ParameterField:
    """The field that a mapping describes; file names are relative to a `folder`. Raises pydantic's ValidationError."""
    return value if isinstance(value, _KINDS) else _adapter().validate_python(value, context={"folder": folder})


def field_schema() -> dict[str, Any]:
    """JSON Schema of all kinds of field."""
    return _adapter().json_schema()
