"""What looks wrong about the water of a scene that can be run."""

import numpy as np

from periporo.core.ranks.reductions import maximum
from periporo.core.scene.pressures import farthest
from periporo.core.water.flow import flowing_water
from periporo.io.geometry.origin import relative
from periporo.io.geometry.rasters import read_raster

_TIGHTEST, _COARSEST = 1e-13, 1e-7  # conductivity of clay, m/s, and permeability of gravel, m^2
_FAR = 2.0  # distances between places: points that are farther away
_CLOUDBURST = 1e-4  # m/s, of rain: 360 mm/h


def doubts_about_water(scene, sim) -> list[str]:
    """Remarks on units, on rain from below, tables that hold nothing up or leave soil wet above, faces without soil."""
    if scene.pore_water is None:
        return []
    return [
        *units_of_water(scene), *_rain_from_below(scene), *_strange_table(scene, sim), *_bare_obstacles(scene, sim),
    ]  # fmt: skip


def units_of_water(scene) -> list[str]:
    """Remarks on permeability, conductivity and rain that seem to be in another unit."""
    return [] if scene.pore_water is None else [*_strange_permeability(scene.pore_water), *_strange_rain(scene)]


def _strange_permeability(water) -> list[str]:
    """A remark on each permeability or conductivity that is of the magnitude of the other."""
    doubts = []
    for name, soil in {"pore_water": water, **{f"soil '{k}'": v for k, v in water.soils.items()}}.items():
        if soil.conductivity is not None and soil.conductivity < _TIGHTEST:
            doubts.append(
                f"{name}: a conductivity of {soil.conductivity:.3g} m/s is less than that of any clay; is it a "
                "permeability in m^2?"
            )
        if soil.permeability is not None and soil.permeability > _COARSEST:
            doubts.append(
                f"{name}: a permeability of {soil.permeability:.3g} m^2 is more than that of gravel; is it a "
                "conductivity in m/s?"
            )
    return doubts


def _heaviest_rain(boundary) -> float:
    """The most that falls on a boundary, m/s; 0 where none does."""
    rain = None if boundary.water is None else boundary.water.rain
    return 0.0 if rain is None else max(rain.values)


def _strange_rain(scene) -> list[str]:
    """A remark on rain that never fell."""
    doubts = []
    for name, boundary in scene.boundaries.items():
        most = _heaviest_rain(boundary)
        if most > _CLOUDBURST:
            doubts.append(
                f"boundary '{name}': a rain of {most:.3g} m/s is more than ever fell ({_CLOUDBURST:g} m/s are 360 "
                "mm/h); is it in mm/h?"
            )
    return doubts


def _rain_from_below(scene) -> list[str]:
    """A remark on rain on faces that look down."""
    doubts, gravity = [], scene.vector(scene.gravity)
    for name, boundary in scene.boundaries.items():
        side = None if boundary.water is None else boundary.water.side
        if side is None or _heaviest_rain(boundary) <= 0.0:
            continue
        if gravity["xyz".index(side[0])] * (1.0 if side[1] == "+" else -1.0) > 0.0:
            doubts.append(f"boundary '{name}': no rain falls on faces that look to {side}, down; choose another side")
    return doubts


def _strange_table(scene, sim) -> list[str]:
    """A remark on a table above all soil without free water there, and on one below which all soil is full."""
    water, doubts, extent = scene.pore_water, [], sim.extent
    if water.pressure is not None:
        return _strange_reach(relative(scene, sim.origin).pore_water, scene, sim)
    if water.suction is not None:
        return []
    table = _highest(water, extent.up)
    top = float((np.where(extent.up > 0.0, extent.upper, extent.lower) + sim.origin) @ extent.up)
    if water.free_water is None and table > top + scene.spacing:
        doubts.append(
            f"the water table, {table:.6g} m, is {table - top:.3g} m above all soil, and no water stands there to hold "
            "up its surface; give free_water, or a lower water_table"
        )
    if table < top - scene.spacing and water.largest_suction == 0.0 and water.retention is not None:
        doubts.append(
            "above the water table pores are full and without pressure, since largest_suction is 0; give the suction "
            "to which it grows with height"
        )
    return doubts


def _highest(water, up) -> float:
    """Highest level of the water table, m."""
    if water.water_table is not None:
        return max(water.water_table.values)
    if water.phreatic_surface is not None:
        return float(read_raster(water.phreatic_surface).level.max())
    return max(float(np.array(point) @ up) for point in water.phreatic_line)


def _strange_reach(water, scene, sim) -> list[str]:
    """A remark on points that are far from all places whose pressure is known, counted from the scene's origin."""
    p = sim.particles
    distance, apart = farthest(water.pressure, p.position[: p.owned])
    distance = maximum(sim.comm, distance)
    if distance <= max(_FAR * apart, 2.0 * scene.spacing):
        return []
    return [
        f"pore_water.pressure: a point is {distance:.3g} m from the nearest place of {water.pressure.file}, and these "
        f"are about {apart:.3g} m apart: its pressure is drawn on in a line; do the places reach over all bodies?"
    ]


def _bare_obstacles(scene, sim) -> list[str]:
    """A remark on each obstacle at whose face water is to pass, and which no soil touches when the stage begins."""
    named = [name for name in scene.stages[0].boundaries if scene.boundaries[name].water is not None]
    if not named:
        return []
    p, outer = sim.particles, flowing_water(sim).outer_faces(sim.particles)
    return [
        f"boundary '{name}': no soil touches the obstacle '{scene.boundaries[name].water.obstacle}' at the start, so "
        "that no water passes there until some comes to it"
        for name, inflow in zip(named, sim.stages[0].inflows, strict=True)
        if inflow.obstacle is not None and not sim.comm.allreduce(len(inflow.faces(p, outer).rows))
    ]
