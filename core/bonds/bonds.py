"""Bonds: the rows on which materials live, with the state they carry through neighbour rebuilds."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from periporo.core.bonds.averages import average_points, incidence_of
from periporo.core.bonds.blocks import Block, Carried, Rows
from periporo.core.bonds.rows import LinkRows
from periporo.core.points.departures import GONE
from periporo.core.points.material import Material
from periporo.core.points.neighbours import Pairs, original
from periporo.core.points.particles import Field, Particles, rows_of
from periporo.core.ranks.halving import exchange_rows

_NO_POINTS = np.empty(0, np.int64)


@dataclass(frozen=True)
class Refusal:
    """A law that refused a step, why, and the ids of the points whose rows these are."""

    law: str
    reason: str
    points: np.ndarray


class RefusedStep(RuntimeError):
    """A law could not follow a step; raised on all ranks alike. `points` are the ids of this rank's offenders.

    `kind` is that of the fault, as `periporo.core.watch.diagnosis` knows it.
    """

    def __init__(self, message: str, reason: str, points: np.ndarray, kind: str = "refused"):
        super().__init__(f"{message}. The time step is too long for it, or the law fails in this state")
        self.reason = reason
        self.points = points
        self.kind = kind


class Bonds:
    """Pairs of neighbours, and for each material a block of constitutive rows.

    `layout` says where the rows lie (`periporo.core.bonds.rows`), and whether there are `links` besides: a row for each
    pair with one number, in Pa, that belongs to the scheme. A row is active, that is has state, while its bond is
    shorter than the horizon and its points are regular.
    """

    def __init__(self, particles: Particles, materials: list[Material], layout):
        self.layout = layout
        self.pairs = Pairs()
        self.blocks = [Block(m, layout, k, particles.components) for k, m in enumerate(materials)]
        self.links = Rows(LinkRows(), len(materials), 1, 0) if layout.linked else None
        self._incidence: tuple[np.ndarray, np.ndarray] | None = None
        self.tries = False  # stress and state are a trial's: what links are strained by need not be kept
        self.inherits = False  # whether rows without a past have the stress that their points had in another material
        self.time, self.origin = 0.0, np.zeros(particles.dimension)  # s, m: what laws are told that ask for them
        self.initial_stress_is_total = False  # of wet soil: the laws' is that without the water's
        # stress (n, 4|6) of rows without a past, as a function of their places (n, d)
        self.initial_stress: Callable[[np.ndarray], np.ndarray] | None = None
        for block in self.blocks:
            particles.add_field(Field(block.average, len(block.axes), "", migrates=False, axes=block.axes, sparse=True))
        for field in layout.fields(particles.dimension, particles.components):
            particles.add_field(field)

    @property
    def carriers(self) -> list[Rows]:
        """All rows that last through rebuilds, in the order of their `index`."""
        return [*self.blocks, *([] if self.links is None else [self.links])]

    def collect(
        self, comm, particles: Particles, owner: np.ndarray, others_sleep: bool = True, divided: bool = True
    ) -> None:
        """Set the active rows' state aside for a rebuild, sharing it with the points' new owners.

        Rows between sleepers stay where they are, unless `others_sleep` now, and an end of theirs is awake, or space is
        `divided` anew.
        """
        moved = np.unique(owner[(owner != comm.rank) & (owner != GONE)]).tolist() if comm.size > 1 else []
        for block in self.blocks:
            block.peak_ids, block.peak[1] = self.peak_ends(block), -1.0
        for rows in self.carriers:
            ids, place = rows.layout.keys(rows, self.pairs)
            carried = Carried(ids, place, rows.active, rows.stress, rows.state)
            rested = rows.resting if others_sleep or divided else None
            if rested is not None:
                rows.resting, woken = (None, rested) if divided else rested.parted(particles)
                carried = carried.together(woken)
            outgoing = {}
            if moved:
                ends = self._ends_of(particles, rows, carried, rested is not None)
                home = np.full(particles.total + 1, comm.rank)  # also of points that are not known here, -1
                home[: particles.owned] = owner
                leaves = {r: (home[ends[0]] == r) | (home[ends[1]] == r) for r in moved}
                outgoing = {r: carried.packed(carried.active & goes) for r, goes in leaves.items()}
            rows.carried = carried if comm.size == 1 else self._share(comm, carried, outgoing)

    def _ends_of(self, particles, held, carried, sorts):
        """Rows of the points at both ends of `carried` rows, -1 for unknown ones; those `held`, unless it `sorts` them.
        """
        if not sorts:
            place, first, second, _ = held.layout.holders(held, self.pairs)
            return first[place], second[place]
        return rows_of(particles.id, original(carried.ids[carried.place]).ravel()).reshape(-1, 2).T

    def _share(self, comm, carried, outgoing):
        """`carried` with the rows of points that come to this rank; nothing is copied if none come."""
        width = 2 + carried.stress.shape[1] + carried.state.shape[1]
        arrived = exchange_rows(comm, outgoing, width)
        if not len(arrived):
            return carried
        rows = np.concatenate([carried.packed(carried.active), arrived])
        ids = np.ascontiguousarray(rows[:, :2]).view(np.int64)
        order = np.lexsort((ids[:, 1], ids[:, 0]))
        fresh = np.ones(len(order), bool)
        fresh[1:] = (ids[order[1:]] != ids[order[:-1]]).any(axis=1)
        rows = rows[order[fresh]]
        components = carried.stress.shape[1]
        return Carried.of_active(
            np.ascontiguousarray(rows[:, :2]).view(np.int64),
            np.ascontiguousarray(rows[:, 2 : 2 + components]),
            np.ascontiguousarray(rows[:, 2 + components :]),
        )

    def rebuild(self, particles: Particles, reach: float) -> None:
        """Find the pairs within `reach` m and give back the state that `collect` set aside."""
        self.pairs.find(particles, reach)
        particles.note_pairs(self.pairs.first, self.pairs.second)
        start = 0
        for block in self.blocks:
            block.restore(self.blocks, self.pairs, particles)
            n = len(block.pair)
            block.rows = slice(start, start + n)
            start += n
            block.strain_increment = np.zeros((n, particles.components))
            if block.given is not None and block.given.turns:
                block.spin = np.zeros((n, 1 if particles.dimension == 2 else 3))
            if getattr(block.material, "varied", ()):
                block.values = self._values(block, particles)
                block.use(block.material)
        if self.links is not None:
            self.links.restore([self.links], self.pairs, particles)
        self._incidence = None

    def incidence(self, particles: Particles) -> tuple[np.ndarray, np.ndarray]:
        """Where the rows of each point begin in a list of all, and that list; made when it is asked for."""
        if self._incidence is None:
            holders = [self.layout.holders(b, self.pairs) for b in self.blocks]
            first, second = (np.concatenate([h[end][h[0]] for h in holders]) for end in (1, 2))
            self._incidence = incidence_of(first, second, particles.total)
        return self._incidence

    def _values(self, block, particles) -> np.ndarray:
        """What varies of a block's rows, (n, k): the mean of their ends, as far as these are of its material."""
        index, first, second, _ = self.layout.ends(block, self.pairs)
        ends = first[index].astype(np.int64), second[index].astype(np.int64)
        own = [particles.material[end] == block.index for end in ends]
        columns = []
        for name in block.material.varied:
            at = [getattr(particles, f"parameter_{name}")[end] for end in ends]
            columns.append(np.where(own[0] & own[1], 0.5 * (at[0] + at[1]), np.where(own[0], *at)))
        return np.stack(columns, axis=1)

    def peak_ends(self, block) -> np.ndarray:
        """Ids (2,) of the ends of the row that had the largest strain, -1 if there was none."""
        if block.peak[1] < 0.0:
            return block.peak_ids
        ids, place = self.layout.keys(block, self.pairs)
        return original(ids[place[int(block.peak[1])]])

    def refusals(self) -> list[Refusal]:
        """What laws refused since this was last asked, of this rank."""
        found = []
        for block in self.blocks:
            if block.refused is not None:
                (rows, reason), block.refused = block.refused, None
                ids, place = self.layout.keys(block, self.pairs)
                found.append(Refusal(type(block.material).__name__, reason, np.unique(original(ids[place[rows]]))))
        return found

    def failures(self, owned: int) -> tuple[int, np.ndarray]:
        """Active rows whose update failed since this was last asked, and the owned points that hold them.

        Each row is counted where its first end is among the `owned`.
        """
        count, points = 0, _NO_POINTS
        for block in self.blocks:
            while block.failed:
                rows = block.failed.pop()
                rows = rows[block.active[rows]]
                index, first, second, _ = self.layout.holders(block, self.pairs)
                ends = first[index[rows]].astype(np.int64), second[index[rows]].astype(np.int64)
                count += int(np.count_nonzero(ends[0] < owned))
                points = np.union1d(points, np.concatenate([end[end < owned] for end in ends]))
        return count, points

    def average(self, particles: Particles, points: np.ndarray) -> None:
        """Average stress and state of the active rows of each owned point in `points` (rows), per block.

        The weights are w V of the other end; the result goes to the block's point field, whose first column
        says whether the point has any active row. Points that sleep have their own.
        """
        for block in self.blocks:
            average_points(
                points,
                *self.incidence(particles),
                block.rows.start,
                block.rows.stop,
                *self.layout.ends(block, self.pairs),
                block.active,
                particles.volume,
                block.stress,
                block.state,
                block.log_columns,
                particles.own(block.average),
            )
            if block.resting is not None:
                rest = block.resting
                average = np.hstack([np.ones((len(rest.stress), 1)), rest.stress, rest.state])
                getattr(particles, block.average)[rows_of(particles.id, rest.ids[:, 0])] = average

    def total_stress(self, particles: Particles, points: np.ndarray, stress: np.ndarray) -> None:
        """Fill `stress` (total, 4|6) Pa of the owned `points` (rows) with the mean of what their rows exert."""
        stress[points] = 0.0
        known, mean = np.zeros(len(points)), np.zeros((particles.total, 1 + stress.shape[1]))
        for block in self.blocks:
            rows = block.rows.start, block.rows.stop, *self.layout.ends(block, self.pairs), block.active
            average_points(
                points, *self.incidence(particles), *rows, particles.volume, block.total_stress,
                np.empty((len(block.pair), 0)), np.empty(0, np.bool_), mean,
            )  # fmt: skip
            known += mean[points, 0]
            stress[points] += mean[points, 1:]
        stress[points] /= np.maximum(known, 1.0)[:, None]

    def book(self, particles: Particles, block: Block, rows: np.ndarray, work: np.ndarray, sums: np.ndarray) -> None:
        """Add the `work` (n,) J of `rows` of a block to `sums` (owned,) of the points that hold them: half to each end.
        """
        index, first, second, _ = self.layout.holders(block, self.pairs)
        for end in (first[index[rows]], second[index[rows]]):
            mine = end < particles.owned
            np.add.at(sums, end[mine], 0.5 * work[mine])

    def tell(self, particles: Particles) -> None:
        """Write into the state of active rows what their law asks for, at the end of the step."""
        for block in self.blocks:
            given = block.given
            if given is None:
                continue
            rows = np.flatnonzero(block.active)
            state, spin = block.state[rows], block.spin[rows] if given.turns else block.spin
            places = self.places(particles, *self.ends(block, rows))
            given.tell(state, block.strain_increment[rows], spin, places, self.time)
            block.state[rows] = state

    def places(self, particles, first, second):
        """Where rows between two points each are, (n, d) m."""
        return self.origin + 0.5 * (particles.position[first] + particles.position[second])

    def ends(self, block, rows):
        """The two points that each of the rows lies between."""
        place, first, second, _ = self.layout.ends(block, self.pairs)
        return first[place[rows]], second[place[rows]]
