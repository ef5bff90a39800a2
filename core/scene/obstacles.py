"""From the rigid obstacles of a scene to contacts: surfaces, motions, and what is told of them."""

import math

import numpy as np

from periporo.contact import solids, surfaces
from periporo.contact.free import Free
from periporo.contact.motion import Motion, Prescribed
from periporo.contact.reaction import Feelers, Reaction
from periporo.contact.rigid import FAR, RigidContact
from periporo.contact.search import Search
from periporo.contact.terrain import FrictionMap, HeightField, TriangleSurface
from periporo.core.numerics.histories import Course
from periporo.core.scene.boundaries import corrected, over_time
from periporo.io.geometry.meshes import read_mesh
from periporo.io.geometry.rasters import read_raster
from periporo.io.schema.ground import RasterFile


def build_obstacle(
    scene, model, number: int, sim, stiffness: float, modulus: float | None, search: Search
) -> RigidContact:
    """The contact with the obstacle of entry `number`; `stiffness` N/m^3, of a `modulus` Pa or None if it was given.

    All share a `search`.
    """
    area = scene.spacing ** (scene.dimension - 1)
    free = getattr(model, "free", None)
    motion: Motion | None = None
    feelers, about = None, reference(model, scene.dimension)
    if free is not None:
        solid = solid_of(model, scene.dimension)
        body, about = _free_motion(scene, free, solid), solid.centre
        share = stiffness * solid.size ** (scene.dimension - 1) / len(solid.places)
        feelers = Feelers(solid.places, solid.roundness, share, body.mass / len(solid.places), body.softness())
        motion = body
    elif model.moves:
        motion = _prescribed(model, about)
    reaction = None
    if model.name is not None or motion is not None:
        reaction = Reaction(model.name or f"obstacle_{number}", about, motion)
    return RigidContact(
        str(number), surface_of(model, sim), spacing=scene.spacing, skin=sim.largest_skin, stiffness=stiffness * area,
        friction=_friction(model), damping=model.damping, motion=motion, reaction=reaction, feelers=feelers,
        search=search, modulus=modulus,
    )  # fmt: skip


def _friction(model) -> float | FrictionMap:
    if isinstance(model.friction, RasterFile):
        raster = read_raster(model.friction)
        return FrictionMap(raster.level, raster.corner, raster.cell)
    return float(model.friction)


def surface_of(model, sim) -> surfaces.Surface:
    """The surface of an obstacle where its entry says."""
    match model.type:
        case "plane":
            return surfaces.Plane(model.point, model.normal)
        case "box":
            return surfaces.Box(model.lower, model.upper)
        case "disc" | "sphere":
            return surfaces.Disc(model.center, model.radius)
        case "cylinder":
            return surfaces.Cylinder(model.base, "xyz".index(model.axis), model.radius, model.height)
        case "polyline":
            return surfaces.Polyline(model.vertices)
        case "wedge":
            corners = np.array(model.tip) + _corners(model)
            return surfaces.Polyline(np.concatenate([corners[::-1], corners[-1:]]))  # clockwise: points stay outside
        case "cone":
            return surfaces.Cone(model.tip, _profile(model))
        case "mesh":
            reach = 0.5 * sim.spacing
            return TriangleSurface(read_mesh(model.file, model._origin).tree, reach=reach, within=FAR * reach)
        case "terrain":
            reach, ground = 0.5 * sim.spacing, model.ground
            near = {"reach": reach, "within": FAR * reach}
            if ground.is_mesh:
                return TriangleSurface(read_mesh(ground.file, ground._origin).tree, **near)
            raster = read_raster(ground)
            return HeightField(raster.level, raster.corner, raster.cell, **near)
        case other:
            raise ValueError(f"no surface for a contact of type '{other}'")


def solid_of(model, dimension: int) -> solids.Solid:
    """The solid of an obstacle that may be free."""
    match model.type:
        case "box":
            return solids.block(np.array(model.lower), np.array(model.upper))
        case "disc" | "sphere":
            return solids.ball(np.array(model.center), model.radius)
        case "cylinder":
            profile = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * [model.radius, model.height]
            return solids.revolved(np.array(model.base), "xyz".index(model.axis), profile)
        case "wedge":
            return solids.polygon(np.array(model.tip) + _corners(model))
        case "cone":
            return solids.revolved(np.array(model.tip), 2, _profile(model))
        case "mesh":
            tree = read_mesh(model.file, model._origin).tree
            return solids.enclosed(np.array(tree.corners), np.array(tree.triangles))
        case other:
            raise ValueError(f"a contact of type '{other}' has no mass")


def reference(model, dimension: int) -> np.ndarray:
    """What the torque on an obstacle counts about when it appears, (d,) m."""
    if model.reference is not None:
        return np.array(model.reference)
    match model.type:
        case "plane":
            return np.array(model.point)
        case "polyline":
            return np.array(model.vertices[0])
        case "terrain":
            return np.zeros(dimension)
        case _:
            return solid_of(model, dimension).centre


def _corners(model):
    """Corners (5, 2) m of a wedge above its tip, counterclockwise."""
    half, shaft = 0.5 * model.width, model.taper
    return np.array([[0.0, 0.0], [half, shaft], [half, model.length], [-half, model.length], [-half, shaft]])


def _profile(model):
    """Radius and height above the tip (n, 2) m of a cone."""
    half = 0.5 * model.width
    return np.array([[0.0, 0.0], [half, model.taper], [half, model.length], [0.0, model.length]])


def courses(model) -> dict[int, Course]:
    """Courses of displacement along the axes along which an obstacle is driven."""
    for kind in ("velocity", "displacement", "acceleration"):
        components = getattr(model, kind)
        if components is None:
            continue
        if isinstance(components, tuple):
            return {axis: Course(kind, [0.0], [v]) for axis, v in enumerate(components)}
        histories = components.histories()
        values = {a: np.array(h.values) for a, h in histories.items()}
        if kind == "acceleration":
            values = {a: corrected(components.baseline, h.times, h.values) for a, h in histories.items()}
        return {"xyz".index(a): Course(kind, h.times, values[a]) for a, h in histories.items()}
    return {}


def _prescribed(model, about) -> Motion:
    rotation = model.rotation
    if rotation is None:
        return Prescribed(courses(model), about)
    history = rotation.angle or rotation.rate
    kind = "displacement" if rotation.angle else "velocity"
    angle = Course(kind, history.times, [math.radians(v) for v in history.values])
    return Prescribed(courses(model), about, angle, rotation.axis)


def _free_motion(scene, free, solid) -> Free:
    density = free.density if free.density is not None else free.mass / solid.volume
    forces = {} if free.force is None else free.force.histories()
    given = {"xyz".index(a): over_time(h) for a, h in forces.items()}
    held = ["xyz".index(name) if name in "xyz" else name for name in free.hold]
    return Free(
        solid.centre, density * solid.volume, density * solid.inertia, solid.radius, scene.vector(scene.gravity),
        force=given, held=held, velocity=scene.vector(free.velocity),
    )  # fmt: skip
