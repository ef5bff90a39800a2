"""What is built and dug when a stage begins: points that are taken away, and points that are put in place."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from periporo.core.motion.rebuilds import rebuild
from periporo.core.numerics.tensors import INDEX_PAIRS, square_lengths
from periporo.core.points import fields
from periporo.core.points.particles import INHERITED, Field, Particles
from periporo.core.ranks.reductions import exact_sum, minimum
from periporo.errors import ContactError, place_text

_CLOSE = 0.5  # spacings that points must be apart


@dataclass
class Construction:
    """At the start of a stage the points `removed` (sorted ids) are gone, with their stress, energy and work.

    `arrive` gives the fields of new points that belong to this rank (see `rebuild`); they come without
    stress. `names` and `ids` of what arrives, for messages. The points `changed` (sorted ids) become the material
    `into` (numbers), with the stress and the volume that they have. `doubt` looks at what stands then, and raises what
    it cannot bear.
    """

    removed: np.ndarray
    arrive: Callable[..., dict[str, np.ndarray]] | None = None
    names: str = ""
    ids: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))
    changed: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))
    into: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))
    doubt: Callable[..., None] | None = None

    @staticmethod
    def attach(p: Particles) -> None:
        """Declare what points that change their material keep for their new one."""
        p.add_field(Field(INHERITED, p.components, "Pa", axes=INDEX_PAIRS[: p.components]))

    def carry_out(self, sim) -> None:
        """Take away and put in place, and find neighbours and forces anew; collective. Raises ContactError."""
        p = sim.particles
        if len(self.removed):
            sim.departures.condemned = np.union1d(sim.departures.condemned, self.removed)
        if len(self.changed):
            self._change(sim)
        rebuild(sim, self.arrive)
        if self.arrive is not None:
            self._refuse_overlaps(sim)
            new = np.isin(p.id[: p.owned], self.ids)
            kinetic = 0.5 * p.mass[new] * square_lengths(np.ascontiguousarray(p.velocity[: p.owned][new]))
            sim.ledger.initial_kinetic += float(exact_sum(sim.comm, kinetic)[0])
        dt, sim.dt = sim.dt, 0.0
        sim.bonds.inherits = len(self.changed) > 0
        sim.evaluate_forces()  # of the same strains: no time passes
        sim.bonds.inherits = False
        sim.dt = dt
        if self.doubt is not None:
            self.doubt(sim)

    def _change(self, sim):
        """Give points their new material: rows without a past begin with the stress that these points have now."""
        p, n = sim.particles, sim.particles.owned
        place = np.searchsorted(self.changed, p.id[:n]).clip(max=len(self.changed) - 1)
        rows = np.flatnonzero(self.changed[place] == p.id[:n])
        into = self.into[place[rows]]
        getattr(p, INHERITED)[:n] = 0.0
        getattr(p, INHERITED)[rows] = fields.values(sim, ("stress",))["stress"][rows]
        density = np.array([material.density for material in sim.materials])
        gained = p.volume[rows] * (density[into] - density[p.material[rows]])
        kinetic = 0.5 * gained * square_lengths(np.ascontiguousarray(p.velocity[rows]))
        sim.ledger.initial_kinetic += float(exact_sum(sim.comm, kinetic)[0])
        p.material[rows] = into
        p.mass[rows] += gained

    def _refuse_overlaps(self, sim):
        """Raise ContactError, on all ranks alike, if a new point is too close to another."""
        p, pairs = sim.particles, sim.bonds.pairs
        x = p.position[pairs.second] - p.position[pairs.first]
        new = np.isin(p.id[pairs.first], self.ids) | np.isin(p.id[pairs.second], self.ids)
        length = np.sqrt(square_lengths(np.ascontiguousarray(x))) + np.where(new, 0.0, np.inf)
        nearest = minimum(sim.comm, float(length.min(initial=np.inf)))
        if nearest < _CLOSE * sim.spacing:
            mine = int(length.argmin()) if len(length) else -1
            found = (length[mine], p.position[pairs.first[mine]].tolist()) if mine >= 0 else (np.inf, [])
            _, place = min(sim.comm.allgather(found))
            raise ContactError(
                f"{self.names} cannot be placed: points would be {nearest:.3g} m apart at "
                f"({place_text(place, sim.origin, 4)}), less than half a spacing; remove what is there first"
            )
