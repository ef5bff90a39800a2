"""Input models of materials, shapes, bodies and the stress that they start with."""

import contextlib
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, PrivateAttr, ValidationError, ValidationInfo, model_validator

from periporo.io.schema.base import (
    MAX_LENGTH,
    Axis,
    Coordinate,
    Flag,
    Name,
    Position,
    Pressure,
    Real,
    SceneModel,
    Velocity,
    key,
)
from periporo.io.schema.fields import ParameterField, is_field, read_field
from periporo.io.schema.files import ExistingFile
from periporo.io.schema.ground import Heights, MeshName, Values
from periporo.materials import registry


class MaterialInput(SceneModel):
    """A constitutive law by name and its parameters, which the law itself validates.

    A parameter that varies from place to place is a mapping with the key `field` in place of a number.
    """

    model_config = ConfigDict(extra="allow")

    model: Name = key("name of an installed law, such as elastic")

    @model_validator(mode="before")
    @classmethod
    def _fields_are_read(cls, data: Any, info: ValidationInfo) -> Any:
        """Fields as models; those that are wrong stay as they are, for `material_problems` says so."""
        if not isinstance(data, dict):
            return data
        read = dict(data)
        for name, value in data.items():
            if is_field(value):
                with contextlib.suppress(ValidationError):
                    read[name] = read_field(value, (info.context or {}).get("folder", "."))
        return read

    @property
    def parameters(self) -> dict[str, Any]:
        """The law's own keys that are the same everywhere."""
        return {name: value for name, value in (self.model_extra or {}).items() if not is_field(value)}

    @property
    def fields(self) -> dict[str, ParameterField]:
        """The law's own keys that vary from place to place."""
        return {name: value for name, value in (self.model_extra or {}).items() if is_field(value)}

    def create(self, **varied: float):
        """The material object, with values of what varies."""
        return registry.load(self.model)(**self.parameters, **varied)


class Box(SceneModel):
    """Rectangle or cuboid along the axes."""

    type: Literal["box"] = key("shape")
    lower: Position = key("lower corner", "m", vector=True, place="point")
    upper: Position = key("upper corner", "m", vector=True, place="point")


class Disc(SceneModel):
    """Disc (2D)."""

    type: Literal["disc"] = key("shape")
    center: Position = key("centre", "m", vector=True, place="point")
    radius: Real = key("radius", "m", gt=0, le=MAX_LENGTH)


class Cylinder(SceneModel):
    """Circular cylinder along an axis (3D)."""

    type: Literal["cylinder"] = key("shape")
    base: Position = key("centre of the end face with the lowest coordinate", "m", vector=True, place="point")
    axis: Axis = key("direction of the cylinder's axis")
    radius: Real = key("radius", "m", gt=0, le=MAX_LENGTH)
    height: Real = key("length along the axis", "m", gt=0, le=MAX_LENGTH)


class Sphere(SceneModel):
    """Sphere (3D)."""

    type: Literal["sphere"] = key("shape")
    center: Position = key("centre", "m", vector=True, place="point")
    radius: Real = key("radius", "m", gt=0, le=MAX_LENGTH)


PlanePoint = tuple[Coordinate, Coordinate]


class Polygon(SceneModel):
    """Inside of a closed polygon in the x-y plane by the even-odd rule; in 3D extruded along z."""

    type: Literal["polygon"] = key("shape")
    vertices: tuple[PlanePoint, ...] = key(
        "corners [x, y] in order", "m", place="point", min_length=3, max_length=10_000
    )
    extrude: PlanePoint | None = key("[lowest, highest] z, in 3D only", "m", place="z", default=None)

    @model_validator(mode="after")
    def _has_an_inside(self):
        (x0, y0), *others = self.vertices
        x1, y1 = max(others, key=lambda v: abs(v[0] - x0) + abs(v[1] - y0))
        size = abs(x1 - x0) + abs(y1 - y0)
        if all(abs((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)) <= 1e-12 * size**2 for x, y in others):
            raise ValueError("the vertices lie on one line; a polygon needs an inside")
        return self


class Points(SceneModel):
    """Points from a file: a table with the columns x, y, z and volume (.csv, .xyz), or .vtk, .vtu, .vtp (needs vtk).

    The middles and volumes of the cells of a mesh: .msh, .inp, .med, .bdf, .xdmf (needs meshio). A table begins with
    the names of its columns, in any order and case, between commas, semicolons or blanks; other columns are left.
    """

    type: Literal["points"] = key("shape")
    file: ExistingFile = key("file name, relative to the scene's folder")
    cells: Flag = key("of .vtk or .vtu, take the cells in place of the points (needs meshio)", default=False)
    _origin: tuple[float, ...] = PrivateAttr(default=())
    """What the coordinates in the file are counted from, see `io.geometry.origin`; m."""


class Raster(SceneModel):
    """Soil between a ground and its own surface, both of them rasters (3D); gravity acts along z."""

    type: Literal["raster"] = key("shape")
    ground: Heights = key("heights of what it lies on", "m")
    thickness: Values | None = key("height above the ground; none where there is no value", "m", default=None)
    surface: Heights | None = key("heights of its surface, in place of thickness", "m", default=None)
    conform: Flag = key(
        "begin each column of points on the ground, so that the lattice follows the slope; else the lattice is level, "
        "and points whose cells cut the ground are left out",
        default=True,
    )

    @model_validator(mode="after")
    def _has_a_top(self):
        if (self.thickness is None) == (self.surface is None):
            raise ValueError("give either thickness or surface")
        return self


class Mesh(SceneModel):
    """The inside of a closed surface of triangles (3D), from a file: .stl, .ply or .obj (needs trimesh)."""

    type: Literal["mesh"] = key("shape")
    file: MeshName = key("file name, relative to the scene's folder")
    _origin: tuple[float, ...] = PrivateAttr(default=())


Shape = Annotated[Box | Disc | Cylinder | Sphere | Polygon | Points | Raster | Mesh, Field(discriminator="type")]


class Layer(SceneModel):
    """The material above a level, up to the next layer."""

    above: Coordinate = key("level along the direction opposite to gravity", "m", place="level")
    material: Name = key("name of the material")


class Body(SceneModel):
    """A shape filled with points of a material, or of several in layers.

    Bodies that meet and bond share one lattice, that of the first of them, so that there is no seam between them: each
    point belongs to the body that holds it, on a common edge to the first.
    """

    name: Name = key("name of the body")
    material: Name = key("name of its material; below the layers, if there are any")
    shape: Shape = key("the region that it fills")
    velocity: Velocity | None = key("initial velocity, default zero", "m/s", default=None, vector=True)
    jitter: Real = key(
        "largest random shift of a point along each axis", "spacings", default=0.0, ge=0, le=0.3
    )
    lattice: Literal["shared", "own", "rings"] = key(
        "continue the lattice of the bodies that it meets and bonds with, have one of its own, or, a disc or a "
        "cylinder, have its points on rings, which follow its outline", default="shared"
    )
    layers: tuple[Layer, ...] = key("other materials by level, ascending", default=(), max_length=1000)

    @model_validator(mode="after")
    def _rings_are_round(self):
        if self.lattice == "rings" and not isinstance(self.shape, Disc | Cylinder):
            raise ValueError(f"lattice: rings are for a disc or a cylinder, not for a {self.shape.type}")
        return self

    @model_validator(mode="after")
    def _layers_ascend(self):
        for lower, upper in zip(self.layers, self.layers[1:], strict=False):
            if upper.above <= lower.above:
                raise ValueError(f"layers must ascend, but 'above: {upper.above}' follows {lower.above}")
        return self


class GeostaticStress(SceneModel):
    """Stress from the weight above; horizontal stress is K0 times the vertical one."""

    type: Literal["geostatic"] = key("kind of initial stress")
    K0: Real = key("horizontal over vertical stress", "1", default=0.5, ge=0, le=10)
    surface: Coordinate | None = key(
        "level of the free surface against gravity; default: the top of each body", "m", default=None, place="level"
    )


class StressComponents(SceneModel):
    """Components of a symmetric tensor, tension positive; zero where not given."""

    xx: Pressure = key("component xx", "Pa", default=0.0)
    yy: Pressure = key("component yy", "Pa", default=0.0)
    zz: Pressure = key("component zz", "Pa", default=0.0)
    xy: Pressure = key("component xy", "Pa", default=0.0)
    yz: Pressure = key("component yz, in 3D only", "Pa", default=0.0)
    xz: Pressure = key("component xz, in 3D only", "Pa", default=0.0)


class UniformStress(SceneModel):
    """The same effective stress everywhere."""

    type: Literal["uniform"] = key("kind of initial stress")
    components: StressComponents = key("tension positive", "Pa")


InitialStress = Annotated[GeostaticStress | UniformStress, Field(discriminator="type")]
