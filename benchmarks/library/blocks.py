"""Blocks of points that move freely or are sheared, built as a scene builds them."""

from mpi4py import MPI

from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene

from .verification_cases.common import DEFAULT

MATERIALS = {
    "elastic": {"model": "elastic", "density": 1760.0, "bulk_modulus": 25e6, "shear_modulus": 15e6},
    "cam_clay": {
        "model": "cam_clay", "grain_density": 2200.0, "porosity": 0.2, "bulk_modulus": 25e6, "shear_modulus": 15e6,
        "critical_state_slope": 1.1, "compression_index": 0.12, "swelling_index": 0.04, "preconsolidation": 1000.0,
    },
}  # fmt: skip
SCHEMES = {
    "default": DEFAULT, "point_state": "point_state", "bond_projected": "bond_projected", "standard": "standard",
}  # fmt: skip


def block(dimension, side, material, horizon=2.2, scheme=SCHEMES["default"]):
    """A started simulation of side**dimension points, spacing 1 m."""
    scene = {
        "dimension": dimension, "spacing": 1.0, "horizon": horizon, "correspondence": scheme,
        "materials": {"soil": MATERIALS[material]},
        "bodies": [{"name": "block", "material": "soil",
                    "shape": {"type": "box", "lower": [0.0] * dimension, "upper": [float(side)] * dimension}}],
        "initial_stress": {"type": "uniform", "components": {"xx": -500.0, "yy": -500.0, "zz": -500.0}},
        "stages": [{"name": "free", "type": "dynamics", "duration": 1.0}],
    }  # fmt: skip
    sim = build(parse_scene(scene), MPI.COMM_SELF)
    sim.start()
    return sim


def shear(sim, rate=0.01):
    """Velocities of simple shear, strong enough to make every bond flow."""
    p = sim.particles
    p.velocity[:] = 0.0
    p.velocity[:, 0] = rate * p.position[:, 1]
