"""State of bonds: carried through rebuilds, given to newborn rows, averaged at points, shared by two materials."""

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.bonds.rows import BOTH, FIRST, SECOND
from periporo.core.motion.rebuilds import rebuild
from periporo.core.points.material import StateField
from periporo.materials.elastic import Elastic

SPACING = 0.01


class Recorder:
    """A law without stress that keeps its state, of every kind, and counts what it was asked."""

    density = 1000.0
    state_fields = (
        StateField("pressure", "Pa", merge="log_mean"),
        StateField("back_stress", "Pa", kind="tensor"),
        StateField("hardening", "1"),
    )

    def __init__(self):
        self.born = []

    def initial_state(self, stress, ids, volume):
        self.born.append((ids.copy(), volume.copy(), stress.copy()))
        state = np.zeros((len(stress), 2 + stress.shape[1]))
        state[:, 0] = -1.0
        return state

    def compute_stress(self, stress, strain_increment, state, dt):
        assert not strain_increment.any()

    def elastic_moduli(self, stress, state):
        return np.full(len(stress), 1e6), np.full(len(stress), 1e6)


def deform(sim, dt=0.0):
    sim.scheme.deform(sim.particles, sim.bonds, sim.halo, dt, np.inf)


def by_ids(sim, block):
    """Stress and state of the active rows by the ids of their ends."""
    rows = np.flatnonzero(block.active)
    ids = map(tuple, sim.bonds.pairs.ids[block.pair[rows]].tolist())
    return {pair: (block.stress[r].copy(), block.state[r].copy()) for pair, r in zip(ids, rows, strict=True)}


def same(one, other, keys):
    """Whether the bonds `keys` have the same bits in both."""
    return all((one[k][0] == other[k][0]).all() and (one[k][1] == other[k][1]).all() for k in keys)


def randomise(block, seed=0):
    rng = np.random.default_rng(seed)
    block.stress[:] = 1e3 * rng.normal(size=block.stress.shape)
    block.state[:] = rng.normal(size=block.state.shape)
    block.state[:, 0] = -np.exp(3 * rng.normal(size=len(block.state)))


def move(sim, displacement):
    """Displace the points and find the neighbours anew; what the bonds carried through the rebuild."""
    sim.particles.position[: sim.particles.owned] += displacement
    rebuild(sim)
    carried = by_ids(sim, sim.bonds.blocks[0])
    deform(sim)
    return carried


@pytest.mark.parametrize("counts", [(6, 5), (4, 3, 4)])
def test_rebuild_gives_every_surviving_bond_its_state_back(cloud, grid, counts):
    sim = cloud(grid(*counts, spacing=SPACING, jitter=0.2), laws=[Recorder()], fixed=1e-6)
    block = sim.bonds.blocks[0]
    randomise(block)
    before = by_ids(sim, block)
    shift = 0.25 * SPACING * np.random.default_rng(1).uniform(-1, 1, sim.particles.position.shape)
    carried = move(sim, shift)
    assert same(carried, before, carried)
    after = by_ids(sim, block).keys()
    kept = before.keys() & after
    assert kept <= carried.keys() and len(kept) < len(before) and len(kept) < len(after)  # some died, some were born


def test_a_bond_that_left_and_came_back_is_newborn(cloud, grid):
    sim = cloud(grid(5, 4, spacing=SPACING), laws=[Recorder()], fixed=1e-6)
    block = sim.bonds.blocks[0]
    randomise(block)
    before = by_ids(sim, block)
    away = np.zeros((20, 2))
    away[0] = -1.2 * SPACING
    move(sim, away)
    assert len(by_ids(sim, block)) < len(before)
    move(sim, -away)
    after = by_ids(sim, block)
    changed = [k for k in before if after[k][1] != pytest.approx(before[k][1], rel=1e-12)]
    assert changed == [k for k in before if 0 in k]


def averages(sim, bonds, point):
    """Weighted averages of `bonds` (see `by_ids`) at a point from the definition; logarithmic for the pressure."""
    influence = dict(zip(map(tuple, sim.bonds.pairs.ids.tolist()), sim.bonds.pairs.weight, strict=True))
    keys = [k for k in bonds if point in k]
    weight = np.array([influence[k] * sim.particles.volume[sum(k) - point] for k in keys])
    values = np.array([np.concatenate(bonds[k]) for k in keys])
    mean = (weight[:, None] * values).sum(axis=0) / weight.sum()
    log = sim.particles.components
    mean[log] = -np.exp((weight * np.log(-values[:, log])).sum() / weight.sum())
    return mean


def test_point_averages_are_weighted_and_logarithmic(cloud, grid):
    sim = cloud(grid(6, 5, spacing=SPACING, jitter=0.2), laws=[Recorder()], fixed=1e-6)
    block = sim.bonds.blocks[0]
    randomise(block)
    sim.particles.volume[:] *= np.random.default_rng(2).uniform(0.5, 2, 30)
    sim.bonds.average(sim.particles, np.arange(30))
    found = getattr(sim.particles, block.average)
    assert (found[:, 0] == 1.0).all()
    for point in (0, 13, 29):
        assert found[point, 1:] == pytest.approx(averages(sim, by_ids(sim, block), point), rel=1e-12)


def test_newborn_row_takes_the_mean_of_its_ends(cloud, grid):
    """Stress, tensor and plain state by the mean, pressures by the mean of their logarithms."""
    position = grid(6, 5, spacing=SPACING)
    sim = cloud(position, laws=[Recorder()], fixed=1e-6)
    block = sim.bonds.blocks[0]
    first, second = 0, 10  # ids two columns apart: 2 spacings; moved out, then back in
    away = np.zeros((30, 2))
    away[first, 0] = -0.21 * SPACING
    move(sim, away)
    assert (first, second) not in by_ids(sim, block)
    randomise(block)
    known = by_ids(sim, block)
    move(sim, -0.02 * away / 0.21)
    new = by_ids(sim, block)
    assert new.keys() - known.keys() == {(first, second)}
    ends = [averages(sim, known, first), averages(sim, known, second)]
    stress, state = new[first, second]
    mean = 0.5 * (ends[0] + ends[1])
    mean[4] = -np.sqrt(ends[0][4] * ends[1][4])
    assert np.concatenate([stress, state]) == pytest.approx(mean, rel=1e-12)


def test_newborn_row_between_points_without_a_past_starts_from_the_initial_stress(cloud, grid):
    law = Recorder()
    sim = cloud(grid(5, 5, spacing=SPACING), laws=[law], fixed=1e-6, start=False)
    sim.bonds.initial_stress = lambda x: np.stack([x[:, 0], x[:, 1], 0 * x[:, 0], 1 + 0 * x[:, 0]], axis=1)
    sim.start()
    block, pairs = sim.bonds.blocks[0], sim.bonds.pairs
    middle = 0.5 * (sim.particles.position[pairs.first] + sim.particles.position[pairs.second])
    active = np.flatnonzero(block.active)
    assert block.stress[active][:, :2] == pytest.approx(middle[active], rel=1e-14)
    assert (block.stress[active][:, 3] == 1.0).all() and (block.state[active][:, 0] == -1.0).all()
    ids, volume, _ = law.born[0]
    assert (ids == pairs.ids[active]).all()
    assert volume == pytest.approx(np.full(len(ids), SPACING**2), rel=1e-13)  # the points', whatever the row's share
    assert sim.bonds.initial_stress is None  # a row without a past is now a point that lands
    randomise(block)
    away = np.zeros((25, 2))
    away[0] = -5 * SPACING
    move(sim, away)
    move(sim, -away)
    born = [r for r in by_ids(sim, block).items() if 0 in r[0]]
    assert born and all(r[1][0].any() for r in born)  # it takes what its neighbours have


def test_active_rows_are_the_pairs_within_the_horizon_whatever_the_list(cloud, grid):
    sim = cloud(grid(6, 5, spacing=SPACING, jitter=0.25), laws=[Recorder()], fixed=1e-6)
    p = sim.particles
    near = {(i, j) for i in range(30) for j in range(i + 1, 30)
            if ((p.position[i] - p.position[j]) ** 2).sum() < (2.2 * SPACING) ** 2}  # fmt: skip
    assert by_ids(sim, sim.bonds.blocks[0]).keys() == near
    assert len(sim.bonds.pairs.ids) > len(near)


def row_volumes(sim, block):
    return sim.bonds.layout.volumes(block, sim.bonds.pairs, sim.particles, np.arange(len(block.pair)))


@pytest.mark.parametrize("counts", [(7, 6), (4, 4, 4)])
def test_two_materials_share_the_volume_of_their_pairs(cloud, grid, counts):
    position = grid(*counts, spacing=SPACING, jitter=0.2)
    laws = [Elastic.example(), Recorder()]
    law_of = (np.arange(len(position)) % 3 == 0).astype(int)
    single = cloud(position, laws=laws[:1])
    sim = cloud(position, laws=laws, law_of=law_of, fixed=1e-6)
    whole = row_volumes(single, single.bonds.blocks[0])
    assert whole.sum() == pytest.approx(sim.particles.volume.sum(), rel=1e-13)
    shared = np.zeros(len(whole))
    for index, block in enumerate(sim.bonds.blocks):
        ends = law_of[sim.bonds.pairs.ids[block.pair]] == index
        side = np.where(ends.all(axis=1), BOTH, np.where(ends[:, 0], FIRST, SECOND))
        assert ends.any(axis=1).all() and (block.side == side).all()
        volume = row_volumes(sim, block)
        shared[block.pair] += volume
        own = sim.particles.volume[law_of == index].sum()
        assert volume.sum() == pytest.approx(own, rel=1e-13)  # each law stands for its points' volume
    assert shared == pytest.approx(whole, rel=1e-13)


def test_incidence_lists_the_rows_of_each_point_in_order(cloud, grid):
    position = grid(5, 5, spacing=SPACING)
    sim = cloud(position, laws=[Elastic.example(), Recorder()], law_of=np.arange(25) % 2, fixed=1e-6)
    pair = np.concatenate([b.pair for b in sim.bonds.blocks])
    ids, (start, incidence) = sim.bonds.pairs.ids[pair], sim.bonds.incidence(sim.particles)
    for point in range(25):
        rows = incidence[start[point] : start[point + 1]]
        assert rows.tolist() == np.flatnonzero((ids == point).any(axis=1)).tolist()


def test_collect_and_rebuild_without_motion_change_nothing(cloud, grid):
    sim = cloud(grid(6, 5, spacing=SPACING, jitter=0.2), laws=[Recorder()], fixed=1e-6)
    block = sim.bonds.blocks[0]
    randomise(block)
    deform(sim)
    before = by_ids(sim, block)
    sim.bonds.collect(MPI.COMM_SELF, sim.particles, np.zeros(30, int))
    sim.bonds.rebuild(sim.particles, sim.reach)
    after = by_ids(sim, block)
    assert before.keys() == after.keys() and same(before, after, before)
