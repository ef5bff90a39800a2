"""Ghosts: copies of other ranks' points within reach of ours.

Three verbs: `migrate` hands points to the rank that owns their place, `rebuild` finds the ghosts, `update`
refreshes named fields of the ghosts from their owners. There is no "accumulate": a bond across a rank boundary
is computed on both sides from the same numbers, which makes results independent of the decomposition.
"""

import numpy as np
from mpi4py import MPI

from periporo.core.points.departures import GONE
from periporo.core.points.particles import Particles, awake_first, depth_of_sleep, joined, picked
from periporo.core.ranks.domain import Domain, distance
from periporo.core.ranks.halving import exchange_rows
from periporo.core.ranks.images import Images


def pack(arrays: list[np.ndarray]) -> np.ndarray:
    """Columns of 8-byte arrays side by side as float64 rows; integers keep their bits."""
    columns = [a[:, None] if a.ndim == 1 else a for a in arrays]
    return np.hstack([np.ascontiguousarray(a).view(np.float64) for a in columns])


def _table(owned, fields, rows):
    return pack([owned[f.name][rows] for f in fields])


class Halo:
    """Ghost exchange of one rank with its neighbours."""

    def __init__(self, comm: MPI.Comm):
        self.comm = comm
        self.sends: dict[int, np.ndarray] = {}  # neighbour rank -> owned rows it holds as ghosts
        self.receives: dict[int, slice] = {}  # neighbour rank -> its ghost rows here
        self.boundary_rows = np.empty(0, np.int64)  # owned rows that are a ghost anywhere
        self.bytes_sent = 0
        self.messages_sent = 0
        self.points_migrated = 0
        self._exchanges: dict[tuple[str, ...], _Exchange] = {}
        self.images: Images | None = None  # of points behind mirrors and beyond seams

    @property
    def alone(self) -> bool:
        """Whether no point is a copy of another, on any rank."""
        return self.comm.size == 1 and self.images is None

    @property
    def whole(self) -> tuple[int, ...]:
        """Axes along which space is not divided among the ranks."""
        return () if self.images is None else tuple(self.images.periods)

    def migrate(self, particles: Particles, owner: np.ndarray) -> dict[str, np.ndarray]:
        """Owned fields after each point moved to its new `owner` (owned,), or is `GONE`.

        Rows are in id order; sleepers stand last, as by `awake_first`.
        """
        stays = owner != GONE
        owned = particles.take(slice(0, particles.owned) if stays.all() else np.flatnonzero(stays))
        owner = owner[stays]
        if self.comm.size > 1:
            leaving = owner != self.comm.rank
            self.points_migrated += int(leaving.sum())
            fields = particles.migrating()
            outgoing = {r: _table(owned, fields, owner == r) for r in np.unique(owner[leaving]).tolist()}
            arrived = exchange_rows(self.comm, outgoing, sum(f.columns or 1 for f in fields))
            if leaving.any() or len(arrived):  # otherwise everything is as it was
                column = 0
                for f in fields:
                    width = f.columns or 1
                    part: np.ndarray = np.ascontiguousarray(arrived[:, column : column + width]).view(f.dtype)
                    part = part[:, 0] if f.columns is None else part
                    owned[f.name] = joined(picked(owned[f.name], ~leaving), part)
                    column += width
        order = np.argsort(owned["id"], kind="stable")
        if "asleep" in owned:
            order = order[np.argsort(depth_of_sleep(owned)[order], kind="stable")]
        if (order[1:] > order[:-1]).all():
            return owned
        return {name: picked(array, order) for name, array in owned.items()}

    def rebuild(self, particles: Particles, domain: Domain, owned: dict[str, np.ndarray], reach: float) -> None:
        """Install the `owned` fields and find every ghost within `reach` m of this rank's box, and every image."""
        self.close()
        owned = awake_first(owned)
        if self.images is not None:
            self.images.settle(owned["position"])
        near = domain.near(reach)
        rows_near = {rank: np.flatnonzero(distance(box, owned["position"]) < reach) for rank, box in near.items()}
        self.sends = {rank: rows for rank, rows in rows_near.items() if len(rows)}
        arriving = self._counts({rank: len(rows) for rank, rows in rows_near.items()})
        again = dict(owned) if self.images is not None else {}
        particles.replace(owned, sum(arriving.values()))
        self.receives, start = {}, particles.owned
        for rank, count in arriving.items():
            if count:
                self.receives[rank] = slice(start, start + count)
                start += count
        copied = [np.empty(0, np.int64), *self.sends.values()]
        if self.images is not None:
            self._exchange(particles, ("position",))
            self.close()
            ghosts = particles.total - particles.owned
            particles.replace(again, ghosts + self.images.find(particles, reach))
            copied.append(self.images.rows)
        self.boundary_rows = np.unique(np.concatenate(copied))
        self.boundary_rows = self.boundary_rows[self.boundary_rows < particles.owned]
        names = [f.name for f in particles.fields.values() if f.migrates and f.sent]
        self.update(particles, *names)

    def _counts(self, outgoing: dict[int, int]) -> dict[int, int]:
        """How many points each of some ranks will send, of ranks that all know how many they will be sent."""
        received = {rank: np.empty(1, np.int64) for rank in outgoing}
        sent = [np.array([count]) for count in outgoing.values()]
        requests = [self.comm.Irecv(count, rank) for rank, count in received.items()]
        requests += [self.comm.Isend(count, rank) for rank, count in zip(outgoing, sent, strict=True)]
        MPI.Request.Waitall(requests)
        return {rank: int(count[0]) for rank, count in received.items()}

    def update(self, particles: Particles, *names: str) -> None:
        """Refresh the ghosts' rows of the named fields, by one message to each neighbour, and the images'."""
        self._exchange(particles, names)
        if self.images is not None:
            self.images.fill(particles, names)

    def _exchange(self, particles, names):
        if not self.sends and not self.receives:
            return
        if names not in self._exchanges:
            self._exchanges[names] = _Exchange(self, particles, names)
        exchange = self._exchanges[names]
        exchange.run()
        self.bytes_sent += exchange.bytes
        self.messages_sent += len(self.sends)

    def reset_counters(self) -> None:
        """Forget what was sent so far, for example to distribute the points at the start."""
        self.bytes_sent = self.messages_sent = self.points_migrated = 0

    def close(self) -> None:
        """Free the persistent requests."""
        for exchange in self._exchanges.values():
            exchange.free()
        self._exchanges = {}


class _Exchange:
    """Persistent requests and buffers for one set of fields, valid until the next rebuild."""

    def __init__(self, halo: Halo, particles: Particles, names: tuple[str, ...]):
        arrays = [getattr(particles, n) for n in names]
        widths = [particles.fields[n].columns or 1 for n in names]
        self.outgoing, self.incoming, requests = [], [], []
        self.bytes = 0
        for rank, rows in halo.sends.items():
            buffer = np.empty(sum(widths) * len(rows))
            parts = _parts(buffer, arrays, widths, len(rows))
            self.outgoing += [(array, rows, part) for array, part in zip(arrays, parts, strict=True)]
            requests.append(halo.comm.Send_init(buffer, rank))
            self.bytes += buffer.nbytes
        for rank, ghosts in halo.receives.items():
            count = ghosts.stop - ghosts.start
            buffer = np.empty(sum(widths) * count)
            parts = _parts(buffer, arrays, widths, count)
            self.incoming += [(array[ghosts], part) for array, part in zip(arrays, parts, strict=True)]
            requests.append(halo.comm.Recv_init(buffer, rank))
        self.requests = requests

    def run(self) -> None:
        for array, rows, buffer in self.outgoing:
            np.take(array, rows, axis=0, out=buffer, mode="clip")  # others are buffered once more
        MPI.Prequest.Startall(self.requests)
        MPI.Request.Waitall(self.requests)
        for target, buffer in self.incoming:
            target[...] = buffer

    def free(self) -> None:
        for request in self.requests:
            request.Free()


def _parts(buffer, arrays, widths, count):
    """Views of a message, one contiguous block for each field."""
    start = 0
    for array, width in zip(arrays, widths, strict=True):
        block = buffer[start : start + width * count].view(array.dtype)
        yield block.reshape((count, *array.shape[1:]))
        start += width * count
