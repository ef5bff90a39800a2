"""Input models of rigid obstacles, and how they move."""

import math
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, PrivateAttr, Tag, model_validator

from periporo.io.schema.base import (
    MAX_LENGTH,
    AccelerationComponents,
    Axis,
    Flag,
    Motion,
    MotionComponents,
    Name,
    Position,
    Real,
    SceneModel,
    Velocity,
    key,
)
from periporo.io.schema.bodies import PlanePoint
from periporo.io.schema.ground import Ground, MeshName, RasterFile, Values

MAX_STIFFNESS = 1e20
MAX_FRICTION = 10.0
CLEARED = "its place is not free at the start, but will be in the stage in which it appears"


class ContactModel(SceneModel):
    """What every contact has."""

    friction: Real = key("Coulomb's coefficient of friction", "1", ge=0, le=MAX_FRICTION)
    stiffness: Real | None = key(
        "normal penalty; default: chosen from the material", "N/m^3", default=None, gt=0, le=MAX_STIFFNESS
    )
    damping: Real = key("share of critical damping along the normal", "1", default=0.0, ge=0, le=1)
    stages: tuple[Name, ...] | None = key(
        "stages in which it is present; default all", default=None, min_length=1
    )
    cleared: Flag = key(CLEARED, default=False)


def _kind_of_velocity(value: Any) -> str:
    return "[list]" if isinstance(value, list | tuple) else "[components]"


ConstantOrComponents = Annotated[
    Annotated[Velocity, Tag("[list]")] | Annotated[MotionComponents, Tag("[components]")],
    Discriminator(_kind_of_velocity),
]


class Rotation(SceneModel):
    """A rotation about the obstacle's reference, on top of its other motion; exactly one of angle and rate."""

    axis: Position | None = key("direction of the axis, as a right-handed screw turns (3D)", default=None, vector=True)
    angle: Motion | None = key("angle: a number, {times, values} or {file}; in 2D from x to y", "degrees", default=None)
    rate: Motion | None = key("its rate: a number, {times, values} or {file}", "degrees/s", default=None)

    @model_validator(mode="after")
    def _is_one_kind(self):
        if (self.angle is None) == (self.rate is None):
            raise ValueError("give either angle or rate")
        if self.axis is not None and max(map(abs, self.axis)) < 1e-6:
            raise ValueError("the axis must not be zero")
        return self


class Free(SceneModel):
    """A rigid body that gravity, contact and given forces move in dynamics stages; in 2D it is one metre thick.

    It touches points, and other obstacles with its corners, or all of its circle; of both frictions the smaller counts,
    of both dampings the larger.
    """

    mass: Real | None = key("its mass", "kg", default=None, gt=0, le=1e15)
    density: Real | None = key("its density, in place of mass", "kg/m^3", default=None, gt=0, le=1e6)
    force: MotionComponents | None = key("given force on its centre of mass", "N", default=None)
    velocity: Velocity | None = key("velocity when it appears, default zero", "m/s", default=None, vector=True)
    hold: tuple[Literal["x", "y", "z", "rotation"], ...] = key("components that stay as they are", default=())

    @model_validator(mode="after")
    def _has_a_mass(self):
        if (self.mass is None) == (self.density is None):
            raise ValueError("a free body needs a mass: give either mass or density")
        return self


class _Obstacle(ContactModel):
    """A rigid obstacle. It is where its entry says when it appears, and may move from there in dynamics stages."""

    name: Name | None = key(
        "name under which histories tell its force, torque and power; without, one that moves is obstacle_0 and so on",
        default=None,
    )
    reference: Position | None = key(
        "what torques count about, and rotations turn about; moves with it; default: its centre of mass, of a plane "
        "its point, of a polyline its first vertex, of a terrain the origin", "m", default=None, vector=True,
        place="point",
    )
    velocity: ConstantOrComponents | None = key(
        "its velocity: [vx, vy], or histories by x, y, z", "m/s", default=None, vector=True
    )
    displacement: MotionComponents | None = key(
        "its displacement; what its history did before it appeared is left out", "m", default=None
    )
    acceleration: AccelerationComponents | None = key(
        "its acceleration from rest, such as a record", "m/s^2", default=None
    )
    rotation: Rotation | None = key("its rotation", default=None)

    @model_validator(mode="after")
    def _moves_in_one_way(self):
        kinds = ("velocity", "displacement", "acceleration")
        given = [kind for kind in kinds if getattr(self, kind) is not None]
        if len(given) > 1:
            raise ValueError(f"give at most one of {', '.join(kinds)}; found {' and '.join(given)}")
        if getattr(self, "free", None) is not None:
            given += ["rotation"] if self.rotation is not None else []
            if given:
                raise ValueError(f"a free body moves by itself: leave out {', '.join(given)}, or free")
            if self.reference is not None:
                raise ValueError("torques of a free body count about its centre of mass: leave out reference")
        return self

    @property
    def moves(self) -> bool:
        """Whether it moves at all."""
        ways = (self.velocity, self.displacement, self.acceleration, self.rotation, getattr(self, "free", None))
        return any(way is not None for way in ways)


class Solid(_Obstacle):
    """An obstacle with an inside, which may be free."""

    free: Free | None = key("a body that moves by itself", default=None)


class PlaneContact(_Obstacle):
    """A rigid half-space; points stay on the side to which the normal points."""

    type: Literal["plane"] = key("kind of contact")
    point: Position = key("a point of the surface", "m", vector=True, place="point")
    normal: Position = key("direction out of the obstacle, of any length", "1", vector=True)

    @model_validator(mode="after")
    def _has_a_direction(self):
        if max(map(abs, self.normal)) < 1e-6:
            raise ValueError("the normal must not be zero")
        return self


class BoxContact(Solid):
    """A rigid box; points stay outside."""

    type: Literal["box"] = key("kind of contact")
    lower: Position = key("lower corner", "m", vector=True, place="point")
    upper: Position = key("upper corner", "m", vector=True, place="point")


class CylinderContact(Solid):
    """A rigid circular cylinder along an axis (3D); points stay outside."""

    type: Literal["cylinder"] = key("kind of contact")
    base: Position = key("centre of the end face with the lowest coordinate", "m", vector=True, place="point")
    axis: Axis = key("direction of the cylinder's axis")
    radius: Real = key("radius", "m", gt=0, le=MAX_LENGTH)
    height: Real = key("length along the axis", "m", gt=0, le=MAX_LENGTH)


class DiscContact(Solid):
    """A rigid disc (2D); points stay outside."""

    type: Literal["disc"] = key("kind of contact")
    center: Position = key("centre", "m", vector=True, place="point")
    radius: Real = key("radius", "m", gt=0, le=MAX_LENGTH)


class SphereContact(Solid):
    """A rigid sphere (3D); points stay outside."""

    type: Literal["sphere"] = key("kind of contact")
    center: Position = key("centre", "m", vector=True, place="point")
    radius: Real = key("radius", "m", gt=0, le=MAX_LENGTH)


class MeshContact(Solid):
    """The inside of a closed surface of triangles (3D), from a file: .stl, .ply or .obj (needs trimesh)."""

    type: Literal["mesh"] = key("kind of contact")
    file: MeshName = key("file name, relative to the scene's folder")
    _origin: tuple[float, ...] = PrivateAttr(default=())


class _Pointed(Solid):
    """What stands on its tip, with a shaft above it."""

    tip: Position = key("its lowest point, the tip", "m", vector=True, place="point")
    width: Real = key("width, or diameter, of the shaft", "m", gt=0, le=MAX_LENGTH)
    angle: Real = key("angle between opposite sides at the tip", "degrees", ge=1, le=179)
    length: Real = key("length from the tip to the top", "m", gt=0, le=MAX_LENGTH)

    @property
    def taper(self) -> float:
        """Length from the tip to where the shaft begins, m."""
        return 0.5 * self.width / math.tan(math.radians(0.5 * self.angle))

    @model_validator(mode="after")
    def _has_a_shaft(self):
        if not self.taper < self.length:
            raise ValueError(f"its tip alone is {self.taper:.4g} m long; make the length greater, or the angle")
        return self


class WedgeContact(_Pointed):
    """A rigid wedge with its tip down along y, and a shaft above it: a sheet pile (2D); points stay outside."""

    type: Literal["wedge"] = key("kind of contact")


class ConeContact(_Pointed):
    """A rigid cone with its tip down along z, and a shaft above it: a pile, a penetrometer (3D); points stay outside.
    """

    type: Literal["cone"] = key("kind of contact")


class PolylineContact(_Obstacle):
    """Rigid ground to the right of a polyline (2D): points stay on its left along its vertices.

    Its first and last segment go on forever, unless the last vertex is the first.
    """

    type: Literal["polyline"] = key("kind of contact")
    vertices: tuple[PlanePoint, ...] = key(
        "points [x, y] in order", "m", place="point", min_length=2, max_length=10_000
    )

    @model_validator(mode="after")
    def _advances(self):
        for k, (start, end) in enumerate(zip(self.vertices, self.vertices[1:], strict=False)):
            if start == end:
                raise ValueError(f"vertices {k} and {k + 1} are the same point; remove one")
        return self


def _number_or_raster(value: Any) -> str:
    return "[raster]" if isinstance(value, str | dict | RasterFile) else "[number]"


NumberOrRaster = Annotated[
    Annotated[Real, Field(ge=0, le=MAX_FRICTION), Tag("[number]")] | Annotated[Values, Tag("[raster]")],
    Discriminator(_number_or_raster),
]


class TerrainContact(_Obstacle):
    """Rigid ground from a raster of heights, or a surface of triangles (3D).

    A raster goes on beyond its border with the heights of its border. The outside of an open surface of triangles is
    where its upward side is, against gravity; that of a closed one is outside.
    """

    type: Literal["terrain"] = key("kind of contact")
    ground: Ground = key("the file, or {file, ...}", "m")
    friction: NumberOrRaster = key(  # type: ignore[assignment] # wider than that of others
        "Coulomb's coefficient of friction, or a raster of it: a file, or {file, ...}", "1"
    )
