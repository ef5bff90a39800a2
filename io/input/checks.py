"""What no single key can tell: names exist, vectors suit the dimension, stages have what they need."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from periporo.core.numerics.histories import drift
from periporo.errors import Path, Problem, choice
from periporo.io.geometry.checks import geometry_problems
from periporo.io.input.images import image_problems
from periporo.io.input.rings import ring_problems
from periporo.io.input.water import water_problems
from periporo.io.schema.base import AccelerationComponents, MotionComponents, Region, SceneModel
from periporo.io.schema.bodies import Body, Polygon, Raster, StressComponents
from periporo.io.schema.contacts import Absorb, Boundary, Tie, Traction, WaterAtFaces
from periporo.io.schema.obstacles import Free, Rotation, TerrainContact
from periporo.io.schema.scene import SceneInput
from periporo.io.schema.stages import STILL
from periporo.materials import registry

_DRIFT = 0.05  # of the largest velocity, or displacement, that a record may leave
_ONLY_IN_2D = ("disc", "polyline", "wedge")
_ONLY_IN_3D = ("cylinder", "sphere", "raster", "mesh", "terrain", "cone")


def scene_problems(scene: SceneInput) -> list[Problem]:
    """Contradictions within a scene whose parts are valid each for itself."""
    problems = [*_dimension_problems(scene), *_order_problems(scene), *_name_problems(scene)]
    problems += [*_gravity_problems(scene), *_motion_problems(scene), *_strength_problems(scene)]
    problems += [*_construction_problems(scene), *water_problems(scene), *_sleep_problems(scene)]
    problems += [*ring_problems(scene), *image_problems(scene)]
    return problems or list(geometry_problems(scene))


def _parts(value: Any, path: Path = ()) -> Iterator[tuple[Path, SceneModel]]:
    """Every model within a scene, with its path."""
    if isinstance(value, SceneModel):
        yield path, value
        for name in type(value).model_fields:
            yield from _parts(getattr(value, name), (*path, name))
    elif isinstance(value, dict):
        for name, entry in value.items():
            yield from _parts(entry, (*path, name))
    elif isinstance(value, tuple) and value and not isinstance(value[0], float):
        for index, entry in enumerate(value):
            yield from _parts(entry, (*path, index))


def _dimension_problems(scene: SceneInput) -> Iterator[Problem]:
    d = scene.dimension
    for path, part in _parts(scene):
        for name, info in type(part).model_fields.items():
            value = getattr(part, name)
            extra = info.json_schema_extra
            if isinstance(extra, dict) and extra.get("vector") and isinstance(value, tuple) and len(value) != d:
                yield Problem(
                    (*path, name), f"must have {d} components (the scene's dimension), not {len(value)}"
                )
        kind = getattr(part, "type", None)
        if kind in (_ONLY_IN_3D if d == 2 else _ONLY_IN_2D):
            yield Problem((*path, "type"), f"a {kind} exists only in {5 - d} dimensions, the scene has {d}")
        if isinstance(part, Polygon) and (part.extrude is None) == (d == 3):
            rule = (
                "needs 'extrude: [z0, z1]' in 3 dimensions"
                if d == 3
                else "must not have 'extrude' in 2 dimensions"
            )
            yield Problem(path, f"a polygon {rule}")
        if isinstance(part, Rotation) and part.axis is None and d == 3:
            yield Problem((*path, "axis"), "a rotation in space needs the direction of its axis; give [x, y, z]")
        if d == 2:
            yield from _out_of_plane(path, part)
    for k, point in enumerate(scene.monitor.points):
        if len(point) != d:
            yield Problem(("monitor", "points", k), f"must have {d} components (the scene's dimension)")


def _out_of_plane(path: Path, part: SceneModel) -> Iterator[Problem]:
    """Entries along z in a plane scene."""
    message = "there is no z direction in 2 dimensions"
    if isinstance(part, Boundary) and part.fix and "z" in part.fix:
        yield Problem((*path, "fix"), message)
    if isinstance(part, Tie) and "z" in part.components:
        yield Problem((*path, "components"), message)
    if isinstance(part, Rotation) and part.axis is not None:
        yield Problem((*path, "axis"), "in 2 dimensions all turns from x to y; leave out the axis")
    if isinstance(part, Free) and "z" in part.hold:
        yield Problem((*path, "hold"), message)
    if isinstance(part, MotionComponents) and part.z is not None:
        yield Problem((*path, "z"), message)
    if isinstance(part, Absorb | Traction | WaterAtFaces) and part.side is not None and part.side[0] == "z":
        yield Problem((*path, "side"), message)
    if isinstance(part, StressComponents):
        for name in ("yz", "xz"):
            if getattr(part, name):
                yield Problem((*path, name), f"must be zero in 2 dimensions, not {getattr(part, name):g}")


def _order_problems(scene: SceneInput) -> Iterator[Problem]:
    """Lower corners that are not below the upper ones."""
    for path, part in _parts(scene):
        lower, upper = getattr(part, "lower", None) or (), getattr(part, "upper", None) or ()
        for axis, low, high in zip("xyz", lower, upper, strict=False):
            if low is None or high is None or low < high or (isinstance(part, Region) and low == high):
                continue
            yield Problem((*path, "upper"), f"along {axis} it must exceed 'lower' ({low:g}), not be {high:g}")
        if isinstance(part, Polygon) and part.extrude and part.extrude[0] >= part.extrude[1]:
            yield Problem((*path, "extrude"), "the second value must exceed the first")


def _name_problems(scene: SceneInput) -> Iterator[Problem]:
    """Names that are given twice, and references to what does not exist."""
    bodies, stages = [b.name for b in scene.bodies], [s.name for s in scene.stages]
    for key, names in (("bodies", bodies), ("stages", stages)):
        for k, name in enumerate(names):
            if name in names[:k]:
                yield Problem(
                    (key, k, "name"), f"the name '{name}' stands in {key} twice; each needs its own"
                )
    told = list(scene.boundaries)
    for k, contact in enumerate(scene.contacts):
        own = getattr(contact, "name", None)
        if own in told:
            yield Problem(("contacts", k, "name"), f"the name '{own}' stands for another obstacle, or a boundary")
        told += [own] if own is not None else []
    placed: set[str] = set()
    for k, stage in enumerate(scene.stages):
        for n, name in enumerate(stage.place):
            if name in placed:
                yield Problem(("stages", k, "place", n), f"'{name}' has been placed before; a body comes once")
            placed.add(name)
    if len(placed) == len(bodies):
        yield Problem(("stages",), "no body is there at the start: all are placed later; leave one to begin with")
    for path, name, kind, known in _references(scene, bodies, stages):
        if name not in known:
            yield Problem(path, f"there is no {kind} '{name}'; {choice(name, list(known))}")
    for k, contact in enumerate(scene.contacts):
        if contact.type == "bodies" and contact.between is not None and len(bodies) < 2:
            yield Problem(("contacts", k, "between"), "there is one body only; a contact needs two")
        if contact.type == "bodies" and contact.first is not None and contact.first == contact.second:
            yield Problem(("contacts", k, "second"), "must be another body than 'first'")


def _references(scene: SceneInput, bodies: list[str], stages: list[str]) -> Iterator[tuple]:
    """(path, name, kind, known names) of every reference by name."""
    for k, body in enumerate(scene.bodies):
        yield ("bodies", k, "material"), body.material, "material", scene.materials
        for n, layer in enumerate(body.layers):
            yield ("bodies", k, "layers", n, "material"), layer.material, "material", scene.materials
    named = [told for contact in scene.contacts if (told := getattr(contact, "name", None)) is not None]
    for name, boundary in scene.boundaries.items():
        if boundary.water is not None and boundary.water.obstacle is not None:
            yield ("boundaries", name, "water", "obstacle"), boundary.water.obstacle, "named obstacle", named
    for k, stage in enumerate(scene.stages):
        for n, name in enumerate(stage.boundaries):
            yield ("stages", k, "boundaries", n), name, "boundary condition", scene.boundaries
        for n, name in enumerate(stage.place):
            yield ("stages", k, "place", n), name, "body", bodies
        base = getattr(getattr(stage, "damping", None), "relative_to", None)
        if base is not None:
            yield ("stages", k, "damping", "relative_to"), base, "boundary condition", scene.boundaries
        for n, change in enumerate(stage.change):
            yield ("stages", k, "change", n, "into"), change.into, "material", scene.materials
    for path, part in _parts(scene):
        if isinstance(part, Region) and part.body is not None:
            yield (*path, "body"), part.body, "body", bodies
        if isinstance(part, Absorb) and part.beyond is not None:
            yield (*path, "beyond"), part.beyond, "material", scene.materials
        if isinstance(part, Region) and part.material is not None:
            yield (*path, "material"), part.material, "material", scene.materials
    for k, contact in enumerate(scene.contacts):
        for n, name in enumerate(contact.stages or ()):
            yield ("contacts", k, "stages", n), name, "stage", stages
        if contact.type == "bodies" and contact.between is None:
            yield ("contacts", k, "first"), contact.first, "body", bodies
            yield ("contacts", k, "second"), contact.second, "body", bodies


def _gravity_problems(scene: SceneInput) -> Iterator[Problem]:
    """What needs a direction of gravity in a scene without one, or the direction of z."""
    gravity = scene.gravity or ()
    if any(gravity):
        if any(gravity[:2]) or any(g > 0.0 for g in gravity[2:]):
            for path, part in _parts(scene):
                if isinstance(part, Raster | TerrainContact):
                    message = "rasters and terrains need gravity against z, [0, 0, -g]: heights are along z"
                    yield Problem((*path, "type"), message)
        return
    for path, part in _parts(scene):
        if getattr(part, "type", None) == "geostatic":
            yield Problem(
                (*path, "type"), "geostatic stress needs gravity; give 'gravity' or a uniform stress"
            )
        if isinstance(part, Body) and part.layers:
            yield Problem(
                (*path, "layers"), "layers need gravity, which says where 'above' is; give 'gravity'"
            )


def _motion_problems(scene: SceneInput) -> Iterator[Problem]:
    """Displacements that would make points jump, and velocities of bodies that never move."""
    for k, body in enumerate(scene.bodies):
        if any(body.velocity or ()) and all(stage.type in STILL for stage in scene.stages):
            message = "would never act, for there is no stage of type 'dynamics'; add one, or leave it out"
            yield Problem(("bodies", k, "velocity"), message)
    for k, contact in enumerate(scene.contacts):
        if getattr(contact, "moves", False) and all(stage.type in STILL for stage in scene.stages):
            message = "would never move, for there is no stage of type 'dynamics'; add one, or let it stand"
            yield Problem(("contacts", k), message)
    yield from _record_problems(scene)
    for name, boundary in scene.boundaries.items():
        for axis in "xyz" if boundary.displacement else "":
            history = getattr(boundary.displacement, axis)
            if history is not None and history.values[0] != 0.0:
                path = ("boundaries", name, "displacement", axis)
                message = f"must start from 0, or points would jump by {history.values[0]:g} m at once; "
                yield Problem(path, message + "give {times: [..], values: [0, ..]}")


def _construction_problems(scene: SceneInput) -> Iterator[Problem]:
    """Materials that points cannot become, and gravity that changes where something counts on it."""
    free = [k for k, contact in enumerate(scene.contacts) if getattr(contact, "free", None) is not None]
    for k, stage in enumerate(scene.stages):
        for n, change in enumerate(stage.change):
            path = ("stages", k, "change", n)
            if scene.pore_water is not None:
                yield Problem(path, "soil with pore_water keeps its material: its pores hold water; leave it out")
            if change.into in scene.materials and scene.materials[change.into].fields:
                message = f"points cannot become '{change.into}', which varies from place to place; give it numbers"
                yield Problem((*path, "into"), message)
        if stage.gravity_factor is None:
            continue
        at = ("stages", k, "gravity_factor")
        if not any(scene.gravity or ()):
            yield Problem(at, "there is no gravity that it could multiply; give 'gravity'")
        if scene.pore_water is not None:
            yield Problem(at, "the weight of pore_water does not follow it; leave out one of them")
        if free:
            yield Problem(at, f"the weight of the free body contacts[{free[0]}] does not follow it; leave out one")


def _record_problems(scene: SceneInput) -> Iterator[Problem]:
    """Records of acceleration that end in motion, and boundaries that absorb where nothing moves."""
    for path, part in _parts(scene):
        if isinstance(part, AccelerationComponents) and part.baseline == "refuse":
            for axis, history in part.histories().items():
                left = drift(np.array(history.times), np.array(history.values))
                if max(left) > _DRIFT:
                    message = (
                        f"has a drift: its end is {left[0]:.0%} of its largest velocity and {left[1]:.0%} of its "
                        "largest displacement; say baseline: correct to take off a line, or keep to have it so"
                    )
                    yield Problem((*path, axis), message)
    for k, stage in enumerate(scene.stages):
        for n, name in enumerate(stage.boundaries if stage.type in STILL else ()):
            boundary = scene.boundaries.get(name)
            if boundary is not None and (boundary.absorb is not None or boundary.tie is not None):
                what = "absorbs waves" if boundary.tie is None else "ties points"
                message = f"{what}, and has no hold in a {stage.type} stage; fix its points there"
                yield Problem(("stages", k, "boundaries", n), message)
            motions = () if boundary is None else (boundary.velocity, boundary.displacement, boundary.acceleration)
            if stage.type == "quasi_static" and any(motion is not None for motion in motions):
                message = "moves, for which a quasi_static stage has no time; load it by a traction, or fix its points"
                yield Problem(("stages", k, "boundaries", n), message)


def _strength_problems(scene: SceneInput) -> Iterator[Problem]:
    """What a search for the factor of safety lacks."""
    for k, stage in enumerate(scene.stages):
        if stage.type != "strength_reduction":
            continue
        if stage.damping.viscous == 0.0:
            message = "needs viscous damping, or nothing comes to rest; give {viscous: ..}"
            yield Problem(("stages", k, "damping"), message)
        if not any(scene.gravity or ()):
            yield Problem(("stages", k, "type"), "needs gravity, which tells how fast soil falls; give 'gravity'")
        for name, material in scene.materials.items():
            law = registry.load(material.model)
            weakens = hasattr(law, "weakened") or getattr(law, "conservative", False)
            needed = getattr(law, "weakened_by", None)
            if not weakens or (needed is not None and not material.parameters.get(needed)):
                cure = "" if needed is None else f": give {needed}"
                message = f"'{material.model}' does not say how its strength is reduced; stage '{stage.name}' needs it"
                yield Problem(("materials", name, "model"), message + cure)


def _sleep_problems(scene: SceneInput) -> Iterator[Problem]:
    """Points that may sleep where something else goes on in them."""
    if scene.sleep is None:
        return
    chosen = scene.correspondence
    if chosen.scheme != "point_state" or chosen.balance:
        message = "points sleep with correspondence point_state without balance; choose that, or remove 'sleep'"
        yield Problem(("sleep",), message)
    if scene.pore_water is not None:
        yield Problem(("sleep",), "points with pore water do not sleep; remove 'sleep', or 'pore_water'")
