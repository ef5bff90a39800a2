"""What a scene with axial symmetry must be like, and cannot have."""

from collections.abc import Iterator

from periporo.errors import Problem
from periporo.io.geometry.points import PointFileError
from periporo.io.geometry.rasters import GroundFileError
from periporo.io.geometry.shapes import bounds
from periporo.io.schema.scene import POINT_SCHEMES, SceneInput

_OBSTACLES = ("plane", "box", "disc", "polyline", "wedge")
_PLANAR = ("fix", "velocity", "displacement", "acceleration", "traction")
_EDGE = 1e-9  # of the spacing


def ring_problems(scene: SceneInput) -> Iterator[Problem]:
    """What stands against the points of a scene being rings about x = 0."""
    if not scene.axisymmetric:
        return
    if scene.dimension != 2:
        yield Problem(("axisymmetric",), "needs dimension 2: a half of the section through the axis x = 0")
        return
    yield from _missing(scene)
    chosen = scene.correspondence
    if chosen.scheme not in POINT_SCHEMES or chosen.balance:
        message = f"rings need correspondence {' or '.join(POINT_SCHEMES)} without balance; choose one of them"
        yield Problem(("correspondence",), message)
    for name in ("pore_water", "sleep"):
        if getattr(scene, name) is not None:
            yield Problem((name,), f"not with axisymmetric: true; remove '{name}', or take three dimensions")
    for k, contact in enumerate(scene.contacts):
        if contact.type not in _OBSTACLES or getattr(contact, "free", None) is not None:
            message = f"none of these with rings: take {', '.join(_OBSTACLES)}, not free"
            yield Problem(("contacts", k, "type"), message)
    for name, boundary in scene.boundaries.items():
        if not any(getattr(boundary, kind) is not None for kind in _PLANAR):
            message = f"not with axisymmetric: true, which knows {', '.join(_PLANAR)}"
            yield Problem(("boundaries", name), message)
    for name, material in scene.materials.items():
        if material.model == "drucker_prager" and material.parameters.get("match") in (None, "plane_strain"):
            message = "say which: rings are not in plane strain; compression and extension are triaxial tests"
            yield Problem(("materials", name, "match"), message)
        if "length" in (material.model_extra or {}):
            yield Problem(("materials", name, "length"), "counts on the size of points; leave it out with rings")


def _missing(scene):
    """What is not on the right side of the axis, or not held there."""
    if any((scene.gravity or (0.0,))[:1]):
        yield Problem(("gravity",), "must be along the axis, [0, g], with axisymmetric: true")
    for k, body in enumerate(scene.bodies):
        try:
            lower = bounds(body.shape, 2)[0][0]
        except (GroundFileError, PointFileError):
            continue  # which `geometry_problems` tells
        if lower < -_EDGE * scene.spacing:
            message = f"reaches to x = {lower:g}; rings have x > 0, the radius: give a half of the section"
            yield Problem(("bodies", k, "shape"), message)
    if not any(c.type == "plane" and c.point[0] >= 0.0 and c.normal[0] > 0.0 == c.normal[1] and c.friction == 0.0
               and c.stages is None for c in scene.contacts):  # fmt: skip
        message = "rings need an axis: add {type: plane, point: [0, 0], normal: [1, 0], friction: 0}"
        yield Problem(("contacts",), message)
