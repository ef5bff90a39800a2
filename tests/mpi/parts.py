"""Parts of the core on several ranks, each against what one rank would do; prints the names of the checks.

Run as: mpirun -n N python parts.py
"""

import dataclasses
import math
import traceback

import numpy as np
from mpi4py import MPI

from periporo import Simulation
from periporo.core.points.particles import Particles
from periporo.core.ranks.domain import bisect, distance
from periporo.core.ranks.halo import Halo
from periporo.core.ranks.halving import combine, exchange_rows, levels
from periporo.core.ranks.reductions import any_rank, exact_sum, maximum, minimum, quantile

COMM = MPI.COMM_WORLD
RANK, RANKS = COMM.rank, COMM.size
N = 500


def everyone(seed=0):
    """Values (N,) of all ranks together, over twelve decades."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=N) * 10.0 ** rng.uniform(-6, 6, N)


def mine(values, seed=0):
    """This rank's part of the rows of `values` when they are dealt out at random."""
    return values[np.random.default_rng(seed).integers(0, RANKS, len(values)) == RANK]


def check_sums_do_not_depend_on_the_distribution():
    values = everyone()
    for deal in range(5):
        assert exact_sum(COMM, mine(values, deal))[0] == math.fsum(values)
    bad = values.copy()
    bad[17] = np.nan
    two = np.stack([values, bad], axis=1)
    total = exact_sum(COMM, mine(two))
    assert total[0] == math.fsum(values) and math.isnan(total[1])


def check_extremes_and_quantiles():
    values = everyone(1)
    part = mine(values)
    assert maximum(COMM, part.max(initial=-np.inf)) == values.max()
    assert minimum(COMM, part.min(initial=np.inf)) == values.min()
    assert quantile(COMM, part, 0.9) == np.sort(values)[int(0.9 * N) - 1]
    assert math.isnan(maximum(COMM, math.nan if RANK == RANKS - 1 else 1.0))
    assert any_rank(COMM, RANK == RANKS - 1) and not any_rank(COMM, False)


def check_bisection_gives_equal_weights():
    rng = np.random.default_rng(2)
    for d in (2, 3):
        position, weight = rng.normal(size=(4000, d)) ** 3, rng.integers(1, 3, 4000)
        domain = bisect(COMM, mine(position), mine(weight))
        owner = domain.owner(position)
        loads = np.bincount(owner, weights=weight, minlength=RANKS)
        assert abs(loads - weight.sum() / RANKS).max() < 2.0 * RANKS  # a point or two at each cut
        assert (domain.owns(position) == (owner == RANK)).all()
        assert (distance(domain.box, position[owner == RANK]) == 0.0).all()
        assert bisect(COMM, mine(position, 1), mine(weight, 1)).cuts == domain.cuts
        for reach in (0.1, 3.0, 0.5):  # what was asked for last does not matter
            boxes = COMM.allgather(domain.box)
            gaps = [np.maximum(np.maximum(b[0] - domain.box[1], domain.box[0] - b[1]), 0.0) for b in boxes]
            close = [r for r, gap in enumerate(gaps) if (gap**2).sum() < reach**2 and r != RANK]
            near = domain.near(reach)
            assert list(near) == close and all((near[r] == boxes[r]).all() for r in close)
            assert (domain.owner(position) == owner).all()  # known without asking


def check_cuts_lie_between_rows_of_points():
    x, y = np.meshgrid(np.arange(24.0), np.arange(15.0))
    grid = np.stack([x.ravel(), y.ravel()], axis=1)
    domain = bisect(COMM, mine(grid), np.ones(len(mine(grid))))
    assert all(abs(cut % 1.0 - 0.5) < 1e-9 for _, cut in domain.cuts)
    counts = np.bincount(domain.owner(grid), minlength=RANKS)
    assert counts.sum() == len(grid) and counts.max() <= len(grid) / RANKS + 15


def check_bisection_with_fewer_points_than_ranks():
    position = np.zeros((1 if RANK == 0 else 0, 2))
    owner = bisect(COMM, position, np.ones(len(position))).owner(np.zeros((1, 2)))
    assert len(set(COMM.allgather(owner[0]))) == 1 and 0 <= owner[0] < RANKS


def check_rows_arrive_in_the_order_of_their_ranks():
    outgoing = {r: np.full((RANK + 1, 2), 100.0 * RANK + r) for r in range(RANKS) if r != RANK}
    rows = exchange_rows(COMM, outgoing, 2)
    expected = [100.0 * r + RANK for r in range(RANKS) if r != RANK for _ in range(r + 1)]
    assert rows[:, 0].tolist() == rows[:, 1].tolist() == expected


def check_groups_of_ranks_add_up_and_talk_in_turn():
    for level in levels(COMM):
        group = range(level.first, level.last)
        assert RANK in group and RANK in levels_of(level.partner, level).sources
        total = combine(COMM, level, np.array([RANK, 1.0]), np.add)
        assert total.tolist() == [sum(group), len(group)]
        assert combine(COMM, level, np.array([3.0 - RANK]), np.maximum)[0] == 3.0 - level.first
    assert len(levels(COMM)) <= math.ceil(math.log2(RANKS)) if RANKS > 1 else not levels(COMM)


def levels_of(rank, level):
    """A level as another rank of the group sees it."""
    return dataclasses.replace(level, rank=rank)


def cloud():
    """All points, the same on every rank, and this rank's at random."""
    rng = np.random.default_rng(5)
    particles = Particles(2)
    fields = {f.name: rng.normal(size=(N,) if f.columns is None else (N, f.columns)) for f in particles.migrating()}
    fields = {f.name: fields[f.name].astype(f.dtype) for f in particles.migrating()}
    fields["id"] = rng.permutation(10 * N)[:N]
    particles.replace({name: mine(values) for name, values in fields.items()}, 0)
    return particles, fields


def check_migration_and_ghosts(reach=0.3):
    particles, everything = cloud()
    by_id = {int(i): k for k, i in enumerate(everything["id"])}
    halo = Halo(COMM)
    domain = bisect(COMM, particles.position[: particles.owned], np.ones(particles.owned))
    owner = domain.owner(particles.position[: particles.owned])
    leaving = int((owner != RANK).sum())
    owned = halo.migrate(particles, owner)
    assert halo.points_migrated == leaving
    place = everything["id"][domain.owner(everything["position"]) == RANK]
    assert owned["id"].tolist() == sorted(place.tolist())
    halo.rebuild(particles, domain, owned, reach)
    n, total = particles.owned, particles.total
    rows = [by_id[i] for i in particles.id.tolist()]
    assert len(set(rows)) == total  # nobody is there twice
    for name, field in particles.fields.items():
        array = getattr(particles, name)
        if field.migrates:
            count = total if field.sent else n
            assert (array[:count] == everything[name][rows[:count]]).all()
    near = distance(domain.box, everything["position"]) < reach
    assert set(everything["id"][near].tolist()) == set(particles.id.tolist())
    assert set(halo.boundary_rows.tolist()) == set(np.concatenate([*halo.sends.values(), []]).astype(int).tolist())
    check_update(halo, particles, everything, rows)
    halo.close()


def check_update(halo, particles, everything, rows):
    """New values of owned rows reach the ghosts, integers and vectors alike, and are counted."""
    n = particles.owned
    halo.reset_counters()
    particles.velocity[:n] = 2.0 * everything["velocity"][rows[:n]]
    particles.group[:n] = everything["id"][rows[:n]]
    for _ in range(2):
        halo.update(particles, "velocity", "group")
    assert (particles.velocity == 2.0 * everything["velocity"][rows]).all()
    assert (particles.group == particles.id).all()
    sent = sum(len(r) for r in halo.sends.values())
    assert halo.messages_sent == 2 * len(halo.sends) and halo.bytes_sent == 2 * 3 * 8 * sent
    assert halo.points_migrated == 0


def check_ranks_share_pairs_and_not_points():
    """A strip of two rows has as many points as the block beside it, and a third fewer pairs."""
    if RANKS != 2:
        return
    d, moving = 0.01, {"material": "soil", "velocity": [3.0, 0.0]}
    boxes = {"block": ([0.0, 0.0], [20 * d, 20 * d]), "strip": ([25 * d, 0.0], [225 * d, 2 * d])}
    sim = Simulation.from_scene({
        "dimension": 2, "spacing": d, "gravity": [0.0, 0.0],
        "materials": {"soil": {"model": "elastic", "density": 1760.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}},
        "bodies": [moving | {"name": name, "shape": {"type": "box", "lower": lower, "upper": upper}}
                   for name, (lower, upper) in boxes.items()],
        "stages": [{"name": "fly", "type": "dynamics", "duration": 1.0}],
    })  # fmt: skip
    sim.start()
    imbalance = []
    while sim.rebuild_count < 3:
        sim.step()
        shares = COMM.allgather(len(sim.bonds.pairs.first))
        imbalance.append(max(shares) * RANKS / sum(shares))
    assert imbalance[0] > 1.15 and imbalance[-1] < 1.08, imbalance
    sim.halo.close()


class Counting(MPI.Intracomm):
    """A communicator that counts what waits for all ranks."""

    reductions = 0

    def _count(self, name, *arguments):
        self.reductions += 1
        return getattr(super(), name)(*arguments)

    def Allreduce(self, *arguments):
        return self._count("Allreduce", *arguments)

    def allreduce(self, *arguments):
        return self._count("allreduce", *arguments)

    def allgather(self, *arguments):
        return self._count("allgather", *arguments)

    def bcast(self, *arguments):
        return self._count("bcast", *arguments)


def check_a_step_sends_few_messages_and_reduces_once():
    """Four to each neighbour, five where a law that flows exchanges stress; on an obstacle as in the air."""
    d = 0.01
    elastic = {"model": "elastic", "density": 1760.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
    sand = elastic | {"model": "drucker_prager", "cohesion": 0.0, "friction_angle": 30.0}
    for law, messages in ((elastic, 4), (sand, 5)):
        comm = Counting(COMM)
        sim = Simulation.from_scene({
            "dimension": 2, "spacing": d, "gravity": [0.0, -9.81], "materials": {"soil": law},
            "bodies": [{"name": "column", "material": "soil",
                        "shape": {"type": "box", "lower": [0.0, 0.0], "upper": [40 * d, 4 * d]}}],
            "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.5}],
            "stages": [{"name": "stand", "type": "dynamics", "duration": 1.0}],
        }, comm)  # fmt: skip
        sim.start()
        sim.step()
        sim.time_step.fixed = sim.dt  # no look at the highest frequency, which is every 200 steps
        rebuilds, reductions = sim.rebuild_count, comm.reductions
        sim.halo.reset_counters()
        for _ in range(5):
            sim.step()
        assert sim.rebuild_count == rebuilds
        assert sim.halo.messages_sent == 5 * messages * len(sim.halo.sends)
        assert comm.reductions - reductions == (0 if RANKS == 1 else 5)
        sim.halo.close()


def main():
    """All checks; prints their names."""
    for name, check in list(globals().items()):
        if name.startswith("check_") and name != "check_update":
            try:
                check()
            except BaseException:
                if RANKS == 1:
                    raise
                traceback.print_exc()
                COMM.Abort(1)
            if RANK == 0:
                print(name, flush=True)


if __name__ == "__main__":
    main()
