"""Where pore water should enter the force: out of balance where there is exact balance, for both choices.

    python -m benchmarks suction_point_or_bond

A free block whose bonds all carry the effective stress -P I, with a pore stress of P, has no total stress: every
force should vanish. With the water in the bonds it does, to the last bit. With the water at the points (P V I added
to Z_i) it does so only inside a regular grid.
"""

import numpy as np
from mpi4py import MPI

from periporo.core.correspondence import bond_projected as scheme
from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene

from . import option_parser

SPACING = 0.01


def block(jitter):
    """A block of 20 x 20 points."""
    sim = build(parse_scene({
        "dimension": 2, "spacing": SPACING, "time_step": {"fixed": 1e-6},
        "materials": {"soil": {"model": "elastic", "density": 1760.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}},
        "bodies": [{"name": "block", "material": "soil", "jitter": jitter,
                    "shape": {"type": "box", "lower": [0.0, 0.0], "upper": [0.2, 0.2]}}],
        "stages": [{"name": "rest", "type": "dynamics", "duration": 1.0}],
    }), MPI.COMM_SELF)  # fmt: skip
    sim.start()
    return sim


def out_of_balance(jitter, at_points):
    """Force of every point over P times the spacing, for P = 1 Pa."""
    sim = block(jitter)
    p, pairs, rows = sim.particles, sim.bonds.pairs, sim.bonds.blocks[0]
    rows.stress[:] = [-1.0, -1.0, -1.0, 0.0]
    force = np.zeros((p.total, 2))
    if not at_points:
        rows.total = rows.stress + np.array([1.0, 1.0, 1.0, 0.0])
        sim.scheme.internal_force(p, sim.bonds, sim.halo, force)
    else:
        bonds = rows.pair, rows.side, rows.active, pairs.first, pairs.second, pairs.weight
        p.flux[:] = 0.0
        scheme._sum_flux(*bonds, p.position, p.volume, p.share, rows.stress, p.flux, p.dim)
        p.flux[:, [0, 3]] += p.volume[:, None]
        scheme._close_flux(p.owned, p.volume, p.shape_inverse, p.flux, p.dim)
        scheme._add_force(*bonds, p.position, p.volume, p.share, rows.stress, p.flux, force, p.dim)
    return np.sqrt((force**2).sum(axis=1)) / SPACING


def main(words=None):
    """Print the force of either placing, on a grid and on a shaken one."""
    option_parser(__name__, __doc__).parse_args(words)
    print("out-of-balance force over P x spacing (largest, root of mean square)")
    for jitter in (0.0, 0.2):
        for name, at_points in (("in the bonds", False), ("at the points", True)):
            f = out_of_balance(jitter, at_points)
            print(f"  jitter {jitter:3.1f}  {name:14s} {f.max():9.2e} {np.sqrt((f**2).mean()):9.2e}")
