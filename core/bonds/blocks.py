"""Blocks: the rows of one material, or of the links, with the state that they carry through neighbour rebuilds."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from periporo.core.numerics.jit import kernel
from periporo.core.numerics.tensors import INDEX_PAIRS
from periporo.core.points.given import Given
from periporo.core.points.material import Material, StepRefused, UpdatesFailed, state_columns
from periporo.core.points.neighbours import Keys, Pairs, original
from periporo.core.points.opening import Opening
from periporo.core.points.particles import Particles, rows_of, scalars
from periporo.core.ranks.halo import pack


class Rows:
    """Rows laid out by a `layout`, with stress and state that they carry through neighbour rebuilds."""

    def __init__(self, layout, index: int, components: int, columns: int):
        self.layout = layout
        self.index = index
        self.columns = columns
        self.pair = np.empty(0, np.uint32)  # what the layout makes of a row: see there
        self.side = np.empty(0, np.int8)
        self.start = np.zeros(1, np.int64)
        self.first, self.second = np.empty(0, np.uint32), np.empty(0, np.uint32)
        self.integrity, self.fraction = np.empty(0), np.empty(0)
        self.shape_inverse, self.gradient = np.empty((0, 0)), np.empty((0, 0))
        self.active = np.empty(0, np.bool_)
        self.stress = np.empty((0, components))
        self.state = np.empty((0, columns))
        self.carried: Carried | None = None
        self.resting: Carried | None = None  # active rows between points that sleep, which are not among these

    def restore(self, peers, pairs: Pairs, particles: Particles) -> None:
        """Find the rows among new `pairs` and give back what was set aside; `peers` share the pairs with them.

        Rows whose points sleep stay aside.
        """
        n = self.layout.choose(self, peers, pairs, particles)
        source = np.full(n, -1, np.int32)
        self.stress, self.state = np.zeros((n, self.stress.shape[1])), np.zeros((n, self.columns))
        if self.carried is not None:
            old = self.carried
            (keys, place), before = self.layout.keys(self, pairs), Keys.of(old.ids)
            _match(keys.first, keys.second, keys.id, place,
                   before.first, before.second, before.id, old.place, old.active, source)  # fmt: skip
            _copy_rows(source, old.stress, self.stress)
            _copy_rows(source, old.state, self.state)
            self.carried = None
            rest, _ = old.parted(particles)
            self.resting = rest if self.resting is None else self.resting.beside(rest)
        self.active = source >= 0


class Block(Rows):
    """The rows of one material: contiguous slices of every bond array, and its own state columns."""

    def __init__(self, material: Material, layout, index: int, components: int):
        super().__init__(layout, index, components, state_columns(material, components))
        self._adopt(material, components)
        self.average = f"average_{index}"  # point field: has state, stress, state
        tensors, logs, start = [], [], 0
        self.axes = scalars(1) + INDEX_PAIRS[:components]  # of the columns of `average`
        for field in material.state_fields:
            width = field.columns(components)
            if field.kind == "tensor":
                tensors.append(start)
            self.axes += tuple(tuple("xyz".index(a) for a in label) for label in field.labels(components))
            logs += [field.merge == "log_mean"] * width
            start += width
        self.tensor_columns = np.array(tensors, np.int64)
        self.log_columns = np.array(logs, np.bool_)
        self.rows = slice(0, 0)
        self.total: np.ndarray | None = None  # stress with that of pore water, if there is any
        self.pore_stiffness: Callable[[Block], np.ndarray] | None = None  # of water that cannot leave, Pa
        self.held_moduli = None  # what `elastic_moduli` answers while stress and state are only a trial
        self.strain_increment = np.empty((0, components))
        self.given = Given.of(material, components)
        self.spin = np.empty((0, 1))  # (rows, 1|3) of the step, if the law asks how its rows turn
        self.values: np.ndarray | None = None  # (n, k) of the parameters that vary from row to row, if any do
        self.refused: tuple[np.ndarray, str] | None = None  # rows that refuse the step, and the reason
        self.failed: list[np.ndarray] = []  # rows whose update failed in the step
        # of the strains in a step since `forget_peak`: square of the largest, and its row; its ids after a rebuild
        self.peak, self.peak_ids = np.array([0.0, -1.0]), np.full(2, -1)

    def use(self, law: Material) -> None:
        """Go on with another law of the same state; one that varies is bound to the rows."""
        varied: Any = law
        self._adopt(law if self.values is None else varied.for_rows(self.values), self.stress.shape[1])

    def _adopt(self, law, components):
        """Take the law, and note once what it says of itself: to look for a name that a law lacks takes a while."""
        self.material, self.opening = law, Opening.of(law, components)
        self.conservative = bool(getattr(law, "conservative", False))
        self.flows = self.opening is not None and not self.conservative
        self.exchanges = self.flows and bool(getattr(law, "exchanges_stress", False))
        told = getattr(law, "dilatancy", 0.0) if self.exchanges else 0.0  # by the name others may mean another thing
        self.dilatancy = np.atleast_1d(np.asarray(told, float))  # (1,), or (rows,) where it varies

    def law_of(self, rows) -> Material:
        """The law of some of the rows."""
        varied: Any = self.material
        return self.material if self.values is None else varied.part(rows)

    def forget_peak(self) -> None:
        """Start to look for the largest strain anew."""
        self.peak[:], self.peak_ids = (0.0, -1.0), np.full(2, -1)

    @property
    def total_stress(self) -> np.ndarray:
        """What forces come from, (rows, 4|6) Pa: the laws' stress, in wet soil with the water's."""
        return self.stress if self.total is None else self.total

    @property
    def keeps_all(self) -> bool:
        """Whether all of the trial stress is kept: by an elastic law, or while the moduli are held."""
        return self.held_moduli is not None or self.conservative

    def advance(self, dt: float) -> None:
        """Let the law take a step of `dt` s in all rows; those that it refuses, or that fail, are remembered.

        Rows that have come apart close first, without stress (`periporo.core.points.opening`).
        """
        rows = self.stress, self.strain_increment, self.state
        if self.opening is None:
            self.take(*rows, dt)
        else:
            self.opening.advance(self.active, *rows, lambda: self.elastic_moduli()[0], lambda: self.take(*rows, dt))

    def take(self, stress, strain_increment, state, dt: float, rows=None) -> None:
        """Let the law take a step in arrays that stand for the `rows` of this block, or for all of them."""
        law = self.material if rows is None else self.law_of(rows)
        try:
            law.compute_stress(stress, strain_increment, state, dt)
        except StepRefused as refusal:
            if self.refused is None:  # the first reason is the one that counts
                self.refused = refusal.rows if rows is None else rows[refusal.rows], refusal.reason
        except UpdatesFailed as failure:
            self.failed.append(failure.rows if rows is None else rows[failure.rows])

    def elastic_moduli(self) -> tuple[np.ndarray, np.ndarray]:
        """Bulk and shear modulus of the rows, two (n,) arrays in Pa."""
        if self.held_moduli is not None:
            return self.held_moduli
        return self.material.elastic_moduli(self.stress, self.state)

    def stiffness(self) -> tuple[np.ndarray, np.ndarray]:
        """Bulk and shear modulus of rows and of water that cannot leave them, two (n,) arrays in Pa."""
        bulk, shear = self.elastic_moduli()
        return bulk if self.pore_stiffness is None else bulk + self.pore_stiffness(self), shear

    def stiffest(self, moduli: tuple[np.ndarray, np.ndarray]) -> float:
        """Largest P-wave modulus (Pa) of active rows whose bulk and shear `moduli` these are; 0 without rows."""
        bulk, shear = moduli
        return float((bulk + 4.0 / 3.0 * shear)[self.active].max(initial=0.0))


@dataclass
class Carried:
    """State of rows on its way through a rebuild, sorted by the ids of their ends, `ids`[`place`]."""

    ids: np.ndarray | Keys
    place: np.ndarray
    active: np.ndarray  # the others are dropped
    stress: np.ndarray
    state: np.ndarray
    whole: bool = False  # row by row as listed, and all active

    def packed(self, chosen) -> np.ndarray:
        """Ids, stress and state of the rows where `chosen` (n,), in one table."""
        rows = np.flatnonzero(chosen)
        return pack([self.ids[self.place[rows]], self.stress[rows], self.state[rows]])

    def beside(self, other: "Carried | None") -> "Carried":
        """The active rows of both, none of which has the ids of another; not sorted."""
        if other is None:
            return self
        return Carried.of_active(*(np.concatenate(b) for b in zip(self._active(), other._active(), strict=True)))

    def together(self, other: "Carried | None") -> "Carried":
        """The active rows of both, sorted."""
        if other is None:
            return self
        both = self.beside(other)
        order = np.lexsort((both.ids[:, 1], both.ids[:, 0]))
        return Carried.of_active(both.ids[order], both.stress[order], both.state[order])

    def parted(self, p: Particles) -> tuple["Carried | None", "Carried | None"]:
        """The active rows of which both ends sleep, and one is owned, and the others; None for none."""
        if "asleep" not in p.fields or p.awake == p.total:
            return None, self
        ids, stress, state = self._active()
        sleeps = np.append(p.asleep != 0, False)  # the last stands for points that are not here
        i, j = rows_of(p.id, original(ids).ravel()).reshape(-1, 2).T  # by column: along rows of two NumPy is slow
        rests = sleeps[i] & sleeps[j] & (np.minimum(i, j) < p.owned)
        if rests.all():
            return Carried.of_active(ids, stress, state), None
        of_both = [np.flatnonzero(rests), np.flatnonzero(~rests)]
        resting, others = (Carried.of_active(ids[k], stress[k], state[k]) if len(k) else None for k in of_both)
        return resting, others

    def _active(self):
        if self.whole:
            return self.ids, self.stress, self.state
        rows = np.flatnonzero(self.active)
        return self.ids[self.place[rows]], self.stress[rows], self.state[rows]

    @classmethod
    def of_active(cls, ids, stress, state) -> "Carried":
        """Of rows that are all active, one for each of the `ids`."""
        return cls(ids, np.arange(len(ids), dtype=np.uint32), np.ones(len(ids), bool), stress, state, True)


@kernel
def _match(first, second, id, pair, old_first, old_second, old_id, old_pair, old_active, source):
    """For each row the active old row with the same ids, or -1; both lists are in id order."""
    k = 0
    for r in range(pair.shape[0]):
        lower, higher = id[first[pair[r]]], id[second[pair[r]]]
        while k < old_pair.shape[0]:
            i, j = old_id[old_first[old_pair[k]]], old_id[old_second[old_pair[k]]]
            if i > lower or (i == lower and j >= higher):
                if i == lower and j == higher and old_active[k]:
                    source[r] = k
                break
            k += 1


@kernel
def _copy_rows(source, old, new):
    """Row source[r] of `old` becomes row r of `new`, where there is one."""
    for r in range(source.shape[0]):
        if source[r] >= 0:
            for c in range(new.shape[1]):
                new[r, c] = old[source[r], c]
