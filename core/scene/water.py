"""From the pore water of a scene to the process that makes its pressure, and the laws that want to know of it."""

import numpy as np

from periporo.core.water.pore_water import DrainedWater, Pores, PoreWater, UndrainedWater
from periporo.core.water.pressure import FreeWater, Hydrostatic, Profile, UniformSuction
from periporo.core.water.retention import (
    FULL,
    RETENTION,
    Retention,
    exponential,
    of_voids,
    tabulated,
    van_genuchten,
)
from periporo.errors import InputError, Problem


def build_water(scene, materials) -> PoreWater:
    """The process of the scene's pore water. Raises InputError for materials without pores and unusable tables."""
    water = scene.pore_water
    curve = _retention(water.retention)
    pores = Pores(_porosities(scene, materials), [curve] * len(materials), water.water_density, water.bulk_modulus)
    free = None
    if water.free_water is not None:
        level = water.free_water.level
        free = FreeWater(lambda time: float(np.interp(time, level.times, level.values)), *_weight(scene))
    if water.drainage == "undrained":
        return UndrainedWater(pores, _profile(scene), free)
    return DrainedWater(pores, _profile(scene), free, frozen=water.frozen)


def wetted(scene, materials, water: PoreWater | None) -> list:
    """The `materials`; those that a suction bonds with a state for it."""
    if water is None or scene.pore_water.retention is None:
        return materials
    return [
        m.for_unsaturated(float(xi)) if hasattr(m, "for_unsaturated") else m
        for m, xi in zip(materials, water.largest_bonding, strict=True)
    ]


def _weight(scene) -> tuple[float, np.ndarray]:
    """Weight of the water, N/m^3, and the unit vector (d,) against gravity."""
    gravity = scene.vector(scene.gravity)
    strength = float(np.sqrt((gravity**2).sum()))
    return scene.pore_water.water_density * strength, -gravity / strength


def _profile(scene) -> Profile:
    water = scene.pore_water
    if water.suction is not None:
        return UniformSuction(water.suction)
    return Hydrostatic(water.water_table, *_weight(scene), water.largest_suction)


def _porosities(scene, materials):
    """Porosity of every material: its law's, or else the scene's."""
    found = []
    for name, material in zip(scene.materials, materials, strict=True):
        value = getattr(material, "porosity", scene.pore_water.porosity)
        if value is None:
            message = "this law has no 'porosity', which pore water needs; give pore_water.porosity"
            raise InputError("scene", [Problem(("materials", name, "model"), message)])
        if value == 0.0 and scene.pore_water.drainage != "drained":
            message = "there is no room for water that cannot leave; give a porosity above 0, or 'drainage: drained'"
            raise InputError("scene", [Problem(("materials", name, "porosity"), message)])
        found.append(value)
    return np.array(found)


def _retention(model) -> Retention:
    if model is None:
        return Retention(FULL)
    if model.table is not None:
        try:
            return tabulated(*_read_table(model.table))
        except (OSError, ValueError) as error:
            problem = Problem(("pore_water", "retention", "table"), f"{model.table}: {error}")
            raise InputError("scene", [problem]) from None
    if model.van_genuchten is not None:
        return van_genuchten(model.van_genuchten.alpha, model.van_genuchten.n, model.van_genuchten.residual)
    if model.exponential is not None:
        return exponential(model.exponential.alpha, model.exponential.residual)
    return of_voids(*(RETENTION[model.set] if model.set is not None else (model.alpha1, model.alpha2, model.alpha3)))


def _read_table(name):
    """Columns of a CSV file headed suction,saturation in Pa and 1."""
    with open(name, encoding="utf-8-sig") as file:
        header = file.readline().strip().replace(" ", "")
        if header != "suction,saturation":
            raise ValueError(f"its first line must be suction,saturation, not {header!s:.60}")
        return np.loadtxt(file, delimiter=",", ndmin=2).T
