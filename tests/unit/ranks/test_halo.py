"""Messages and the verbs of the halo on one rank; tests/mpi repeats them on several."""

import numpy as np
from mpi4py import MPI

from periporo.core.points.particles import Particles
from periporo.core.ranks.domain import bisect
from periporo.core.ranks.halo import Halo, pack
from periporo.core.ranks.halving import exchange_rows


def test_pack_keeps_every_bit_of_integers_and_numbers():
    ids = np.array([[1, 2**63 - 1], [-5, 0]])
    numbers = np.array([np.nan, -0.0])
    rows = pack([ids, numbers, np.ones((2, 3))])
    assert rows.shape == (2, 6) and rows.dtype == np.float64
    assert (np.ascontiguousarray(rows[:, :2]).view(np.int64) == ids).all()
    assert (np.ascontiguousarray(rows[:, 2]).view(np.int64) == numbers.view(np.int64)).all()


def test_exchange_of_nothing():
    assert exchange_rows(MPI.COMM_SELF, {}, 4).shape == (0, 4)


def test_exchange_with_oneself():
    rows = np.arange(6.0).reshape(3, 2)
    assert (exchange_rows(MPI.COMM_SELF, {0: rows}, 2) == rows).all()


def test_verbs_on_one_rank_sort_points_by_id_and_make_no_ghosts():
    rng = np.random.default_rng(0)
    particles, n = Particles(2), 12
    owned = {f.name: rng.normal(size=(n,) if f.columns is None else (n, f.columns)).astype(f.dtype)
             for f in particles.migrating()}  # fmt: skip
    owned["id"] = rng.permutation(100)[:n]
    particles.replace(dict(owned), 0)
    halo = Halo(MPI.COMM_SELF)
    domain = bisect(MPI.COMM_SELF, particles.position, np.ones(n))
    order = np.argsort(owned["id"])
    moved = halo.migrate(particles, domain.owner(particles.position))
    assert all((moved[name] == owned[name][order]).all() for name in owned)
    halo.rebuild(particles, domain, moved, reach=10.0)
    halo.update(particles, "position", "velocity")
    assert particles.owned == particles.total == n and not len(halo.boundary_rows)
    assert halo.messages_sent == halo.bytes_sent == 0
    halo.close()
