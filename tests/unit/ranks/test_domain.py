"""Division of space on one rank, and the geometry of boxes; tests/mpi divides on several."""

import numpy as np
from mpi4py import MPI

from periporo.core.ranks.domain import Domain, bisect

# two boxes left of x = 1, cut at y = 0.5, and one to the right
CUTS = ((0, 0, 1.0, 2), (0, 1, 0.5, 1))
LOWER = np.array([[-np.inf, -np.inf], [-np.inf, 0.5], [1.0, -np.inf]])
UPPER = np.array([[1.0, 0.5], [1.0, np.inf], [np.inf, np.inf]])
DOMAIN = Domain(LOWER, UPPER, CUTS)


def test_one_rank_owns_everything():
    domain = bisect(MPI.COMM_SELF, np.random.default_rng(0).normal(size=(20, 3)), np.ones(20))
    assert domain.cuts == () and np.isinf(domain.lower).all() and np.isinf(domain.upper).all()
    assert not domain.owner(np.array([[1e9, 0.0, -1e9]])).any()
    assert domain.near(0, 1.0) == []


def test_owner_follows_the_cuts_and_a_point_on_a_cut_is_above_it():
    position = np.array([[0.0, 0.0], [0.0, 0.9], [2.0, 0.9], [1.0, 0.0], [0.0, 0.5]])
    assert DOMAIN.owner(position).tolist() == [0, 1, 2, 2, 1]


def test_owner_agrees_with_the_boxes():
    position = np.random.default_rng(0).uniform(-1, 3, (500, 2))
    owner = DOMAIN.owner(position)
    for rank in range(3):
        inside = ((position >= LOWER[rank]) & (position < UPPER[rank])).all(axis=1)
        assert (inside == (owner == rank)).all()
        assert ((DOMAIN.distance(rank, position) == 0.0) >= inside).all()


def test_distance_to_faces_and_corners():
    position = np.array([[0.5, 0.0], [2.0, 0.0], [0.0, 0.8], [1.3, 0.9]])
    assert np.allclose(DOMAIN.distance(0, position), [0.0, 1.0, 0.3, 0.5], rtol=1e-14)


def test_nan_is_owned_by_some_rank():
    assert DOMAIN.owner(np.array([[np.nan, np.nan]]))[0] in (0, 1, 2)


def test_near_counts_boxes_within_reach():
    lower = np.array([[-np.inf, -np.inf], [1.0, -np.inf], [2.0, -np.inf]])
    upper = np.array([[1.0, np.inf], [2.0, np.inf], [np.inf, np.inf]])
    strips = Domain(lower, upper, ())
    assert strips.near(0, 0.5) == [1]
    assert strips.near(0, 1.5) == [1, 2]
    assert strips.near(1, 0.1) == [0, 2]
