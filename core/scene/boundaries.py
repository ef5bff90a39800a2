"""From the boundary conditions of a scene to prescribed motions and loads."""

import numpy as np

from periporo.core.loads.boundary import PrescribedMotion, Traction, displacement_history, velocity_history
from periporo.core.water.boundaries import WaterBoundary
from periporo.errors import InputError, Problem
from periporo.io.schema.bodies import Points


def build_boundary(scene, name: str, lattices, moving: bool) -> PrescribedMotion | Traction | WaterBoundary:
    """The boundary condition `name`; prescribed components stand still in a stage that is not `moving`."""
    boundary = scene.boundaries[name]
    sites = _selected(scene, boundary.where, lattices)
    if sum(len(ids) for _, ids, _ in sites) == 0:
        raise InputError("scene", [Problem(("boundaries", name, "where"), "no point of the scene lies in it")])
    if boundary.traction is not None:
        return _traction(scene, name, boundary.traction, sites)
    ids = np.sort(np.concatenate([ids for _, ids, _ in sites]))
    if boundary.water is not None:
        return _water_at_faces(scene, ids, boundary.water)
    if boundary.fix:
        return PrescribedMotion(ids, {"xyz".index(a): _standstill for a in boundary.fix})
    components, history = boundary.velocity, velocity_history
    if boundary.displacement is not None:
        components, history = boundary.displacement, displacement_history
    velocities = {}
    for axis, letter in enumerate("xyz"[: scene.dimension]):
        component = getattr(components, letter)
        if component is not None:
            velocities[axis] = history(component.times, component.values) if moving else _standstill
    return PrescribedMotion(ids, velocities)


def _water_at_faces(scene, ids, water):
    """The condition `water` at the faces of the points `ids`."""
    history, side = getattr(water, water.kind), None
    if water.side is not None:
        side = np.eye(scene.dimension)["xyz".index(water.side[0])] * (1.0 if water.side[1] == "+" else -1.0)
    return WaterBoundary(
        ids, water.kind, lambda time: float(np.interp(time, history.times, history.values)), side
    )  # fmt: skip


def _standstill(time, dt):
    return 0.0


def region_corners(region, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner (d,) m of a region, infinite where it is open."""
    lower = np.array([-np.inf if v is None else v for v in region.lower or (None,) * dimension])
    upper = np.array([np.inf if v is None else v for v in region.upper or (None,) * dimension])
    return lower, upper


def _selected(scene, region, lattices):
    """(lattice, ids (n,), positions (n, d)) of the points of each body that lie in a region at the start."""
    lower, upper = region_corners(region, scene.dimension)
    sites = []
    for body, lattice in zip(scene.bodies, lattices, strict=True):
        if region.body in (None, body.name):
            corners = np.maximum(lower, lattice.lower - 1), np.minimum(upper, lattice.upper + 1)
            sites.append((lattice, *lattice.sites_within(*corners)[:2]))
    return sites


def _traction(scene, name, model, sites):
    """The load on the outermost of the selected points, at the faces of their cells."""
    axis, sign = "xyz".index(model.side[0]), 1.0 if model.side[1] == "+" else -1.0
    ids, reach = (np.concatenate(part) for part in zip(*_outermost(scene, sites, axis, sign), strict=True))
    order = np.argsort(ids)
    lever = reach[order, None] * sign * np.eye(scene.dimension)[axis]
    return Traction(name, ids[order], np.array(model.stress) * scene.spacing ** (scene.dimension - 1), lever)


def _outermost(scene, sites, axis, sign):
    """Of the points that have no other selected point of their body beside them: ids (n,), and reach of cells (n,) m.

    The cells of displaced points end where those of the grid do.
    """
    for lattice, ids, position in sites:
        reach = np.full(len(ids), 0.5 * scene.spacing)
        if isinstance(lattice.body.shape, Points):
            cell = np.floor((position - lattice.lower) / scene.spacing + 0.5).astype(np.int64)
        else:
            cell = np.stack(np.unravel_index(ids - lattice.first_id, lattice.counts), axis=1)
            reach -= sign * (position - lattice.centres(cell))[:, axis]
        row = np.delete(cell, axis, axis=1)
        # sorted by row, the outermost last
        order = np.lexsort((sign * position[:, axis], *row.T))
        row = row[order]
        last = np.ones(len(order), bool)
        last[:-1] = (row[1:] != row[:-1]).any(axis=1)
        yield ids[order[last]], reach[order[last]]
