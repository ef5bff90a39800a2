"""From the stages of a scene to what they build and dig."""

import numpy as np

from periporo.core.motion.construction import Construction
from periporo.core.points.departures import Departures
from periporo.core.scene.boundaries import selected_ids
from periporo.errors import InputError, Problem

_NOTHING = "there is no point in it at this stage: it lies beside all bodies, or was removed before"


def bodies_at_start(scene) -> list[int]:
    """Numbers of the bodies that no stage places."""
    placed = scene.placed_bodies()
    return [number for number, body in enumerate(scene.bodies) if body.name not in placed]


def build_constructions(scene, sim, lattices, maker) -> None:
    """Give the simulation's stages what they build and dig.

    Raises InputError for a stage that removes what is not there.
    """
    if not any(stage.remove or stage.place or stage.change for stage in scene.stages):
        return
    names = [body.name for body in scene.bodies]
    there = [_ids(lattices[number]) for number in bodies_at_start(scene)]
    present = np.sort(np.concatenate([np.empty(0, np.int64), *there]))
    problems = []
    for k, stage in enumerate(scene.stages):
        gone = [np.empty(0, np.int64)]
        for n, region in enumerate(stage.remove):
            ids = np.intersect1d(selected_ids(scene, region, lattices), present, assume_unique=True)
            if not len(ids):
                problems.append(Problem(("stages", k, "remove", n), _NOTHING))
            gone.append(ids)
        removed = np.unique(np.concatenate(gone))
        present = np.setdiff1d(present, removed, assume_unique=True)
        changes = _changes(scene, stage, k, present, lattices, problems)
        placed = [names.index(name) for name in stage.place]
        new = np.concatenate([np.empty(0, np.int64), *(_ids(lattices[number]) for number in placed)])
        present = np.sort(np.concatenate([present, new]))
        if not len(present):
            problems.append(Problem(("stages", k, "remove"), "takes all points away: leave some, or end before it"))
            break
        if stage.remove or stage.place or stage.change:
            arrive = _arrival(maker, placed) if placed else None
            sim.stages[k].construction = Construction(removed, arrive, ", ".join(stage.place), new, *changes)
    if problems:
        raise InputError("scene", problems)
    if sim.departures is None and any(stage.remove for stage in scene.stages):
        sim.departures = Departures(np.full(scene.dimension, -np.inf), np.full(scene.dimension, np.inf))


def _changes(scene, stage, k, present, lattices, problems):
    """Ids (n,), sorted, of the points of stage `k` that become another material, and the numbers of these (n,)."""
    into = {}
    for n, change in enumerate(stage.change):
        ids = np.intersect1d(selected_ids(scene, change, lattices), present, assume_unique=True)
        if not len(ids):
            problems.append(Problem(("stages", k, "change", n), _NOTHING))
        into |= dict.fromkeys(ids.tolist(), list(scene.materials).index(change.into))
    ids = np.array(sorted(into), np.int64)
    return ids, np.array([into[i] for i in ids.tolist()], np.int64)


def _arrival(maker, bodies):
    return lambda domain: maker.owned_by(domain, bodies)


def _ids(lattice) -> np.ndarray:
    """Ids of all points of a body."""
    return np.concatenate([np.empty(0, np.int64), *(ids for ids, *_ in lattice.chunks())])
