"""Checks of what a scene's files hold: that they can be read, and that grounds and soil fit each other."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from periporo.errors import Path, Problem, place_text
from periporo.io.geometry.lattice import CHUNK, Lattice
from periporo.io.geometry.layers import Layer, layer_of
from periporo.io.geometry.meshes import Mesh as Surface
from periporo.io.geometry.meshes import read_mesh
from periporo.io.geometry.points import PointFileError, read_points
from periporo.io.geometry.rasters import GroundFileError, Raster, read_raster
from periporo.io.geometry.shapes import surface
from periporo.io.schema.bodies import Mesh, Points
from periporo.io.schema.bodies import Raster as RasterShape
from periporo.io.schema.ground import RasterFile
from periporo.io.schema.obstacles import MAX_FRICTION, MeshContact, TerrainContact
from periporo.io.schema.scene import SceneInput

_APART = 10.0  # sizes of a surface from all bodies, beyond which it cannot be meant


def file_problems(scene: SceneInput) -> Iterator[Problem]:
    """Files of bodies, obstacles and water that cannot be used, and layers that hold no soil."""
    for path, read in _readings(scene):
        try:
            read()
        except (PointFileError, GroundFileError) as error:
            yield Problem(path, str(error))
            return
    yield from _table_problems(scene)
    for k, body in enumerate(scene.bodies):
        if isinstance(body.shape, RasterShape):
            yield from _layer_problems(("bodies", k, "shape"), layer_of(body.shape), scene.spacing)


def _readings(scene: SceneInput) -> Iterator[tuple[Path, Callable[[], object]]]:
    """Path in the scene, and function that reads, of every file of bodies, obstacles and water."""
    for k, body in enumerate(scene.bodies):
        path, shape = ("bodies", k, "shape"), body.shape
        match shape:
            case Points():
                yield (*path, "file"), partial(read_points, shape.file, scene.dimension, cells=shape.cells)
            case Mesh():
                yield (*path, "file"), partial(surface, shape)
            case RasterShape():
                for name in ("ground", "thickness", "surface"):
                    model = getattr(shape, name)
                    if model is not None:
                        yield (*path, name), partial(read_raster, model)
    for k, contact in enumerate(scene.contacts):
        if isinstance(contact, MeshContact):
            yield ("contacts", k, "file"), partial(read_mesh, contact.file, closed=True)
        if isinstance(contact, TerrainContact):
            ground = contact.ground
            read = partial(read_mesh, ground.file) if ground.is_mesh else partial(read_raster, ground)
            yield ("contacts", k, "ground"), read
            if isinstance(contact.friction, RasterFile):
                yield ("contacts", k, "friction"), partial(_read_friction, contact.friction)
    if scene.pore_water is not None and scene.pore_water.phreatic_surface is not None:
        yield ("pore_water", "phreatic_surface"), partial(read_raster, scene.pore_water.phreatic_surface)


def _read_friction(model: RasterFile) -> None:
    """Raise GroundFileError if there is a place without a coefficient of friction, for soil may come to any."""
    raster = read_raster(model)
    bad = ~((raster.level >= 0.0) & (raster.level <= MAX_FRICTION))
    if bad.any():
        i, j = _first(bad)
        value = raster.level[j, i]
        has = "has no value (NODATA)" if np.isnan(value) else f"is {value:.6g}"
        at = _at(raster, raster.place(i, j))
        raise GroundFileError(f"the friction {has} {at}; give it everywhere, from 0 to {MAX_FRICTION:g}")


def _first(places: np.ndarray) -> tuple[int, int]:
    """Column and row of the first of the marked places (rows, columns) of a raster."""
    j, i = np.argwhere(places)[0]
    return int(i), int(j)


def _table_problems(scene: SceneInput) -> Iterator[Problem]:
    """A water table that is not known everywhere."""
    table = None if scene.pore_water is None else scene.pore_water.phreatic_surface
    if table is None:
        return
    raster, path = read_raster(table), ("pore_water", "phreatic_surface")
    bare = np.isnan(raster.level)
    if bare.any():
        at = _at(raster, raster.place(*_first(bare)))
        message = f"has {int(bare.sum())} places without a value (NODATA), the first {at}"
        yield Problem(path, f"{message}; water needs a level everywhere: fill them, or cut the raster")


def _layer_problems(path: Path, layer: Layer, spacing: float) -> Iterator[Problem]:
    places = layer.places()
    thickness, base = layer.thickness(places), layer.ground.at(places)
    top = "surface" if layer.top_is_height else "thickness"
    lowest = int(np.argmin(thickness))
    if thickness[lowest] < -0.5 * spacing:
        depth, place = -thickness[lowest], places[lowest]
        yield Problem((*path, top), f"the soil is {depth:.3g} m below the ground {_at(layer.top, place)}")
        return
    bare = (thickness > 0.5 * spacing) & np.isnan(base)
    if bare.any():
        place = places[int(np.argmax(bare))]
        yield Problem((*path, "ground"), f"has no value (NODATA) under soil {_at(layer.ground, place)}")
        return
    if not (thickness >= 0.5 * spacing).any():
        yield Problem((*path, top), f"there is no soil: it is nowhere as thick as half a spacing ({0.5 * spacing:g} m)")


def _at(raster: Raster, place) -> str:
    return f"at ({place[0]:.9g}, {place[1]:.9g}), {raster.row_and_column(place)} of the file"


def ground_problems(scene: SceneInput, lattices: list[Lattice], origin: np.ndarray) -> Iterator[Problem]:
    """Soil that no ground is under, and release surfaces that cross themselves; `scene` is relative to `origin`."""
    for k, contact in enumerate(scene.contacts):
        if not isinstance(contact, TerrainContact):
            continue
        path: Path = ("contacts", k, "ground")
        if contact.ground.is_mesh:
            yield from _elsewhere(path, read_mesh(contact.ground.file, contact.ground._origin), lattices, origin)
        else:
            yield from _uncovered(path, read_raster(contact.ground), lattices, origin)
    for k, lattice in enumerate(lattices):
        shape = lattice.body.shape
        if isinstance(shape, Mesh):
            mesh = surface(shape)
            for start in range(0, lattice.size, CHUNK):
                index = np.arange(start, min(start + CHUNK, lattice.size))
                places = lattice.centres(np.stack(np.unravel_index(index, lattice.counts), axis=1))
                bad = (mesh.count(places) | 1) != 1
                if bad.any():
                    at = place_text(places[int(np.argmax(bad))], origin, 4)
                    yield Problem(("bodies", k, "shape", "file"), f"the surface crosses itself around ({at}); mend it")
                    break


def _elsewhere(path: Path, mesh: Surface, lattices: list[Lattice], origin) -> Iterator[Problem]:
    """A remark on a surface that is much farther from all bodies than it is large."""
    corners = mesh.tree.corners
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    size = float(np.linalg.norm(upper - lower))
    away = [np.maximum(np.maximum(body.lower - upper, lower - body.upper), 0.0) for body in lattices]
    nearest = int(np.argmin([np.linalg.norm(way) for way in away]))
    distance = float(np.linalg.norm(away[nearest]))
    if distance > _APART * max(size, lattices[nearest].spacing):
        middle = place_text(0.5 * (lower + upper), origin, 6)
        yield Problem(
            path,
            f"the surface around ({middle}) is {distance:.4g} m from the body '{lattices[nearest].body.name}' and only "
            f"{size:.4g} m large: they are not in the same coordinates",
        )


def _uncovered(path: Path, ground: Raster, lattices: list[Lattice], origin) -> Iterator[Problem]:
    """A remark on the first point of a body that stands over no value of a raster, or beyond its border."""
    for lattice in lattices:
        for _, position, *_ in lattice.chunks():
            x, reach = position[:, :2], ground.cell
            beyond = ((x < ground.corner - reach) | (x > ground.far_corner + reach)).any(axis=1)
            bare = np.isnan(ground.at(position)) | beyond
            if bare.any():
                row = int(np.argmax(bare))
                where = "ends before it"
                if not beyond[row]:
                    where = f"has no value (NODATA) there, {ground.row_and_column(position[row])} of the file"
                message = (
                    f"the body '{lattice.body.name}' has a point at ({place_text(position[row], origin, 4)}), and the "
                    f"ground {where}; give one that reaches under it"
                )
                yield Problem(path, message)
                break
