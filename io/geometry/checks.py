"""Checks of a scene's bodies: large enough, not empty, not overlapping."""

import math
from collections.abc import Iterator

import numpy as np

from periporo.errors import Problem, place_text
from periporo.io.geometry.files import file_problems, ground_problems
from periporo.io.geometry.lattice import CHUNK, Lattice, build_lattices
from periporo.io.geometry.origin import relative, scene_origin
from periporo.io.schema.base import MAX_LENGTH
from periporo.io.schema.bodies import Points
from periporo.io.schema.scene import SceneInput

MAX_SITES = 2 * 10**9
_EDGE = 1e-9  # of the spacing
_LIMITS = {
    "domain": "make the domain larger", "symmetry": "give only what lies on one side of the plane",
    "periodic": "give only what lies in the cell",
}  # fmt: skip


def geometry_problems(scene: SceneInput) -> Iterator[Problem]:
    """Bodies that are too small, too large, empty, or that overlap."""
    unusable = list(file_problems(scene))
    if unusable:
        yield from unusable
        return
    origin = scene_origin(scene)
    local = relative(scene, origin)
    lattices = build_lattices(local)
    problems = {k: message for k, lattice in enumerate(lattices) if (message := _size_problem(lattice, origin))}
    for k, message in problems.items():
        yield Problem(("bodies", k, "shape"), message)
    total = sum(lattice.size for lattice in lattices)
    if total > MAX_SITES:
        yield Problem(("spacing",), f"{total:.3g} points are too many (at most {MAX_SITES:.0e}); enlarge it")
    if problems or total > MAX_SITES:
        return
    yield from _domain_problems(scene, lattices, origin)
    yield from ground_problems(local, lattices, origin)
    touching, placed = scene.touching_bodies(), scene.placed_bodies()  # by their faces, wherever their points are
    for k, second in enumerate(lattices):
        others = [first for first in lattices[:k] if {first.body.name, second.body.name} not in touching]
        others = [first for first in others if placed.isdisjoint({first.body.name, second.body.name})]
        overlapped = [(first, place) for first in others if (place := find_overlap(first, second)) is not None]
        for first, place in overlapped:
            at = place_text(place, origin, 4)
            message = f"overlaps the body '{first.body.name}': points closer than half a spacing at ({at})"
            yield Problem(("bodies", k, "shape"), message)
        if not overlapped and not any(len(ids) for ids, *_ in second.chunks()):
            message = f"contains no point: it is thinner than the spacing ({second.spacing:g} m)"
            yield Problem(("bodies", k, "shape"), message)


def _domain_problems(scene: SceneInput, lattices: list[Lattice], origin: np.ndarray) -> Iterator[Problem]:
    """Bodies that reach out of the domain, behind a plane of symmetry, or out of a periodic cell."""
    for key, cure in _LIMITS.items():
        yield from _beyond(getattr(scene, key), key, cure, lattices, origin)


def _beyond(limits, key, cure, lattices, origin):
    for name, sign in (("lower", 1.0), ("upper", -1.0)):
        for a, bound in enumerate(getattr(limits, name, None) or ()):
            if bound is None:
                continue
            ends = [sign * (getattr(lattice, name)[a] + origin[a]) for lattice in lattices]
            k = int(np.argmin(ends))
            if ends[k] < sign * bound - _EDGE * lattices[k].spacing:
                reach = f"reaches to {sign * ends[k]:.6g} along {'xyz'[a]}"
                yield Problem((key, name), f"the body '{lattices[k].body.name}' {reach}; {cure}")


def _size_problem(lattice: Lattice, origin: np.ndarray) -> str | None:
    if isinstance(lattice.body.shape, Points):
        if max(np.abs(lattice.lower + origin).max(), np.abs(lattice.upper + origin).max()) > MAX_LENGTH:
            return f"the file has a coordinate beyond {MAX_LENGTH:g} m"
        return "the file has two points closer than half a spacing" if _has_close_rows(lattice) else None
    for axis, side in zip("xyz", lattice.upper - lattice.lower, strict=False):
        if side < 0.999 * lattice.spacing:
            return f"is {side:.3g} m long along {axis}, less than one spacing ({lattice.spacing:g} m)"
    return None


def _has_close_rows(lattice: Lattice) -> bool:
    positions = lattice.sites(0, lattice.size)[1]
    return close_pair(positions, positions, 0.5 * lattice.spacing, same=True) is not None


def find_overlap(first: Lattice, second: Lattice) -> np.ndarray | None:
    """A place (d,) m where two bodies have points closer than half a spacing, or None.

    Looks only where the bodies' boxes meet, slab by slab.
    """
    if first in second.company:
        return _contested_place(first, second)
    h = first.spacing
    margin = (1.0 + first.body.jitter + second.body.jitter) * h
    lower, upper = (
        np.maximum(first.lower, second.lower) - margin,
        np.minimum(first.upper, second.upper) + margin,
    )
    if (lower >= upper).any():
        return None
    for low, high in _slabs(first, lower, upper):
        a = first.sites_within(low, high)[1]
        b = second.sites_within(low - margin, high + margin)[1]
        place = close_pair(a, b, 0.5 * h)
        if place is not None:
            return place
    return None


def _contested_place(first: Lattice, second: Lattice) -> np.ndarray | None:
    """A site (d,) m of a common lattice that both bodies hold, or None."""
    lower, upper = np.maximum(first.lower, second.lower), np.minimum(first.upper, second.upper)
    for low, high in _slabs(first, lower, upper) if (lower < upper).all() else ():
        places = first.contested(second, low, high)
        if len(places):
            return places[0]
    return None


def _slabs(lattice: Lattice, lower: np.ndarray, upper: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The box from `lower` to `upper` in slabs along x that hold about CHUNK sites of `lattice` each."""
    layer = math.prod(lattice.counts[1:])
    count = max(1, math.ceil((upper[0] - lower[0]) / lattice.spacing / max(1, CHUNK // layer)))
    if lattice.table is not None:
        count = 1
    edges = np.linspace(lower[0], upper[0], count + 1)
    for start, stop in zip(edges, edges[1:], strict=False):
        yield np.array([start, *lower[1:]]), np.array([stop, *upper[1:]])


def close_pair(a: np.ndarray, b: np.ndarray, radius: float, same: bool = False) -> np.ndarray | None:
    """A row (d,) of `a` (n, d) that has a row of `b` (m, d) closer than `radius`, or None.

    With `same`, `a` and `b` are the same rows, and a row is not compared with itself.
    """
    if not len(a) or not len(b):
        return None
    origin = np.minimum(a.min(axis=0), b.min(axis=0)) - 1.5 * radius
    cells_a, cells_b = (np.floor((x - origin) / radius).astype(np.int64) for x in (a, b))
    counts = np.maximum(cells_a.max(axis=0), cells_b.max(axis=0)) + 2
    keys = _linear(cells_b, counts)  # may wrap around: cells then share a key, which costs time, not pairs
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    limit = radius * (1.0 - 1e-9)
    for shift in np.ndindex(*(3,) * a.shape[1]):
        wanted = _linear(cells_a + np.array(shift) - 1, counts)
        at, end = np.searchsorted(keys, wanted, "left"), np.searchsorted(keys, wanted, "right")
        rows = np.flatnonzero(at < end)
        while len(rows):
            others = order[at[rows]]
            close = np.sum((a[rows] - b[others]) ** 2, axis=1) < limit**2
            if same:
                close &= rows != others
            if close.any():
                return a[rows[np.argmax(close)]]
            at[rows] += 1
            rows = rows[at[rows] < end[rows]]
    return None


def _linear(cells: np.ndarray, counts: np.ndarray) -> np.ndarray:
    index = cells[:, 0]
    for axis in range(1, cells.shape[1]):
        index = index * counts[axis] + cells[:, axis]
    return index
