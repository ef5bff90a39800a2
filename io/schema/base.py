"""What all input models share: strict numbers with bounds, names, vectors, regions and time histories."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    StringConstraints,
    ValidationInfo,
    model_validator,
)
from pydantic.config import JsonDict

from periporo.io.schema.records import read_record

MAX_LENGTH = 1e7  # m
MAX_TIME = 1e10  # s
MAX_SPEED = 1e5  # m/s
MAX_STRESS = 1e13  # Pa
MAX_ACCELERATION = 1e6  # m/s^2
NAME_PATTERN = r"^\w([\w .+-]{0,62}\w)?$"
TEXT_PATTERN = r"^[^\x00-\x08\x0b-\x1f\x7f]*$"
FILE_PATTERN = r"^[^\x00-\x1f\x7f]+$"


class SceneModel(BaseModel):
    """Base of every part of a scene: immutable; unknown keys, NaN and infinity are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


def key(
    description: str,
    unit: str = "",
    *,
    default: Any = ...,
    vector: bool = False,
    place: Literal["point", "level", "z"] | None = None,
    **bounds,
) -> Any:
    """A key of the input with its description, unit and bounds, as the reference and the schema show them.

    `vector` marks an entry that must have as many components as the scene has dimensions. `place` marks what moves with
    the scene: a point, or several; a level against gravity; a range of z.
    """
    extra: JsonDict = {"unit": unit} if unit else {}
    if vector:
        extra["vector"] = True
    if place:
        extra["place"] = place
    return Field(default, description=description, json_schema_extra=extra, **bounds)


def _up_to(size: float) -> Any:
    return Field(ge=-size, le=size)


_COMPONENTS = Field(min_length=2, max_length=3)

Real = Annotated[float, Strict()]
Integer = Annotated[int, Strict()]
Flag = Annotated[bool, Strict()]
Coordinate = Annotated[float, Strict(), _up_to(MAX_LENGTH)]
Pressure = Annotated[float, Strict(), _up_to(MAX_STRESS)]
Time = Annotated[float, Strict(), _up_to(MAX_TIME)]
Position = Annotated[tuple[Coordinate, ...], _COMPONENTS]
OpenPosition = Annotated[tuple[Coordinate | None, ...], _COMPONENTS]
Velocity = Annotated[tuple[Annotated[float, Strict(), _up_to(MAX_SPEED)], ...], _COMPONENTS]
Acceleration = Annotated[tuple[Annotated[float, Strict(), _up_to(MAX_ACCELERATION)], ...], _COMPONENTS]
Stress = Annotated[tuple[Pressure, ...], _COMPONENTS]
Axis = Literal["x", "y", "z"]
Text = Annotated[str, StringConstraints(max_length=1000, pattern=TEXT_PATTERN)]
Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
FileName = Annotated[str, StringConstraints(min_length=1, max_length=250, pattern=FILE_PATTERN)]


class Region(SceneModel):
    """An axis-aligned box, open where a bound is null; only the points of one body or material, if it is named."""

    lower: OpenPosition | None = key("lower corner, null = unbounded", "m", default=None, vector=True, place="point")
    upper: OpenPosition | None = key("upper corner, null = unbounded", "m", default=None, vector=True, place="point")
    body: Name | None = key("only points of this body", default=None)
    material: Name | None = key("only points that are of this material at the start, such as a layer", default=None)

    @model_validator(mode="after")
    def _selects(self):
        if all(part is None for part in (self.lower, self.upper, self.body, self.material)):
            raise ValueError("give at least one of lower, upper, body, material")
        return self


class History(SceneModel):
    """A value over time, linear between the times given, constant before the first and after the last."""

    times: tuple[Time, ...] = key(
        "times from the start of the run, increasing; a relaxation takes none", "s", min_length=1, max_length=100_000
    )
    values: tuple[Coordinate, ...] = key("values at these times", min_length=1, max_length=100_000)

    @model_validator(mode="after")
    def _is_a_function(self):
        if len(self.times) != len(self.values):
            raise ValueError(
                f"{len(self.times)} times but {len(self.values)} values; give one value for each time"
            )
        for earlier, later in zip(self.times, self.times[1:], strict=False):
            if later <= earlier:
                raise ValueError(f"times must increase, but {later} follows {earlier}")
        return self


class HistoryFile(SceneModel):
    """A history in a file: .csv with two columns, time and value, or .at2 (PEER), whose g are taken as 9.80665 m/s^2.

    A scene that is written again has the numbers in its place.
    """

    file: FileName = key("file name, relative to the scene's folder")
    scale: Real = key("factor of its values", "1", default=1.0, ge=-1e6, le=1e6)


def _as_history(value: Any, info: ValidationInfo) -> Any:
    """A number as a constant history, a file as the history in it."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return {"times": [0.0], "values": [value]}
    if not (isinstance(value, dict) and "file" in value):
        return value
    given = HistoryFile.model_validate(value)
    try:
        times, values = read_record(Path((info.context or {}).get("folder", "."), given.file))
    except ValueError as error:
        raise ValueError(f"{given.file}: {error}") from None
    return {"times": times, "values": [given.scale * v for v in values]}


Motion = Annotated[
    History, BeforeValidator(_as_history, json_schema_input_type=float | History | HistoryFile)
]


class MotionComponents(SceneModel):
    """A constant or a history for each component that is prescribed; the others are free."""

    x: Motion | None = key("along x: a number, {times, values} or {file}", default=None)
    y: Motion | None = key("along y: a number, {times, values} or {file}", default=None)
    z: Motion | None = key("along z: a number, {times, values} or {file}", default=None)

    @model_validator(mode="after")
    def _prescribes(self):
        if self.x is None and self.y is None and self.z is None:
            raise ValueError("give at least one of x, y, z")
        return self

    def histories(self) -> dict[str, History]:
        """The components that are prescribed, by their letter."""
        return {axis: getattr(self, axis) for axis in "xyz" if getattr(self, axis) is not None}


class AccelerationComponents(MotionComponents):
    """Histories of acceleration, from rest; records that end in motion, or elsewhere, have a drift."""

    baseline: Literal["refuse", "correct", "keep"] = key(
        "what to do with a drift: refuse it, take off a straight line so that the motion ends at rest where it began, "
        "or keep it",
        default="refuse",
    )
