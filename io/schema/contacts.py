"""Input models of boundary conditions, and of all contacts."""

from itertools import combinations
from typing import Annotated, Literal

from pydantic import Field, model_validator

from periporo.io.schema.base import (
    AccelerationComponents,
    Axis,
    Flag,
    Motion,
    MotionComponents,
    Name,
    Position,
    Real,
    Region,
    SceneModel,
    Stress,
    key,
)
from periporo.io.schema.obstacles import (
    CLEARED,
    MAX_STIFFNESS,
    BoxContact,
    ConeContact,
    ContactModel,
    CylinderContact,
    DiscContact,
    MeshContact,
    PlaneContact,
    PolylineContact,
    SphereContact,
    TerrainContact,
    WedgeContact,
)


class Traction(SceneModel):
    """A load on the outermost layer of the selected points."""

    stress: Stress = key("force per area", "Pa", vector=True)
    side: Literal["x-", "x+", "y-", "y+", "z-", "z+"] = key("the side of the selected points that is loaded")
    factor: Motion | None = key(
        "what the stress is multiplied by: a number, {times, values} or {file}; default 1", "1", default=None
    )


class WaterAtFaces(SceneModel):
    """What water does at the faces of the selected points, as far as they are at the surface; exactly one kind."""

    pressure: Motion | None = key("its pressure: a number or {times, values}", "Pa", default=None)
    head: Motion | None = key(
        "level to which it would stand up: a number or {times, values}", "m", default=None, place="level"
    )
    flux: Motion | None = key("what enters: a number or {times, values}", "m/s", default=None)
    rain: Motion | None = key(
        "what falls on a horizontal area; enters as long as there is room, comes out freely (0: a seepage face): a "
        "number or {times, values}",
        "m/s",
        default=None,
    )
    side: Literal["x-", "x+", "y-", "y+", "z-", "z+"] | None = key(
        "the faces that are meant; default all", default=None
    )
    obstacle: Name | None = key(
        "name of an obstacle: the faces that touch it are meant, in place of a side", default=None
    )

    @model_validator(mode="after")
    def _is_one_kind(self):
        kinds = ("pressure", "head", "flux", "rain")
        given = [kind for kind in kinds if getattr(self, kind) is not None]
        if len(given) != 1:
            found = f"found {' and '.join(given)}" if given else "found none"
            raise ValueError(f"give exactly one of {', '.join(kinds)}; {found}")
        if self.rain is not None and min(self.rain.values) < 0.0:
            raise ValueError("rain must not be below 0; give a flux for what is taken out")
        if self.obstacle is not None and self.side is not None:
            raise ValueError("give side or obstacle, not both")
        if self.obstacle is not None and self.rain is not None and max(self.rain.values) > 0.0:
            raise ValueError(
                "no rain falls where soil touches an obstacle; give rain: 0 for a drain, or head, pressure, flux"
            )
        return self

    @property
    def kind(self) -> str:
        """The key that was given."""
        return next(kind for kind in ("pressure", "head", "flux", "rain") if getattr(self, kind) is not None)


class Absorb(SceneModel):
    """Dashpots of the impedance of the ground beyond on the outermost layer of the selected points, in motion.

    What they held when the stage began, they go on to hold: they follow a stage that fixes them, or that is in balance.
    """

    side: Literal["x-", "x+", "y-", "y+", "z-", "z+"] = key("the side of the selected points beyond which ground is")
    velocity: MotionComponents | None = key(
        "velocity of a wave that comes from beyond: half of what it shows at a free surface", "m/s", default=None
    )
    acceleration: AccelerationComponents | None = key("its acceleration, in place of velocity", "m/s^2", default=None)
    beyond: Name | None = key(
        "material of the ground beyond, such as rock, as it is without stress; default that of the points", default=None
    )

    @model_validator(mode="after")
    def _comes_once(self):
        if self.velocity is not None and self.acceleration is not None:
            raise ValueError("give velocity or acceleration, not both")
        return self


class Tie(SceneModel):
    """The points of two regions that lie at the same level move alike, in motion: sides of ground that goes on."""

    to: Region = key("the other points")
    components: tuple[Axis, ...] = key("components that they have in common", min_length=1, max_length=3)


class Boundary(SceneModel):
    """A boundary condition on the points that `where` selects at the start; exactly one kind."""

    where: Region = key("the points that are concerned")
    fix: tuple[Axis, ...] | None = key("components that are held", default=None, min_length=1, max_length=3)
    velocity: MotionComponents | None = key("prescribed velocity", "m/s", default=None)
    displacement: MotionComponents | None = key(
        "prescribed displacement; what its history did before the stage began is left out", "m", default=None
    )
    acceleration: AccelerationComponents | None = key(
        "prescribed acceleration from rest, such as a record", "m/s^2", default=None
    )
    traction: Traction | None = key("a load", default=None)
    water: WaterAtFaces | None = key("water that enters or leaves", default=None)
    absorb: Absorb | None = key("let waves out", default=None)
    tie: Tie | None = key("make points move as those elsewhere at the same level", default=None)

    @property
    def holds(self) -> bool:
        """Whether it prescribes how points move."""
        return any((self.fix, self.velocity, self.displacement, self.acceleration))

    @model_validator(mode="after")
    def _is_one_kind(self):
        kinds = ("fix", "velocity", "displacement", "acceleration", "traction", "water", "absorb", "tie")
        given = [kind for kind in kinds if getattr(self, kind) is not None]
        if len(given) != 1:
            found = f"found {' and '.join(given)}" if given else "found none"
            raise ValueError(f"give exactly one of {', '.join(kinds)}; {found}")
        if self.fix and len(set(self.fix)) < len(self.fix):
            raise ValueError("a component stands in fix twice")
        return self


class BodiesContact(ContactModel):
    """Contact between two deformable bodies, or between all of them; they then bond with no other body.

    An entry for two bodies overrules one for all.
    """

    type: Literal["bodies"] = key("kind of contact")
    first: Name | None = key("name of a body", default=None)
    second: Name | None = key("name of the other body", default=None)
    between: Literal["all"] | None = key("all pairs of bodies, in place of first and second", default=None)

    @model_validator(mode="after")
    def _says_between_whom(self):
        given = [self.first, self.second].count(None)
        if given != (0 if self.between is None else 2):
            raise ValueError("give first and second, or between: all")
        return self

    def pairs(self, names: list[str]) -> list[tuple[str, str]]:
        """Pairs of names between which it is, in a scene with bodies of these names."""
        if self.first is None or self.second is None:
            return list(combinations(names, 2))
        return [(self.first, self.second)]


class Substrate(SceneModel):
    """A box of fixed points."""

    lower: Position = key("lower corner", "m", vector=True, place="point")
    upper: Position = key("upper corner", "m", vector=True, place="point")
    spacing: Real = key("distance of its points", "spacings", default=0.25, ge=0.01, le=1)


class ShortRangeContact(SceneModel):
    """The published short-range force against a substrate of points (Menon & Song 2022, eqs 95-96)."""

    type: Literal["short_range_published"] = key("kind of contact")
    stiffness: Real = key("force constant", "N/m^2", default=4e6, gt=0, le=MAX_STIFFNESS)
    friction: Real = key("friction of the published force", "1", default=0.25, ge=0, le=10)
    cutoff: Real = key("distance below which points repel", "spacings", default=0.8, gt=0, le=2)
    substrate: Substrate = key("the box of fixed points")
    stages: tuple[Name, ...] | None = key(
        "stages in which it is present; default all", default=None, min_length=1
    )
    cleared: Flag = key(CLEARED, default=False)


Contact = Annotated[
    PlaneContact
    | BoxContact
    | CylinderContact
    | DiscContact
    | SphereContact
    | WedgeContact
    | ConeContact
    | MeshContact
    | PolylineContact
    | TerrainContact
    | BodiesContact
    | ShortRangeContact,
    Field(discriminator="type"),
]
