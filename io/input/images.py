"""What a scene with planes of symmetry, or periodic axes, must be like, and cannot have."""

from collections.abc import Iterator

from periporo.errors import Problem
from periporo.io.schema.scene import SceneInput

_SCHEMES = ("point_state", "bond_projected", "standard")


def image_problems(scene: SceneInput) -> Iterator[Problem]:
    """What stands against the images of a scene."""
    keys = [name for name in ("symmetry", "periodic") if getattr(scene, name) is not None]
    if not keys:
        return
    yield from _end_problems(scene)
    if scene.correspondence.scheme not in _SCHEMES:
        message = f"points with images need {', '.join(_SCHEMES)}; choose one, or remove '{keys[0]}'"
        yield Problem(("correspondence",), message)
    if scene.sleep is not None:
        yield Problem(("sleep",), f"points with images do not sleep; remove 'sleep', or '{keys[0]}'")
    repeated = [a for a in range(scene.dimension) if scene.periodic and None not in scene.periodic.along(a)]
    for k, contact in enumerate(scene.contacts):
        if contact.type in ("bodies", "short_range_published") or getattr(contact, "free", None) is not None:
            message = f"points with images touch obstacles that are not free; leave this out, or remove '{keys[0]}'"
            yield Problem(("contacts", k, "type"), message)
        elif repeated and (contact.type != "plane" or contact.rotation or any(contact.normal[a] for a in repeated)):
            axes = " and ".join("xyz"[a] for a in repeated)
            yield Problem(("contacts", k, "type"), f"does not repeat along {axes}; take a plane that lies along it")


def _end_problems(scene):
    """Planes and cells that cannot be, and what points another way."""
    symmetry, periodic = scene.symmetry, scene.periodic
    axes = range(scene.dimension)
    for key, part in (("symmetry", symmetry), ("periodic", periodic)):
        if part is not None and all(part.along(a) == (None, None) for a in axes):
            yield Problem((key,), "gives no place; give lower, upper or both, with null along axes that are open")
    for a in axes if symmetry else ():
        name = "xyz"[a]
        if symmetry.along(a) != (None, None):
            if (scene.gravity or (0.0,) * scene.dimension)[a] != 0.0:
                yield Problem(("gravity",), f"pulls along {name}, across a plane of symmetry; it must be 0 there")
            if periodic is not None and periodic.along(a) != (None, None):
                yield Problem(("periodic",), f"the scene has a plane of symmetry across {name}; take one of both")
            components = getattr(scene.initial_stress, "components", None)
            sheared = [c for c in ("xy", "yz", "xz") if name in c and getattr(components, c, 0.0)]
            if sheared:
                message = f"no shear stress acts on a plane of symmetry across {name}; leave out {', '.join(sheared)}"
                yield Problem(("initial_stress", "components"), message)
            if scene.axisymmetric and a == 0:
                yield Problem(("symmetry",), "x is the radius with axisymmetric: true; leave it null")
    for a in axes if periodic else ():
        name, ends = "xyz"[a], periodic.along(a)
        if (ends[0] is None) != (ends[1] is None):
            yield Problem(("periodic",), f"needs both ends along {name}, or null for both")
        if scene.axisymmetric and a == 0 and None not in ends:
            yield Problem(("periodic",), "x is the radius with axisymmetric: true; leave it null")
        if None not in ends and scene.domain and scene.domain.along(a) != (None, None):
            yield Problem(("domain",), f"the scene repeats along {name}, and nothing leaves there; leave it null")
    if periodic and all(None not in periodic.along(a) for a in axes):
        yield Problem(("periodic",), "one axis must stay open; leave it null")
