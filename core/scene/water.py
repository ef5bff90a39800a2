"""From the pore water of a scene to the process that makes its pressure, and the laws that want to know of it."""

import numpy as np

from periporo.core.scene.boundaries import over_time
from periporo.core.scene.pressures import known_pressures, pressure_around
from periporo.core.water.bishop import bishop_of
from periporo.core.water.flow import MOST_STAGES, TOO_FAST, FlowingWater, Permeability, flowing_water
from periporo.core.water.increments import Increments
from periporo.core.water.pore_water import DrainedWater, PoreWater, UndrainedWater
from periporo.core.water.pores import Pores
from periporo.core.water.pressure import (
    FreeWater,
    GivenPressure,
    Hydrostatic,
    Profile,
    UniformSuction,
    across,
    level_table,
    line_table,
)
from periporo.core.water.retention import FULL, retention_of
from periporo.errors import InputError, Problem
from periporo.io.geometry.rasters import read_raster
from periporo.io.schema.water import Soil

STANDARD_GRAVITY = 9.81  # m/s^2, under which a conductivity is measured


def build_water(scene, materials) -> PoreWater:
    """The process of the scene's pore water. Raises InputError for materials without pores and unusable tables."""
    process = _process(scene, materials)
    process.reports_work = scene.pore_water.report_work
    return process


def _process(scene, materials) -> PoreWater:
    water = scene.pore_water
    soils = [_soil(scene, name) for name in scene.materials]
    curves = [retention_of(soil.retention) for soil in soils]
    factors = np.array([bishop_of(soil.bishop, curve) for soil, curve in zip(soils, curves, strict=True)])
    pores = Pores(_porosities(scene, materials), curves, factors, water.water_density, water.bulk_modulus)
    free = None
    if water.free_water is not None:
        free = FreeWater(over_time(water.free_water.level), *_weight(scene))
    if water.drainage == "flowing":
        passed = {b.water.kind for b in scene.boundaries.values() if b.water is not None}
        flowing = FlowingWater(pores, _profile(scene), free, _permeability(scene), passed)
        if any(stage.type == "quasi_static" for stage in scene.stages):
            flowing.increments = Increments(flowing)
        return flowing
    if water.drainage == "undrained":
        return UndrainedWater(pores, _profile(scene), free, scene.vector(scene.gravity))
    return DrainedWater(pores, _profile(scene), free, frozen=water.frozen)


def wetted(scene, materials, water: PoreWater | None) -> list:
    """The `materials`; those that a suction bonds with a state for it."""
    if water is None:
        return materials
    return [
        m.for_unsaturated(float(xi)) if hasattr(m, "for_unsaturated") and curve.kind != FULL else m
        for m, xi, curve in zip(materials, water.largest_bonding, water.pores.retention, strict=True)
    ]


def refuse_inner_inflows(scene, sim, first: int = 0) -> None:
    """Raise InputError for a boundary of water none of whose points has a face at the surface on its side.

    Of the stages from `first` on until one digs or builds, which is when the faces of those after it are known.
    """
    p, outer = sim.particles, flowing_water(sim).outer_faces(sim.particles)
    for k in range(first, len(sim.stages)):
        if k > first and sim.stages[k].construction is not None:
            break
        named = [name for name in scene.stages[k].boundaries if scene.boundaries[name].water is not None]
        for name, boundary in zip(named, sim.stages[k].inflows, strict=True):
            here, faces = int(np.isin(p.id[: p.owned], boundary.ids).sum()), len(boundary.faces(p, outer).rows)
            if boundary.obstacle is not None:
                continue  # soil may come to it later
            if sim.comm.allreduce(here) > 0 and sim.comm.allreduce(faces) == 0:  # some bodies come later
                side = scene.boundaries[name].water.side
                towards = "" if side is None else f" that looks to {side}"
                message = (
                    f"none of its points has a face at the surface{towards} in stage '{scene.stages[k].name}', through "
                    "which water could go; let 'where' reach to the surface, or choose another side"
                )
                raise InputError("scene", [Problem(("boundaries", name, "water"), message)])


def refuse_hasty_flow(scene, sim, water: FlowingWater) -> None:
    """Raise InputError if water flows so fast that a step of motion cannot follow it."""
    p = sim.particles
    if water.stages_within(p, water.network(p), sim.dt) <= MOST_STAGES:
        return
    worst = list(scene.materials)[int(np.argmax(water.permeability.mobility))]
    own = scene.pore_water.soils.get(worst)
    path: tuple = ("pore_water",)
    if own is not None and (own.conductivity is not None or own.permeability is not None):
        path = ("pore_water", "soils", worst)
    key = "conductivity" if _soil(scene, worst).conductivity is not None else "permeability"
    raise InputError("scene", [Problem((*path, key), TOO_FAST.format(dt=sim.dt))])


def _soil(scene, name):
    """What the water meets in the material `name`, each key of a `Soil`."""
    water = scene.pore_water
    common = Soil(**{key: getattr(water, key) for key in Soil.model_fields})
    own = water.soils.get(name)
    if own is None:
        return common
    given = {key: value for key in Soil.model_fields if (value := getattr(own, key)) is not None}
    if {"conductivity", "permeability"} & set(given):  # whichever unit holds for all
        common = common.model_copy(update={"conductivity": None, "permeability": None})
    return common.model_copy(update=given)


def _permeability(scene) -> Permeability:
    water, found = scene.pore_water, []
    for name in scene.materials:
        soil = _soil(scene, name)
        if soil.conductivity is None and soil.permeability is None:
            message = "water that flows needs a conductivity (m/s), or a permeability (m^2), of every material"
            raise InputError("scene", [Problem(("pore_water", "drainage"), f"{message}; '{name}' has none")])
        if soil.permeability is not None:
            found.append(soil.permeability / water.viscosity)
        else:
            found.append(soil.conductivity / (water.water_density * STANDARD_GRAVITY))
    factors = np.ones(scene.dimension) if water.anisotropy is None else np.array(water.anisotropy)
    return Permeability(np.array(found), water.kozeny_carman, scene.vector(scene.gravity), factors)


def _weight(scene) -> tuple[float, np.ndarray]:
    """Weight of the water, N/m^3, and the unit vector (d,) against gravity."""
    gravity = scene.vector(scene.gravity)
    strength = float(np.sqrt((gravity**2).sum()))
    return scene.pore_water.water_density * strength, -gravity / strength


def _profile(scene) -> Profile:
    water = scene.pore_water
    if water.suction is not None:
        suction = water.suction
        return UniformSuction(over_time(suction), max(suction.values), varies=len(set(suction.values)) > 1)
    if water.pressure is not None:
        return _given(scene)
    weight, up = _weight(scene)
    return Hydrostatic(_table(water, up), weight, up, water.largest_suction)


def _table(water, up):
    """Levels of the water table as a function of place and time."""
    if water.water_table is not None:
        return level_table(over_time(water.water_table))
    if water.phreatic_surface is not None:
        raster = read_raster(water.phreatic_surface)
        return lambda position, time: raster.at(np.clip(position[:, :2], raster.corner, raster.far_corner))
    corners = np.array(water.phreatic_line)
    if not (np.diff(across(corners, up)) > 0.0).all():
        message = "its points must lie one after another across gravity, from the left, as down is below"
        raise InputError("scene", [Problem(("pore_water", "phreatic_line"), message)])
    return line_table(corners, up)


def _given(scene):
    """Pressures that are known at points."""
    water, gravity = scene.pore_water, scene.vector(scene.gravity)
    begin, largest = pressure_around(*known_pressures(water.pressure, scene.dimension))
    if water.drainage != "drained" and largest >= 0.5 * water.bulk_modulus:
        message = f"a suction of {largest:g} Pa would pull water of a bulk_modulus of {water.bulk_modulus:g} Pa apart; "
        message += "are these pressures in Pa, compression positive? Else give a bulk_modulus twice as large"
        raise InputError("scene", [Problem(("pore_water", "pressure"), message)])
    return GivenPressure(begin, _weight(scene)[1] if gravity.any() else np.eye(scene.dimension)[-1], largest)


def _porosities(scene, materials):
    """Porosity of every material: its law's, or else the scene's."""
    found = []
    for name, material in zip(scene.materials, materials, strict=True):
        own = getattr(material, "porosity", None)
        value = _soil(scene, name).porosity if own is None else own
        if value is None:
            message = "this law has no 'porosity', which pore water needs; give pore_water.porosity"
            raise InputError("scene", [Problem(("materials", name, "model"), message)])
        if value == 0.0 and scene.pore_water.drainage != "drained":
            message = "there is no room for water that cannot leave; give a porosity above 0, or 'drainage: drained'"
            raise InputError("scene", [Problem(("materials", name, "porosity"), message)])
        found.append(value)
    return np.array(found)
