"""Division of space on one rank, and the geometry of boxes; tests/mpi divides on several."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.ranks.domain import bisect, distance
from periporo.core.ranks.halving import Level, levels

BOX = np.array([[-np.inf, -np.inf], [1.0, 0.5]])


def test_one_rank_owns_everything():
    domain = bisect(MPI.COMM_SELF, np.random.default_rng(0).normal(size=(20, 3)), np.ones(20))
    assert domain.cuts == [] and np.isinf(domain.box).all()
    anywhere = np.array([[1e9, 0.0, -1e9], [np.nan, 0.0, np.inf]])
    assert domain.owns(anywhere).all() and not domain.owner(anywhere).any()
    assert domain.near(1.0) == {}


def test_distance_to_faces_and_corners():
    position = np.array([[0.5, 0.0], [2.0, 0.0], [0.0, 0.8], [1.3, 0.9]])
    assert np.allclose(distance(BOX, position), [0.0, 1.0, 0.3, 0.5], rtol=1e-14)


@pytest.mark.parametrize(("first", "last"), [(0, 2), (3, 6), (0, 7), (5, 13)])
def test_every_rank_of_a_group_is_sent_to_by_one_partner_or_two(first, last):
    """And what is sent is received: a rank is among the sources of its partner, and of nobody else."""
    group = [Level(rank, first, first + (last - first) // 2, last) for rank in range(first, last)]
    for level in group:
        assert (level.partner >= level.middle) != level.upper
        receivers = [other.rank for other in group if level.rank in other.sources]
        assert receivers == [level.partner] and len(level.sources) <= 2


@pytest.mark.parametrize("ranks", [2, 255, 256, 10_000])
def test_levels_grow_as_the_logarithm_of_the_ranks(ranks):
    for rank in {0, 1, ranks // 3, ranks - 1}:
        halved = levels(SimpleNamespace(rank=rank, size=ranks))
        assert len(halved) in (math.ceil(math.log2(ranks)), math.floor(math.log2(ranks)))
        assert max(len(level.sources) for level in halved) <= 2
