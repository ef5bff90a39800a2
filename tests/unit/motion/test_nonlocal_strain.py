"""Averaging of the softening strain: what is uniform stays, nothing is lost, the kernel's second moment, refusals."""

import math

import numpy as np
import pytest

from periporo import InputError, Simulation
from periporo.core.motion.nonlocal_strain import NonlocalStrain

CLAY = {"model": "mohr_coulomb", "density": 1600.0, "bulk_modulus": 2e5, "shear_modulus": 1e5, "friction_angle": 0.0,
        "cohesion": 600.0, "sensitivity": 5.0, "remoulding_shear": 0.1}  # fmt: skip
LENGTH = 0.05


def scene(dimension=2, sides=(0.3, 0.3), **clay):
    return {
        "dimension": dimension, "spacing": 0.01, "materials": {"clay": CLAY | {"length": LENGTH} | clay},
        "bodies": [{"name": "b", "material": "clay",
                    "shape": {"type": "box", "lower": [0.0] * dimension, "upper": list(sides)}}],
        "stages": [{"name": "fall", "type": "dynamics", "duration": 1e-3}],
    }  # fmt: skip


def shared(sim, strain):
    """What is made of the `strain` (n,) that laws add in one step."""
    process = next(part for part in sim.point_processes if isinstance(part, NonlocalStrain))
    block = sim.bonds.blocks[0]
    block.state[:, 0] = strain
    process.update(sim.particles, sim.bonds, 1e-5)
    return block.state[:, 0].copy()


@pytest.mark.parametrize("dimension, sides", [(2, (0.3, 0.3)), (3, (0.15, 0.15, 0.15))])
def test_a_smooth_strain_is_sharpened_by_what_averaging_takes_from_it(dimension, sides):
    """Far from the sides cos(k x) becomes (1 + 2 (w(k) - 1)) cos(k x), w = 1 - k^2 M/2 + k^4 F/24 of the kernel.

    Its moments per axis: M = R^2/8 in the plane, R^2/9 in space, F = 3 R^4/80 and R^4/33.
    """
    sim = Simulation.from_scene(scene(dimension, sides))
    sim.start()
    x = sim.particles.position[:, 0]
    k = 2.0 * math.pi / 0.2
    moments = (LENGTH**2 / 8, 3 * LENGTH**4 / 80) if dimension == 2 else (LENGTH**2 / 9, LENGTH**4 / 33)
    wave = 1.0 - k**2 * moments[0] / 2 + k**4 * moments[1] / 24
    strain = 2.0 + np.cos(k * x)
    found = shared(sim, strain)
    inside = (np.abs(sim.particles.position - np.array(sides) / 2) < np.array(sides) / 2 - LENGTH).all(axis=1)
    np.testing.assert_allclose(found[inside], 2.0 + (2.0 * wave - 1.0) * np.cos(k * x[inside]), atol=0.015)
    assert abs(2.0 * wave - 2.0) > 0.2
    volume = sim.particles.volume
    assert (volume * found).sum() == pytest.approx((volume * strain).sum(), rel=1e-13)


def test_uniform_strain_stays_and_a_point_alone_hardens():
    """To the bit where all shear alike, at the sides as well; a spike loses to its neighbours more than it has."""
    sim = Simulation.from_scene(scene())
    sim.start()
    n = sim.particles.owned
    np.testing.assert_array_equal(shared(sim, np.full(n, 0.01)), 0.01)
    spike = np.full(n, 0.01)
    spike[n // 2 + 15] = 0.0102
    found = shared(sim, spike)
    assert found[n // 2 + 15] < 0.01 and (found >= 0.01).sum() == n - 1 and (found > 0.01).sum() > 60


def test_only_a_length_costs_something():
    sim = Simulation.from_scene(scene(length=None))
    assert not any(isinstance(part, NonlocalStrain) for part in sim.point_processes)
    assert not {"counted_strain", "strain_to_share"} & set(sim.particles.fields)


@pytest.mark.parametrize("change, message", [
    ({"correspondence": "bond_projected"}, "averaging needs a row for each point"),
    ({"spacing": 0.03}, r"must be at least 2 spacings \(0.06 m\), not 0.05"),
])  # fmt: skip
def test_scenes_that_cannot_average_are_refused(change, message):
    with pytest.raises(InputError, match=r"(?s)materials.clay.length.*" + message):
        Simulation.from_scene(scene() | change)
