"""Everything that a run is made of at the end of a step: taken down, and put back so that it goes on bit for bit.

What can be computed from the rest is left out: neighbours follow from the positions at which they were found,
shape tensors and influence from the present positions. Kept are the point fields that migrate, the forces (the next
step begins with them), the state of active rows, and what the parts of the program remember.
"""

from dataclasses import dataclass

import numpy as np

from periporo.core.bonds.blocks import Carried
from periporo.core.motion.energy import Ledger
from periporo.core.points.neighbours import original
from periporo.core.points.particles import awake_first, rows_of
from periporo.core.ranks import domain as decomposition
from periporo.core.ranks.domain import Domain
from periporo.core.ranks.halo import pack
from periporo.core.ranks.halving import exchange_rows


class StateError(Exception):
    """A state does not fit the simulation; raised on all ranks alike."""


@dataclass
class State:
    """The state of this rank's points (arrays by field, in id order), and of rows, one `Carried` per `Bonds.carriers`.

    `domain` divides space so that the points are where they belong, and `rows` hold also those that another rank
    has too; without it points may be on any rank, each with the rows whose first id is its own.
    """

    points: dict[str, np.ndarray]
    rows: list[Carried]
    memory: dict
    domain: Domain | None = None
    begun_with: "State | None" = None  # in which the present increment or trial of a stage began

    @classmethod
    def of_tables(cls, points: dict[str, np.ndarray], rows: list[dict[str, np.ndarray]], memory: dict) -> "State":
        """The state that was written as `tables`."""
        return cls(points, [Carried.of_active(**columns) for columns in rows], memory)


def point_fields(sim) -> list[str]:
    """Names of the point fields that belong to a state."""
    return [f.name for f in sim.particles.migrating()] + [f"{name}_force" for name in sim.forces.names]


def capture(sim) -> State:
    """A copy of the present state, which stays on its ranks."""
    points = {name: a.copy() if a.flags.writeable else a for name, a in _present_points(sim).items()}
    began = sim.stages[sim.stage_number].begun_with
    return State(points, [own_rows(sim, r) for r in sim.bonds.carriers], memory(sim), sim.domain, began)


def _present_points(sim):
    return {name: getattr(sim.particles, name)[: sim.particles.owned] for name in point_fields(sim)}


def for_file(sim):
    """What a checkpoint keeps: number of the step, memory, and tables of the state from which a run is to go on.

    That is the present one, or that in which the present increment or trial of the stage began. Tables are (name,
    keys (n,), columns by name) of the points, then of each carrier, one after the other; rows are sorted by their keys,
    and `State.of_tables` takes the columns back. Collective.
    """
    began = sim.stages[sim.stage_number].begun_with
    kept = memory(sim) if began is None else began.memory
    return kept["simulation"]["step_number"], kept, _tables(sim, began)


def _tables(sim, began):
    points = _present_points(sim) if began is None else began.points
    order = np.argsort(points["id"], kind="stable")
    columns = {name: array[order] for name, array in points.items()}
    yield "points", columns["id"], columns
    for number, held in enumerate(sim.bonds.carriers):
        rows = own_rows(sim, held) if began is None else began.rows[number]
        columns = {"ids": rows.ids, "stress": rows.stress, "state": rows.state}
        yield f"rows_{held.index}", rows.ids[:, 0], columns


def own_rows(sim, held) -> Carried:
    """The active ones of the rows `held`, and of those at rest, whose first end is an owned point, sorted by ids."""
    pairs, layout = sim.bonds.pairs, held.layout
    index, first, _, _ = layout.holders(held, pairs)
    rows = np.flatnonzero(held.active & (first[index] < sim.particles.owned))
    ids, place = layout.keys(held, pairs)
    listed = Carried.of_active(ids[place[rows]], held.stress[rows], held.state[rows])
    if held.resting is None:
        return listed
    own, p = held.resting, sim.particles
    first = rows_of(p.id, own.ids[:, 0])
    mine = (first >= 0) & (first < p.owned)
    return listed.together(Carried.of_active(own.ids[mine], own.stress[mine], own.state[mine]))


def memory(sim) -> dict:
    """What the parts remember, as plain numbers and texts in nested dictionaries and lists."""
    return {
        "simulation": sim.memory(),
        "time_step": sim.time_step.memory(),
        "stage": sim.stages[sim.stage_number].memory(),
        "observers": [kept for o in sim.observers if (kept := o.memory())],
        "contacts": [c.memory() for c in _remembering(sim, "contacts")],
        "loads": [load.memory() for load in _remembering(sim, "loads")],
    }


def recall(sim, memory: dict) -> None:
    """Give every part its memory back. Raises StateError if something is not there."""
    try:
        _recall(sim, memory)
    except KeyError as name:
        raise StateError(f"it does not remember {name}") from None


def _recall(sim, memory):
    sim.recall(memory["simulation"])
    sim.time_step.recall(memory["time_step"])
    sim.stages[sim.stage_number].recall(sim, memory["stage"])
    for part, remembered in (
        *zip([o for o in sim.observers if o.memory()], memory["observers"], strict=True),
        *zip(_remembering(sim, "contacts"), memory["contacts"], strict=True),
        *zip(_remembering(sim, "loads"), memory["loads"], strict=True),
    ):
        part.recall(remembered)


def _remembering(sim, kind: str):
    parts = [part for stage in sim.stages for part in getattr(stage, kind) if hasattr(part, "memory")]
    return list(dict.fromkeys(parts))


def resume(sim, state: State) -> None:
    """Put a simulation that was built, but not started, into a state that was read from a file.

    Raises StateError if the state does not belong to this scene, or to this version of the program.
    """
    if set(state.points) != set(point_fields(sim)):
        differing = ", ".join(sorted(set(state.points) ^ set(point_fields(sim))))
        raise StateError(f"it has other fields of the points ({differing})")
    widths = [rows.state.shape[1] for rows in state.rows]
    if widths != [held.columns for held in sim.bonds.carriers]:
        raise StateError("it has other state variables of the materials")
    sim.bonds.initial_stress = None  # a row without a past is a point that lands
    install(sim, distributed(sim, state))
    initial = state.memory["simulation"]["initial_kinetic"]
    sim.ledger = Ledger(sim.comm, sim.particles, initial, sim.departures, sim.sleep, sim.reactions)


def distributed(sim, state: State) -> State:
    """The state with every point, and the rows whose first end it is, on the rank that owns its place.

    Places are those where the neighbours were found.
    """
    comm, names, columns = sim.comm, list(state.points), list(state.points.values())
    ids, place = state.points["id"], state.points["reference_position"]
    holders = [np.searchsorted(ids, rows.ids[:, 0]) for rows in state.rows]
    weight = sum((np.bincount(h, minlength=len(ids)) for h in holders), np.ones(len(ids)))
    domain = decomposition.bisect(comm, place, weight, sim.halo.whole)
    owner = domain.owner(place)
    points = dict(zip(names, _sent(comm, columns, owner), strict=True))
    order = np.argsort(points["id"], kind="stable")
    points = {name: array[order] for name, array in points.items()}
    rows = [
        _in_order(*_sent(comm, [held.ids, held.stress, held.state], owner[h]))
        for held, h in zip(state.rows, holders, strict=True)
    ]
    return State(points, rows, state.memory, domain)


def _sent(comm, columns, target):
    """Rows of the 8-byte arrays `columns` after each has gone to its rank `target` (n,)."""
    rows = pack(columns)
    outgoing = {r: rows[target == r] for r in np.unique(target).tolist() if r != comm.rank}
    arrived = exchange_rows(comm, outgoing, rows.shape[1])
    rows = np.concatenate([rows[target == comm.rank], arrived])
    result, start = [], 0
    for column in columns:
        width = 1 if column.ndim == 1 else column.shape[1]
        part = np.ascontiguousarray(rows[:, start : start + width]).view(column.dtype)
        result.append(part[:, 0] if column.ndim == 1 else part)
        start += width
    return result


def _in_order(ids, stress, state) -> Carried:
    order = np.lexsort((ids[:, 1], ids[:, 0]))
    return Carried.of_active(*(np.ascontiguousarray(a[order]) for a in (ids, stress, state)))


def install(sim, state: State) -> None:
    """Put the simulation into a state whose points are on their ranks (`state.domain`).

    Raises StateError if its rows are not between neighbours.
    """
    p, bonds, points = sim.particles, sim.bonds, awake_first(state.points)
    recall(sim, state.memory)
    sim.stages[sim.stage_number].begun_with = state.begun_with
    sim.domain = state.domain
    # neighbours as they were found: the same pairs are listed for as long as in a run that was not interrupted
    owned = {f.name: points[f.name] for f in p.migrating()}
    found_at = owned | {"position": owned["reference_position"]}
    sim.halo.rebuild(p, sim.domain, found_at, sim.ghost_reach)
    for held, rows in zip(bonds.carriers, state.rows, strict=True):
        held.carried, held.resting = _shared(sim, rows), None
    bonds.rebuild(p, sim.reach)
    lost = sum(len(r.stress) - len(own_rows(sim, h).stress) for h, r in zip(bonds.carriers, state.rows, strict=True))
    if sim.comm.allreduce(lost) != 0:
        raise StateError("its rows are not between neighbours of this scene")
    for contact in sim.stages[sim.stage_number].contacts:
        contact.add_stiffness(p, sim.time, 0.0, np.zeros(p.owned))  # looks for candidates while points stand there
    p.position[: p.owned] = owned["position"]
    for name in sim.forces.names:
        getattr(p, f"{name}_force")[: p.owned] = points[f"{name}_force"]
    sim.halo.update(p, *[f.name for f in p.migrating() if f.sent])
    sim.find_shapes()
    for process in sim.point_processes:
        if hasattr(process, "fill_total"):
            process.fill_total(p, bonds)
    if sim.sleep is not None:  # what points that fall asleep keep is that of the last step
        sim.sleep.put_back(p, sim.halo, owned)


def _shared(sim, rows: Carried) -> Carried:
    """The rows together with those whose second end is ours and whose first end is another rank's."""
    p = sim.particles
    packed = rows.packed(rows.active)
    second = rows_of(p.id, original(rows.ids[:, 1]))
    receives = sim.halo.receives.items()
    outgoing = {r: packed[(second >= ghosts.start) & (second < ghosts.stop)] for r, ghosts in receives}
    arrived = exchange_rows(sim.comm, outgoing, packed.shape[1])
    packed = np.concatenate([packed, arrived])
    end = 2 + rows.stress.shape[1]
    return _in_order(np.ascontiguousarray(packed[:, :2]).view(np.int64), packed[:, 2:end], packed[:, end:])
