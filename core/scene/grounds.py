"""Rasters and surfaces of triangles of a scene, read by one rank of each node and shared by all of it."""

from functools import partial

import numpy as np

from periporo.core.numerics.meshes import TriangleTree
from periporo.core.ranks.shared import once_per_node
from periporo.io.geometry.meshes import Mesh, forget_meshes, keep_mesh, read_mesh
from periporo.io.geometry.rasters import Raster, forget_rasters, keep_raster, read_raster
from periporo.io.schema.bodies import Mesh as MeshShape
from periporo.io.schema.bodies import Raster as RasterShape
from periporo.io.schema.ground import RasterFile
from periporo.io.schema.obstacles import MeshContact, TerrainContact


def share_grounds(scene, comm) -> None:
    """Have `read_raster` and `read_mesh` give what the node holds once, for all files of a scene; collective.

    Places are counted from the scene's origin.
    """
    rasters, meshes = _files(scene)
    if not rasters and not meshes:
        return
    levels = [once_per_node(comm, partial(_read_raster, model)) for model in rasters]
    surfaces = [once_per_node(comm, partial(_read_mesh, *what)) for what in meshes]
    forget_rasters()  # in the memory of one rank
    forget_meshes()
    for model, (level, corner, cell, north) in zip(rasters, levels, strict=True):
        keep_raster(model, Raster(level, corner, cell, bool(north[0])))
    for what, (*tree, closed) in zip(meshes, surfaces, strict=True):
        keep_mesh(*what, Mesh(TriangleTree(*tree), bool(closed[0])))


def _read_raster(model: RasterFile) -> list[np.ndarray]:
    raster = read_raster(model)
    return [raster.level, raster.corner, raster.cell, np.array([raster.north_first])]


def _read_mesh(name: str, origin: tuple[float, ...]) -> list[np.ndarray]:
    mesh = read_mesh(name, origin)
    tree = mesh.tree
    return [tree.corners, tree.triangles, tree.borders, tree.boxes, np.array([mesh.closed])]


def _files(scene) -> tuple[list[RasterFile], list[tuple[str, tuple[float, ...]]]]:
    """Models of rasters, and names and origins of meshes."""
    rasters, meshes = [], []
    for body in scene.bodies:
        if isinstance(body.shape, RasterShape):
            rasters += [m for m in (body.shape.ground, body.shape.thickness, body.shape.surface) if m is not None]
        elif isinstance(body.shape, MeshShape):
            meshes.append((body.shape.file, body.shape._origin))
    for contact in scene.contacts:
        if isinstance(contact, MeshContact):
            meshes.append((contact.file, contact._origin))
        if isinstance(contact, TerrainContact):
            if contact.ground.is_mesh:
                meshes.append((contact.ground.file, contact.ground._origin))
            else:
                rasters.append(contact.ground)
            if isinstance(contact.friction, RasterFile):
                rasters.append(contact.friction)
    if scene.pore_water is not None and scene.pore_water.phreatic_surface is not None:
        rasters.append(scene.pore_water.phreatic_surface)
    return rasters, list(dict.fromkeys(meshes))
