"""Free elastic blocks of points in every scheme, for the study of small motions."""

import numpy as np
from mpi4py import MPI

from periporo.core.correspondence.bond_projected import BondProjected
from periporo.core.correspondence.point_state import PointState
from periporo.core.correspondence.standard import Standard
from periporo.core.correspondence.sub_horizon import SubHorizon
from periporo.core.correspondence.sub_horizon_published import SubHorizonPublished
from periporo.core.motion.timestep import StableTimeStep
from periporo.core.points.particles import Particles
from periporo.core.simulation import Simulation
from periporo.materials.elastic import Elastic

BULK, SHEAR, DENSITY, SPACING = 25e6, 15e6, 1760.0, 0.005
WAVE_SPEED = np.sqrt((BULK + 4.0 / 3.0 * SHEAR) / DENSITY)

SCHEMES = {
    "bond_projected": BondProjected,
    "point_state": PointState,
    "point_state, sharpened": lambda h, name: PointState(h, name, sharpened=SPACING),
    "sub_horizon": SubHorizon,
    "standard": Standard,
    "published": SubHorizonPublished,
    "published, own ends": lambda h, name: SubHorizonPublished(h, name, average_ends=False),
    "published, no self": lambda h, name: SubHorizonPublished(h, name, self_point=False),
}


def block(counts, scheme, influence, m, jitter, safety=1.0, seed=3) -> Simulation:
    """A free elastic block of `counts` points, moved off their grid by up to `jitter` spacings, in its first step."""
    axes = np.meshgrid(*((np.arange(n) + 0.5) * SPACING for n in counts), indexing="ij")
    position = np.stack([a.ravel() for a in axes], axis=1)
    position += jitter * SPACING * np.random.default_rng(seed).uniform(-1, 1, position.shape)
    n, d = position.shape
    particles = Particles(d)
    sim = Simulation(
        MPI.COMM_SELF, particles, [Elastic(density=DENSITY, bulk_modulus=BULK, shear_modulus=SHEAR)],
        SCHEMES[scheme](m * SPACING, influence), spacing=SPACING, skin=0.3 * SPACING,
        time_step=StableTimeStep(safety, None, 10),
    )  # fmt: skip
    owned = {f.name: np.zeros(n if f.columns is None else (n, f.columns), f.dtype) for f in particles.migrating()}
    owned |= {"id": np.arange(n), "position": position, "volume": np.full(n, SPACING**d), "dilation": np.ones(n)}
    owned["mass"] = DENSITY * owned["volume"]
    owned["initial_position"] = owned["reference_position"] = position.copy()
    particles.replace(owned, 0)
    sim.start()
    return sim
