"""Pairs of neighbours against a search over all pairs."""

from types import SimpleNamespace

import numpy as np
import pytest

from periporo.core.numerics.algebra import DIMENSION
from periporo.core.points.neighbours import Pairs


def points(position, *, ids=None, owned=None, group=None):
    n, d = position.shape
    return SimpleNamespace(
        fields={},
        id=np.arange(n) if ids is None else ids, position=position, total=n, dim=DIMENSION[d],
        owned=n if owned is None else owned, group=np.zeros(n, np.int64) if group is None else group,
    )  # fmt: skip


def search(p, reach):
    """Pairs (lower id, higher id) in order, over all pairs of points."""
    found = []
    for i in range(p.total):
        for j in range(i):
            near = ((p.position[i] - p.position[j]) ** 2).sum() < reach**2
            if near and p.group[i] == p.group[j] and min(i, j) < p.owned:
                found.append(sorted((int(p.id[i]), int(p.id[j]))))
    return np.array(sorted(found)).reshape(-1, 2)


def check(p, reach):
    pairs = Pairs()
    pairs.find(p, reach)
    assert (pairs.ids == search(p, reach)).all() and len(pairs.ids) == len(search(p, reach))
    assert (p.id[pairs.first] == pairs.ids[:, 0]).all() and (p.id[pairs.second] == pairs.ids[:, 1]).all()
    assert len(pairs.weight) == len(pairs.ids) and not pairs.weight.any()
    return pairs


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("reach", [0.05, 0.3, 3.0])
def test_all_pairs_in_id_order(d, reach):
    rng = np.random.default_rng(d)
    position = rng.uniform(-1, 1, (150, d))
    pairs = check(points(position, ids=rng.permutation(10_000)[:150]), reach)
    if reach == 3.0:
        assert len(pairs.ids) == 150 * 149 // 2 if d == 2 else True  # more pairs than were made room for


def test_groups_do_not_pair():
    rng = np.random.default_rng(1)
    pairs = check(points(rng.uniform(size=(80, 2)), group=rng.integers(0, 3, 80)), 0.3)
    assert len(pairs.ids)


def test_ghosts_do_not_pair_with_each_other():
    rng = np.random.default_rng(1)
    check(points(rng.uniform(size=(80, 3)), owned=50, ids=rng.permutation(80)), 0.4)


def test_distance_equal_to_the_reach_is_outside():
    pairs = check(points(np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.25]])), 0.5)
    assert pairs.ids.tolist() == [[0, 2]]


def test_a_point_flung_far_away_costs_no_memory():
    position = np.vstack([np.random.default_rng(0).uniform(size=(50, 3)), [[1e9, -1e9, 1e9]]])
    assert len(check(points(position), 0.4).ids)


def test_nan_positions_pair_with_nothing():
    position = np.random.default_rng(0).uniform(size=(30, 2))
    position[7] = np.nan
    pairs = check(points(position), 0.4)
    assert len(pairs.ids) and not (pairs.ids == 7).any()


@pytest.mark.parametrize("n", [0, 1])
def test_too_few_points_for_a_pair(n):
    check(points(np.zeros((n, 2))), 1.0)
