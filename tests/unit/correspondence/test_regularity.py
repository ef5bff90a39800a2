"""Flowing soil: points stay regular, volumes true, stress smooth; soil at rest and elastic soil feel nothing of it."""

import numpy as np
import pytest
from mpi4py import MPI

from periporo import Simulation
from periporo.core.bonds.blocks import Block
from periporo.core.bonds.rows import PointRows
from periporo.core.correspondence import regularity
from periporo.core.correspondence.point_state import PointState
from periporo.core.points.forces import FLOW_WORK
from periporo.core.points.varied import VariedLaw
from periporo.materials.drucker_prager import DruckerPrager

SPACING = 0.01
SAND = {
    "model": "drucker_prager", "density": 1800.0, "bulk_modulus": 25e6, "shear_modulus": 15e6, "cohesion": 0.0,
    "friction_angle": 30.0, "dilation_angle": 0.0,
}  # fmt: skip
LAW = DruckerPrager(**{name: value for name, value in SAND.items() if name != "model"})
DEFAULT = {"scheme": "point_state", "sharpened": True, "regular": True}


def row(law, components=4) -> Block:
    """A block of one row at zero stress."""
    block = Block(law, PointRows(), 0, components)
    block.stress, block.state = np.zeros((1, components)), np.zeros((1, block.columns))
    block.strain_increment, block.active = np.zeros((1, components)), np.ones(1, bool)
    return block


@pytest.mark.parametrize("components", (4, 6))
def test_soil_that_has_come_apart_bears_nothing_until_it_has_closed(components):
    block, seen = row(LAW, components), []
    for volumetric in (-1e-5, 3e-3, 2e-3, -4e-3, -1e-3, -1e-5):
        block.strain_increment[:] = 0.0
        block.strain_increment[0, :3] = volumetric / 3.0
        block.advance(1e-5)
        seen.append((float(block.stress[0, :3].mean()), float(block.state[0, block.opening.column])))
    pressure, opened = np.array(seen).T
    assert opened == pytest.approx([0.0, 2.99e-3, 4.99e-3, 0.99e-3, 0.0, 0.0], abs=1e-12)
    assert pressure == pytest.approx([-250.0, 0.0, 0.0, 0.0, -250.0, -500.0], abs=1e-6)
    assert not block.stress[:, 3:].any()


def test_a_law_of_a_third_party_takes_part_by_two_names():
    """A law that knows nothing of openings but its limit and the column."""

    class Loose(DruckerPrager):
        def tension_limit(self, stress, state):
            return np.full(len(stress), 40.0)

    law = Loose(**LAW.model_dump() | {"cohesion": 40.0 * np.tan(np.radians(30.0)), "match": "compression"})
    block = row(law, 6)
    for volumetric, pressure in ((1e-3, 40.0), (-1e-3 + 40.0 / 25e6, 40.0), (-80.0 / 25e6, -40.0)):
        block.strain_increment[0, :3] = volumetric / 3.0
        block.advance(1e-5)
        assert block.stress[0, :3].mean() == pytest.approx(pressure, abs=1e-6)


@pytest.fixture
def shear(cloud, grid):
    """The function that makes a cloud of sand that yields everywhere, with random stress in the cone."""

    def make(law=LAW, rate=30.0):
        position = grid(8, 8, spacing=SPACING, jitter=0.3)
        gradient = np.array([[0.0, rate], [0.0, 0.0]])
        sim = cloud(position, laws=[law], velocity=position @ gradient.T, fixed=1e-5,
                    scheme=lambda h, name: PointState(h, name, sharpened=SPACING, regular=True))  # fmt: skip
        block = sim.bonds.blocks[0]
        draw = np.random.default_rng(5)
        block.stress[:, :3] = -draw.uniform(500.0, 1500.0, (64, 1))
        block.stress[:, 3] = draw.uniform(-200.0, 200.0, 64)
        sim.particles.activity[:] = 1.0
        sim.dt = 1e-5
        return sim

    return make


@pytest.fixture
def sheared(shear):
    """Such a cloud of sand that does not dilate."""
    return shear()


def carried(sim):
    """Integral of the stress over the points, and of its mean with what is opened."""
    block, p = sim.bonds.blocks[0], sim.particles
    volume = (p.volume[:64] * p.share[:64, 2])[:, None]
    signed = block.stress[:, :3].mean(axis=1) + 25e6 * block.state[:, -1]
    return (volume * block.stress).sum(axis=0), float((volume[:, 0] * signed).sum())


def test_exchange_keeps_the_sum_of_stress_and_only_takes_energy(sheared):
    sim = sheared
    p, block = sim.particles, sim.bonds.blocks[0]
    sim.scheme.deform(p, sim.bonds, sim.halo, 1e-5, 1e-5)
    block.strain_increment[:] = 0.0
    before, scatter = carried(sim), block.stress[:, 0].std()
    sim.scheme.regularise(p, sim.bonds, sim.halo)
    after = carried(sim)
    assert after[0] == pytest.approx(before[0], rel=1e-12, abs=1e-12 * abs(before[0]).max())
    assert after[1] == pytest.approx(before[1], rel=1e-12)
    assert block.stress[:, 0].std() < 0.85 * scatter  # a fifth of every difference goes
    assert p.flow_work[:, FLOW_WORK.index("exchange_dissipation")].sum() > 0.0
    eta, strength, _ = LAW.cone(2)  # an average of admissible stresses is admissible
    mean = block.stress[:, :3].mean(axis=1)
    root = np.sqrt(0.5 * ((block.stress[:, :3] - mean[:, None]) ** 2).sum(axis=1) + block.stress[:, 3] ** 2)
    assert (root + eta * mean - strength < 1e-9).all()


def test_exchange_is_bounded_row_by_row_where_dilation_varies(shear):
    """Half of the cloud dilates, and exchanges as a cloud does that dilates; the other as one that does not."""

    def dilating(angle):
        return DruckerPrager(**LAW.model_dump() | {"dilation_angle": angle})

    def exchanged(sim):
        """What exchange adds to the stress of each point, and the dilatancy by which it is bounded."""
        p, block = sim.particles, sim.bonds.blocks[0]
        sim.scheme.deform(p, sim.bonds, sim.halo, 1e-5, 1e-5)
        block.strain_increment[:] = 0.0
        before = block.stress.copy()
        sim.scheme.regularise(p, sim.bonds, sim.halo)
        borne = np.sqrt((before[:, :3] ** 2).sum(axis=1) + 2.0 * before[:, 3] ** 2) / np.sqrt(3.0)
        return block.stress - before, p.flow[:64, regularity.BORNE] / borne

    slow = 0.3  # 1/s: too little for what the points exchange
    mixed = shear(rate=slow)
    x, block = mixed.particles.position[:64, 0] / SPACING, mixed.bonds.blocks[0]
    right = x > 4.0
    block.values = np.where(right, 20.0, 0.0)[:, None]
    block.use(VariedLaw(LAW, ("dilation_angle",), lambda values: dilating(*values)))
    (change, dilatancy), (free, none), (bound, all_of_it) = (
        exchanged(sim) for sim in (mixed, shear(rate=slow), shear(dilating(20.0), slow))
    )
    assert not none.any() and all_of_it == pytest.approx(np.tan(np.radians(20.0)))
    assert np.array_equal(dilatancy, np.where(right, all_of_it, none))
    far, dilates = x < 1.0, x > 7.0  # from the border between them
    assert far.sum() == dilates.sum() == 8
    assert np.array_equal(change[far], free[far]) and np.array_equal(change[dilates], bound[dilates])
    assert np.abs(bound).max() < 0.5 * np.abs(free).max()


def test_points_that_shear_move_away_from_those_too_close_and_soil_at_rest_stays(sheared):
    sim = sheared
    p = sim.particles
    p.activity[:32] = 0.0
    sim.scheme.deform(p, sim.bonds, sim.halo, 1e-5, 1e-5)
    sim.scheme.regularise(p, sim.bonds, sim.halo)
    way, near = p.rearrangement[:64], regularity.NEAREST * SPACING
    assert p.activity[:32].max() < 0.05
    for i in range(64):
        apart = p.position[:64] - p.position[i]
        r = np.linalg.norm(apart, axis=1)
        close = (r < near) & (r > 0.0)
        part = min(regularity.REARRANGED * 1e-5 * 30.0 * p.activity[i], regularity.MOST_REARRANGED)
        expected = -(0.5 * part * (near - r[close]) / r[close]) @ apart[close]
        assert way[i] == pytest.approx(expected, rel=1e-2, abs=1e-3 * np.abs(way).max())


def test_elastic_bodies_have_the_same_bits_with_and_without(scene_of):
    ends = []
    for regular in (True, False):
        scene = scene_of(correspondence={"scheme": "point_state", "sharpened": True, "regular": regular})
        sim = Simulation.from_scene(scene, MPI.COMM_SELF)
        sim.run()
        ends.append(sim.particles.position[: sim.particles.owned].copy())
    assert np.array_equal(*ends)


@pytest.mark.parametrize(("psi", "end"), [(0.0, None), (30.0, None), (30.0, 0.05)])
def test_a_column_of_sand_covers_its_area_and_makes_no_energy(scene_of, psi, end):
    stages = [{"name": "collapse", "type": "dynamics", "duration": 0.25}]
    scene = scene_of(counts=(10, 10), materials=SAND | {"dilation_angle": psi, "largest_dilation": end}, stages=stages)
    sim = Simulation.from_scene(scene, MPI.COMM_SELF)
    least = []
    sim.call_every(50, lambda sim: least.append(sim.ledger.entries()["internal_energy"]))
    sim.run()
    p, n = sim.particles, sim.particles.owned
    fallen = 1800.0 * 9.81 * 0.1 * 0.1 * 0.05  # J/m, the potential energy at the start
    entries = sim.ledger.entries()
    assert min(least) > -1e-3 * fallen
    assert abs(entries["energy_residual"] - entries["integration_term"]) < 1e-11 * fallen
    assert abs(entries["rearrangement_work"]) < 0.06 * fallen
    distance = np.linalg.norm(p.position[:n, None] - p.position[None, :n], axis=2) + np.eye(n)
    nearest = np.sort(distance, axis=1)[:, 0] / SPACING
    volume = p.dilation
    if psi == 0.0:
        assert abs(volume.mean() - 1.0) < 0.03 and 0.98 < np.quantile(volume, 0.02) < np.quantile(volume, 0.9) < 1.1
        assert np.quantile(nearest, 0.05) > 0.6  # 0.3 to 0.5 where nothing keeps them apart
    elif end is None:
        assert volume.min() > 0.98 and volume.mean() < 2.5
    else:  # dilated by no more than its end; and opened, as sand that does not dilate
        assert volume.min() > 0.98 and 1.0 < volume.mean() < np.exp(end) + 0.03
        assert 0.5 * end < sim.bonds.blocks[0].state[:, 0].max() <= end
