"""Points are given to the ranks that own their places, and neighbours found anew: before they have moved too far."""

from collections.abc import Callable

import numpy as np

from periporo.core.points.departures import GONE, LOOK_INTERVAL, Departures
from periporo.core.points.particles import joined, picked
from periporo.core.ranks.domain import Domain, bisect
from periporo.core.ranks.reductions import any_rank, exact_sum, maxima, maximum
from periporo.errors import ContactError, place_text

THINNEST = 0.1
"""Skin, over the largest, at the start and at least."""
_OFTEN, _SELDOM = 60, 150  # steps between rebuilds that call for a thicker, or a thinner, skin
_PASSED = 0.5  # spacings behind a plane of symmetry, from which on a point has met its image and gone on
_LEFT = "has passed the obstacle; give the contact more stiffness, or the scene a domain that points leave before"
_ENTERED = (
    "has passed its faces; let bodies that are torn meet more slowly, or on a finer spacing, give their contact more "
    "stiffness, or the scene a domain that grains leave before"
)
_IMBALANCE = 1.07  # of the bonds per rank, above which space is divided anew


def rebuild(sim, arrive: Callable[[Domain], dict[str, np.ndarray]] | None = None) -> None:
    """Give points to the ranks that own their places, and find ghosts and neighbours anew.

    New points come whose migrating fields `arrive` gives for this rank's part of a division of space.
    """
    p = sim.particles
    refuse_breaches(sim)
    adapt_skin(sim)
    others_sleep = sim.sleep is not None and sim.sleep.decide(sim)
    if sim.halo.images is not None:
        sim.halo.images.take_back(p)
    before, sim.domain = sim.domain, _divided(sim)
    owner = sim.domain.owner(p.position[: p.owned])
    if sim.departures is not None:
        owner[_departing(sim, sim.departures)] = GONE
    sim.bonds.collect(sim.comm, p, owner, others_sleep, sim.domain is not before)
    sim.forces.forget()
    owned = sim.halo.migrate(p, owner)
    owned["reference_position"] = owned["position"].copy()
    if arrive is not None:
        arriving = arrive(sim.domain)
        order = np.argsort(np.concatenate([owned["id"], arriving["id"]]), kind="stable")
        owned = {name: picked(joined(array, arriving[name]), order) for name, array in owned.items()}
    sim.farthest = max([sim.reach, *(reach_of(owned) for reach_of in sim.reaches)])
    sim.halo.rebuild(p, sim.domain, owned, sim.ghost_reach)
    sim.bonds.rebuild(p, sim.reach)
    sim.moved = 0.0
    sim.rebuild_count += 1
    sim.rebuilt_at = sim.step_number


def neighbours_are_stale(sim) -> bool:
    """Whether a point somewhere has moved half of the skin since the neighbours were found.

    Or whether one is to wake, or to sleep, or has left the scene, or a law refused the last step: then there is no
    telling where points are.
    """
    if sim.departures is not None:
        looks = sim.step_number % LOOK_INTERVAL == 0
        if len(sim.departures.condemned) or (looks and sim.departures.outside(sim.particles).any()):
            sim.moved = np.inf
    if sim.sleep is not None and sim.sleep.look(sim):
        sim.moved = np.inf
    moved, way = maxima(sim.comm, np.array([np.inf if sim.refusals else sim.moved, sim.way])).tolist()
    sim.fastest = way / sim.dt if sim.dt > 0.0 else 0.0
    return not moved <= 0.5 * sim.skin


def refuse_breaches(sim, how: str = "") -> None:
    """Raise ContactError, on all ranks alike, if a point is behind an obstacle, or in a body; `how` it got there."""
    found = [c.breach for c in sim.contacts if getattr(c, "breach", None) is not None]
    if sim.halo.images is not None:
        depth, place = sim.halo.images.deepest(sim.particles)
        if depth > _PASSED * sim.spacing:
            found.append((depth, place, "symmetry"))
    if not any_rank(sim.comm, bool(found)):
        return
    breaches = [b for of_rank in sim.comm.allgather(found) for b in of_rank]
    depth, place, name = max(breaches, key=lambda b: (np.isnan(b[0]), b[0], tuple(b[1])))
    where = "over a hole" if np.isnan(depth) else f"{depth:.3g} m behind its surface"
    if np.isinf(depth):
        where, how = "inside of it", how or _ENTERED
    raise ContactError(f"{name}: a point at ({place_text(place, sim.origin, 4)}), {where}, {how or _LEFT}")


def _departing(sim, departures: Departures) -> np.ndarray:
    """Which owned points (owned,) leave now; their energy is booked."""
    leaving = departures.leaving(sim.particles)
    departures.condemned = departures.condemned[:0]
    count = sim.comm.allreduce(int(leaving.sum()))
    if count:
        departures.count += count
        departures.sums += exact_sum(sim.comm, departures.energies(sim.particles, leaving))
    return leaving


def adapt_skin(sim) -> None:
    """Make the skin thin while points move slowly, so that few pairs are listed in vain.

    Pairs beyond the horizon have no effect at all, so this changes the cost and not a bit of the result.
    """
    steps = sim.step_number - sim.rebuilt_at
    if steps > _SELDOM:
        sim.skin = max(0.7 * sim.skin, THINNEST * sim.largest_skin)
    elif 0 < steps < _OFTEN:
        sim.skin = min(sim.skin / 0.7, sim.largest_skin)


def _divided(sim) -> Domain:
    """Space divided among the ranks: at first, and anew when the numbers of bonds have become too unequal."""
    p = sim.particles
    if sim.domain is not None:
        if sim.comm.size == 1:
            return sim.domain
        mine = float(len(sim.bonds.pairs.first))
        mean = sim.comm.allreduce(mine) / sim.comm.size
        if maximum(sim.comm, mine) <= _IMBALANCE * mean:
            return sim.domain
    weight = np.ones(p.owned) if sim.domain is None else sim.bonds.pairs.per_point(p.total)[: p.owned]
    return bisect(sim.comm, p.position[: p.owned], weight, sim.halo.whole)
