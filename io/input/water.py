"""Pore water in a scene: what it needs, and what suits it."""

from collections.abc import Iterator

from periporo.errors import Problem, choice
from periporo.io.schema.scene import POINT_SCHEMES, SceneInput
from periporo.materials import registry


def water_problems(scene: SceneInput) -> Iterator[Problem]:
    """Pore water in a scene with a law that has its own, or without what it needs."""
    water = scene.pore_water
    for name, boundary in scene.boundaries.items():
        if boundary.water is not None and (water is None or water.drainage != "flowing"):
            message = "nothing enters or leaves unless water flows; give pore_water with 'drainage: flowing'"
            yield Problem(("boundaries", name, "water"), message)
        if boundary.water is not None and {boundary.water.kind} & {"head", "rain"} and not any(scene.gravity or ()):
            yield Problem(("boundaries", name, "water"), f"{boundary.water.kind} needs gravity; give 'gravity'")
    present = {getattr(c, "name", None): c.stages for c in scene.contacts}
    for k, stage in enumerate(scene.stages):
        for n, name in enumerate(stage.boundaries):
            faces = scene.boundaries[name].water if name in scene.boundaries else None
            if faces is not None and stage.name not in (present.get(faces.obstacle) or [stage.name]):
                message = f"the obstacle '{faces.obstacle}' is not there in this stage; give it the stage, or leave out"
                yield Problem(("stages", k, "boundaries", n), f"{message} the boundary '{name}'")
        if stage.type == "quasi_static" and (water is None or water.drainage != "flowing"):
            message = "goes by the time in which water flows; give pore_water with 'drainage: flowing', or relax"
            yield Problem(("stages", k, "type"), message)
    if water is None:
        return
    if water.phreatic_line is not None and scene.dimension == 3:
        message = "a line is for two dimensions; give a phreatic_surface, or a water_table"
        yield Problem(("pore_water", "phreatic_line"), message)
    if water.phreatic_surface is not None:
        if scene.dimension == 2:
            yield Problem(("pore_water", "phreatic_surface"), "a raster is for three dimensions; give a phreatic_line")
        elif scene.gravity is not None and (any(scene.gravity[:2]) or scene.gravity[2] > 0.0):
            message = "heights of a raster go along z; let gravity be [0, 0, -g]"
            yield Problem(("pore_water", "phreatic_surface"), message)
    for name in ("water_table", "phreatic_line", "phreatic_surface", "free_water"):
        if getattr(water, name) is not None and not any(scene.gravity or ()):
            yield Problem(("pore_water", name), "a level of water needs gravity; give 'gravity', or a suction")
    for name in water.soils:
        if name not in scene.materials:
            message = f"there is no material '{name}'; {choice(name, list(scene.materials))}"
            yield Problem(("pore_water", "soils", name), message)
    if water.drainage != "drained" and scene.correspondence.scheme not in POINT_SCHEMES:
        choice_of = " or ".join(POINT_SCHEMES)
        message = f"water that cannot leave its point needs a law there: choose correspondence {choice_of}"
        yield Problem(("correspondence",), f"{message}, not {scene.correspondence.scheme}")
    for name, material in scene.materials.items():
        if getattr(registry.load(material.model), "owns_pore_pressure", False):
            message = (
                f"'{material.model}' has its own pore pressure; remove 'pore_water' or choose another model"
            )
            yield Problem(("materials", name, "model"), message)
