"""A law whose parameters vary from row to row.

`VariedLaw` looks like any other law. It is bound to rows by the values that their parameters have; what it is asked of
rows it has each row's own law answer. Rows with equal values share a law, and are answered together; a law that offers
`of_rows(laws, components)` answers all at once.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from periporo.core.points.material import Material, StepRefused, UpdatesFailed

_BY_ROW = ("tension_limit", "derived_state")
_MADE_ANEW = ("weakened", "for_unsaturated")


class VariedLaw:
    """Laws that differ in the parameters `varied`; `make` gives the law of their values.

    `base` answers for what does not depend on the row; `laws` are those of the rows, none before they are known.
    """

    def __init__(self, base: Material, varied: tuple[str, ...], make: Callable[[tuple[float, ...]], Material]):
        self.base = base
        self.varied = varied
        self._make = make
        self._known: dict[bytes, Material] = {}
        self._laws: list[Material] | None = None
        self._fast: dict[int, Any] = {}
        self._groups: list[tuple[Material, np.ndarray]] | None = None

    def law(self, values: np.ndarray) -> Material:
        """The law with the `values` (k,) of what varies. Raises what the law raises for values that it refuses."""
        key = values.tobytes()
        if key not in self._known:
            self._known[key] = self._make(tuple(values.tolist()))
        return self._known[key]

    def for_rows(self, values: np.ndarray) -> "VariedLaw":
        """The same law, bound to rows with `values` (n, k)."""
        return self._of([self.law(row) for row in np.ascontiguousarray(values)])

    def part(self, rows) -> "VariedLaw":
        """The same law, bound to some of its rows."""
        laws = self._laws or []
        return self._of([laws[k] for k in np.arange(len(laws))[rows]])  # NumPy asks laws in an array if they are arrays

    def _of(self, laws: list[Material]) -> "VariedLaw":
        bound = VariedLaw(self.base, self.varied, self._make)
        bound._known, bound._laws = self._known, laws
        return bound

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        own = getattr(self.base, name)
        if name in _BY_ROW and self._laws is not None:
            return lambda stress, state: self._answers(name, stress, state)
        if name in _MADE_ANEW:
            return lambda *arguments: self._changed(name, arguments)
        return own

    def _changed(self, name, arguments) -> "VariedLaw":
        """The law that a method of each law makes of it."""
        changed = VariedLaw(
            getattr(self.base, name)(*arguments), self.varied,
            lambda values: getattr(self._make(values), name)(*arguments),
        )  # fmt: skip
        changed._laws = None if self._laws is None else [getattr(law, name)(*arguments) for law in self._laws]
        return changed

    @cached_property
    def density(self) -> float:
        """The least of the rows, which makes the fastest waves; that of the base before rows are known."""
        return min((law.density for law in self._laws or ()), default=self.base.density)

    @cached_property
    def dilatancy(self) -> np.ndarray:
        """Those of the rows, (rows,), or that of the base, (1,), before rows are known; AttributeError if it has none.
        """
        laws: list[Any] = [self.base] if self._laws is None else self._laws
        return np.array([law.dilatancy for law in laws], float)

    @property
    def state_fields(self):
        """Those of every one of the laws."""
        return self.base.state_fields

    @property
    def default_output(self) -> tuple[str, ...]:
        """What results hold without being asked: what the law names, and the parameters that vary."""
        return (*getattr(self.base, "default_output", ()), *(f"parameter_{name}" for name in self.varied))

    def initial_state(self, stress: np.ndarray, ids: np.ndarray, volume: np.ndarray) -> np.ndarray:
        """As `Material.initial_state`."""
        if self._laws is None:
            return self.base.initial_state(stress, ids, volume)
        state = None
        for law, rows in self._grouped(len(stress)):
            own = stress[rows]
            found = law.initial_state(own, ids[rows], volume[rows])
            stress[rows] = own
            state = np.zeros((len(stress), found.shape[1])) if state is None else state
            state[rows] = found
        return self.base.initial_state(stress, ids, volume) if state is None else state

    def compute_stress(
        self, stress: np.ndarray, strain_increment: np.ndarray, state: np.ndarray, dt: float
    ) -> None:
        """As `Material.compute_stress`."""
        fast = self._quick(stress)
        if fast is not None:
            fast.compute_stress(stress, strain_increment, state, dt)
            return
        refused, failed = [], []
        for law, rows in self._grouped(len(stress)):
            parts = stress[rows], strain_increment[rows], state[rows]
            try:
                law.compute_stress(*parts, dt)
            except StepRefused as refusal:
                refused.append((rows[refusal.rows], refusal.reason))
            except UpdatesFailed as failure:
                failed.append((rows[failure.rows], failure.reason))
            stress[rows], state[rows] = parts[0], parts[2]
        if refused:
            raise StepRefused(np.sort(np.concatenate([rows for rows, _ in refused])), refused[0][1])
        if failed:
            raise UpdatesFailed(np.sort(np.concatenate([rows for rows, _ in failed])), failed[0][1])

    def elastic_moduli(self, stress: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `Material.elastic_moduli`."""
        return self._answers("elastic_moduli", stress, state)

    def _answers(self, name, stress, state):
        """What a method of the laws that takes stress and state gives, rows together again."""
        fast = self._quick(stress)
        if fast is not None and hasattr(fast, name):
            return getattr(fast, name)(stress, state)
        if self._laws is None or not len(stress):
            return getattr(self.base, name)(stress, state)
        result: Any = None
        for law, rows in self._grouped(len(stress)):
            answer = getattr(law, name)(stress[rows], state[rows])
            if result is None:
                result = _empty_like(answer, len(stress))
            _put(result, answer, rows)
        return result

    def _quick(self, stress):
        """What answers for all rows at once, if the law offers it."""
        components = stress.shape[1]
        if self._laws is None or not hasattr(type(self.base), "of_rows"):
            return None
        if components not in self._fast:
            self._fast[components] = type(self.base).of_rows(self._laws, components) if self._laws else None
        return self._fast[components]

    def _grouped(self, count: int) -> list[tuple[Material, np.ndarray]]:
        """Each law with its rows."""
        if self._laws is None:
            return [(self.base, np.arange(count))]
        if len(self._laws) != count:
            raise ValueError(f"the law is bound to {len(self._laws)} rows, not {count}")
        if self._groups is None:
            number: dict[int, int] = {}
            which = np.array([number.setdefault(id(law), len(number)) for law in self._laws], np.int64)
            order = np.argsort(which, kind="stable")
            ends = np.cumsum(np.bincount(which, minlength=len(number)))
            parts = np.split(order, ends[:-1]) if count else []
            self._groups = [(self._laws[rows[0]], rows) for rows in parts]
        return self._groups


def _empty_like(answer, n: int):
    """Room for the answers of all rows: an array, or a tuple or dictionary of them."""
    if isinstance(answer, tuple):
        return tuple(_empty_like(part, n) for part in answer)
    if isinstance(answer, dict):
        return {name: _empty_like(part, n) for name, part in answer.items()}
    return np.empty((n, *answer.shape[1:]), answer.dtype)


def _put(result, answer, rows) -> None:
    if isinstance(answer, tuple):
        for whole, part in zip(result, answer, strict=True):
            _put(whole, part, rows)
    elif isinstance(answer, dict):
        for name, part in answer.items():
            _put(result[name], part, rows)
    else:
        result[rows] = answer
