"""Input models of grounds and solids from files: rasters, and surfaces of triangles."""

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, PrivateAttr, model_validator

from periporo.io.schema.base import Coordinate, Real, SceneModel, key
from periporo.io.schema.files import ExistingFile

RASTERS = (".asc", ".npy", ".tif", ".tiff")
MESHES = (".stl", ".ply", ".obj")
_MEANING = ("corner", "cell", "first_row", "registration")


def _file_alone(value: Any) -> Any:
    return {"file": value} if isinstance(value, str) else value


class RasterFile(SceneModel):
    """Values on a grid along x and y: .asc (ESRI ASCII grid), .tif (GeoTIFF, needs rasterio) or .npy.

    A file alone, or with what it does not tell itself: a .npy file needs corner, cell, first_row and registration.
    Values are linear on the two triangles between four neighbours.
    """

    file: ExistingFile = key("file name, relative to the scene's folder")
    corner: tuple[Coordinate, Coordinate] | None = key(
        "x and y of the lower left cell (.npy): of its corner, or of its value, see registration", "m", default=None
    )
    cell: tuple[Real, Real] | None = key("distance of values along x and y (.npy)", "m", default=None)
    first_row: Literal["north", "south"] | None = key("where the first row of the file lies (.npy)", default=None)
    registration: Literal["centre", "corner"] | None = key(
        "where in its cell a value stands (.npy): in its middle, or at the corner that `corner` names", default=None
    )
    nodata: Real | None = key("what stands for no value, beside NaN (.npy)", default=None)

    kinds: ClassVar[tuple[str, ...]] = RASTERS
    of_heights: ClassVar[bool] = False
    _origin: tuple[float, ...] = PrivateAttr(default=())
    """What places are counted from, see `io.geometry.origin`; m."""

    @model_validator(mode="after")
    def _tells_what_the_file_does_not(self):
        suffix = Path(self.file).suffix.lower()
        if suffix not in self.kinds:
            raise ValueError(f"unknown kind of file '{suffix}'; allowed: {', '.join(self.kinds)}")
        given = [name for name in _MEANING if getattr(self, name) is not None]
        if suffix == ".npy" and len(given) < len(_MEANING):
            missing = ", ".join(name for name in _MEANING if name not in given)
            raise ValueError(f"a .npy file holds numbers only, so say what they mean: {missing} missing")
        if suffix != ".npy" and (given or self.nodata is not None):
            raise ValueError(f"a {suffix} file tells this itself; leave out {', '.join([*given, 'nodata'][:1])}")
        if self.cell is not None and not min(self.cell) > 0.0:
            raise ValueError("cell: both distances must be greater than 0")
        return self


class HeightFile(RasterFile):
    """A raster of heights, see RasterFile."""

    of_heights: ClassVar[bool] = True


class GroundFile(HeightFile):
    """A raster of heights, see RasterFile, or a surface of triangles: .stl, .ply or .obj (needs trimesh)."""

    kinds: ClassVar[tuple[str, ...]] = (*RASTERS, *MESHES)

    @property
    def is_mesh(self) -> bool:
        """Whether it is a surface of triangles."""
        return Path(self.file).suffix.lower() in MESHES


def mesh_file(name: str) -> str:
    """The name of a file of triangles. Raises ValueError for another kind of file."""
    suffix = Path(name).suffix.lower()
    if suffix not in MESHES:
        raise ValueError(f"unknown kind of file '{suffix}'; allowed: {', '.join(MESHES)}")
    return name


MeshName = Annotated[ExistingFile, AfterValidator(mesh_file)]
Values = Annotated[RasterFile, BeforeValidator(_file_alone, json_schema_input_type=str | RasterFile)]
Heights = Annotated[HeightFile, BeforeValidator(_file_alone, json_schema_input_type=str | HeightFile)]
Ground = Annotated[GroundFile, BeforeValidator(_file_alone, json_schema_input_type=str | GroundFile)]
