"""From the boundary conditions of a scene to prescribed motions and loads."""

from collections.abc import Mapping

import numpy as np

from periporo.contact.rigid import RigidContact
from periporo.core.loads.absorbing import Absorbing
from periporo.core.loads.boundary import DisplacementHistory, PrescribedMotion, Traction, VelocityHistory
from periporo.core.loads.tied import Tied
from periporo.core.numerics.gravity import vertical_axis
from periporo.core.numerics.histories import AccelerationHistory, without_drift
from periporo.core.points.material import moduli_without_stress
from periporo.core.water.boundaries import WaterBoundary
from periporo.errors import InputError, Problem
from periporo.io.geometry import rings

_SAME = 1e-6  # spacings by which places that are the same may differ


def build_boundary(
    scene, name: str, lattices, moving: bool, comm, obstacles: Mapping[str, RigidContact]
) -> PrescribedMotion | Traction | Absorbing | Tied | WaterBoundary:
    """The boundary condition `name`; prescribed components stand still in a stage that is not `moving`.

    `obstacles` are those with a name.
    """
    boundary = scene.boundaries[name]
    sites = _selected(scene, boundary.where, lattices)
    if sum(len(ids) for _, ids, _ in sites) == 0:
        raise InputError("scene", [Problem(("boundaries", name, "where"), "no point of the scene lies in it")])
    if boundary.traction is not None:
        return _traction(scene, name, boundary.traction, sites)
    if boundary.absorb is not None:
        return _absorbing(scene, name, boundary.absorb, sites)
    if boundary.tie is not None:
        others = _selected(scene, boundary.tie.to, lattices)
        if sum(len(ids) for _, ids, _ in others) == 0:
            message = "no point of the scene lies in it"
            raise InputError("scene", [Problem(("boundaries", name, "tie", "to"), message)])
        return _tied(scene, name, boundary.tie.components, [*sites, *others], comm)
    ids = np.sort(np.concatenate([ids for _, ids, _ in sites]))
    if boundary.water is not None:
        return _water_at_faces(scene, ids, boundary.water, obstacles)
    if boundary.fix:
        return PrescribedMotion(ids, {"xyz".index(a): _standstill for a in boundary.fix}, name)
    velocities = _velocities(boundary)
    return PrescribedMotion(ids, velocities if moving else dict.fromkeys(velocities, _standstill), name)


def _velocities(model):
    """Functions of time and time step that give the velocity along each axis that a boundary prescribes."""
    if model.acceleration is not None:
        histories = model.acceleration.histories()
        values = {a: corrected(model.acceleration.baseline, h.times, h.values) for a, h in histories.items()}
        return {"xyz".index(a): AccelerationHistory(h.times, values[a]) for a, h in histories.items()}
    if getattr(model, "displacement", None) is not None:
        components, kind = model.displacement, DisplacementHistory
    else:
        components, kind = model.velocity, VelocityHistory
    return {"xyz".index(a): kind(h.times, h.values) for a, h in components.histories().items()} if components else {}


def corrected(baseline: str, times, values) -> np.ndarray:
    """The accelerations (n,) of a record, without drift if they are to be corrected."""
    values = np.asarray(values, float)
    return without_drift(np.asarray(times, float), values) if baseline == "correct" else values


def hold(lattice) -> PrescribedMotion:
    """All points of a body at rest."""
    ids = np.sort(np.concatenate([ids for ids, *_ in lattice.chunks()]))
    return PrescribedMotion(ids, dict.fromkeys(range(lattice.dimension), _standstill))


def _water_at_faces(scene, ids, water, obstacles):
    """The condition `water` at the faces of the points `ids`."""
    history, side = getattr(water, water.kind), None
    if water.side is not None:
        side = np.eye(scene.dimension)["xyz".index(water.side[0])] * (1.0 if water.side[1] == "+" else -1.0)
    obstacle = None if water.obstacle is None else obstacles[water.obstacle]
    return WaterBoundary(ids, water.kind, over_time(history), side, obstacle)


def over_time(history):
    """The function of time that an entry describes, None for none."""
    return None if history is None else lambda time: float(np.interp(time, history.times, history.values))


def _standstill(time, dt):
    return 0.0


def region_corners(region, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner (d,) m of a region, infinite where it is open."""
    lower = np.array([-np.inf if v is None else v for v in region.lower or (None,) * dimension])
    upper = np.array([np.inf if v is None else v for v in region.upper or (None,) * dimension])
    return lower, upper


def selected_ids(scene, region, lattices) -> np.ndarray:
    """Ids (n,) of the points that lie in a region at the start, ascending."""
    return np.sort(np.concatenate([ids for _, ids, _ in _selected(scene, region, lattices)]))


def middle_of(scene, region, lattices) -> np.ndarray:
    """Middle (d,) m of the box around the points that lie in a region at the start."""
    places = np.concatenate([place for *_, place in _selected(scene, region, lattices)])
    return 0.5 * (places.min(axis=0) + places.max(axis=0)) if len(places) else np.zeros(scene.dimension)


def _selected(scene, region, lattices):
    """(lattice, ids (n,), positions (n, d)) of the points of each body that lie in a region at the start."""
    lower, upper = region_corners(region, scene.dimension)
    sites = []
    for body, lattice in zip(scene.bodies, lattices, strict=True):
        if region.body in (None, body.name):
            corners = np.maximum(lower, lattice.lower - 1), np.minimum(upper, lattice.upper + 1)
            ids, place, _, material = lattice.sites_within(*corners)
            if region.material is not None:
                own = material == list(scene.materials).index(region.material)
                ids, place = ids[own], place[own]
            sites.append((lattice, ids, place))
    return sites


def _traction(scene, name, model, sites):
    """The load on the outermost of the selected points, at the faces of their cells."""
    axis, sign = "xyz".index(model.side[0]), 1.0 if model.side[1] == "+" else -1.0
    ids, reach, area = _outermost(scene, sites, axis, sign)
    order = np.argsort(ids)
    lever = reach[order, None] * sign * np.eye(scene.dimension)[axis]
    force = np.array(model.stress) * area[order, None]
    return Traction(name, ids[order], force, lever, over_time(model.factor))


def _tied(scene, name, axes, sites, comm):
    """Points of the same level against gravity, half a spacing up or down, in groups."""
    ids, first = np.unique(np.concatenate([i for _, i, _ in sites]), return_index=True)
    place = np.concatenate([x for *_, x in sites])[first]
    up = vertical_axis(scene.gravity, scene.dimension)
    level = np.rint((place[:, up] - place[:, up].min()) / scene.spacing).astype(np.int64)
    chosen = ["xyz".index(a) for a in axes]
    return Tied(comm, dict.fromkeys(chosen, ids), dict.fromkeys(chosen, level), name)


def _absorbing(scene, name, model, sites):
    """Dashpots on the outermost of the selected points."""
    axis, sign = "xyz".index(model.side[0]), 1.0 if model.side[1] == "+" else -1.0
    ids = np.sort(_outermost(scene, sites, axis, sign)[0])
    lever = 0.5 * scene.spacing * sign * np.eye(scene.dimension)[axis]
    beyond = None
    if model.beyond is not None:
        material = scene.materials[model.beyond].create()
        beyond = material.density, *moduli_without_stress(material)
    return Absorbing(name, ids, lever, scene.spacing ** (scene.dimension - 1), _velocities(model), beyond)


def _outermost(scene, sites, axis, sign):
    """Of the points that have no other selected point beside them on a side: ids (n,), reach (n,) m and area of cells.

    Areas (n,) are in m^(d-1). Whatever body it belongs to: of bodies that stand on each other the last one is loaded.
    """
    tops = [_tops_of_columns(scene, *site, axis, sign) for site in sites]
    found = []
    for k, (own, reach, area, place) in enumerate(tops):
        free = np.ones(len(own), bool)
        for n, (*_, other) in enumerate(tops):
            if n != k:
                free &= ~_is_covered(place, other, axis, sign, scene.spacing)
        found.append((own[free], reach[free], area[free]))
    return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))


def _tops_of_columns(scene, lattice, ids, position, axis, sign):
    """The last point of every column of a lattice along an axis: ids (m,), and of cells reach (m,) m and area (m,).

    And places (m, d): they are those before jitter; the cells of displaced points end where those of the grid do.
    """
    reach = np.full(len(ids), 0.5 * scene.spacing)
    area = np.full(len(ids), scene.spacing ** (scene.dimension - 1))
    if lattice.round is not None:
        place, (cell, area) = position, rings.columns(lattice.round, scene.spacing, ids - lattice.first_id, axis)
    elif lattice.table is not None:
        place, cell = position, np.floor((position - lattice.lower) / scene.spacing + 0.5).astype(np.int64)
    else:
        cell = np.stack(np.unravel_index(ids - lattice.first_id, lattice.counts), axis=1)
        place = lattice.centres(cell)
        reach -= sign * (position - place)[:, axis]
    column = np.delete(cell, axis, axis=1)
    order = np.lexsort((sign * place[:, axis], *column.T))  # by column, the outermost last
    column = column[order]
    last = np.ones(len(order), bool)
    last[:-1] = (column[1:] != column[:-1]).any(axis=1)
    rows = order[last]
    return ids[rows], reach[rows], area[rows], place[rows]


def _is_covered(place, other, axis, sign, spacing):
    """Which of the places (n, d) have one of the `other` (m, d) further out, and at most half a spacing aside."""
    covered = np.zeros(len(place), bool)
    own_aside, aside = (np.delete(x, axis, axis=1) / spacing for x in (place, other))
    own_out, out = sign * place[:, axis] / spacing, sign * other[:, axis] / spacing
    cells, own_cells = np.floor(aside).astype(np.int64), np.floor(own_aside).astype(np.int64)
    found: dict[tuple, list[int]] = {}
    for row, cell in enumerate(map(tuple, cells.tolist())):
        found.setdefault(cell, []).append(row)
    for row, cell in enumerate(own_cells.tolist()):
        beside = [r for shift in np.ndindex(*(3,) * len(cell)) for r in found.get(tuple(np.add(cell, shift) - 1), ())]
        near = np.abs(aside[beside] - own_aside[row]).max(axis=1, initial=0.0) <= 0.5 + _SAME
        covered[row] = (near & (out[beside] > own_out[row] + _SAME)).any()
    return covered
