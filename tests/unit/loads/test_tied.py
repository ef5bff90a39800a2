"""Tied sides: a strip of ground swings as if it went on for ever."""

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene

HEIGHT, SPACING, SHEAR, DENSITY = 2.0, 0.1, 4e6, 1600.0  # shear waves at 50 m/s
SOIL = {"model": "elastic", "density": DENSITY, "bulk_modulus": 8e6, "shear_modulus": SHEAR}


def swinging(boundaries):
    """A strip a fifth as wide as high on a fixed base, that begins with the velocity of its first mode."""
    scene = {
        "dimension": 2, "spacing": SPACING, "materials": {"soil": SOIL},
        "bodies": [{"name": "strip", "material": "soil",
                    "shape": {"type": "box", "lower": [0, -SPACING], "upper": [0.4, HEIGHT]}}],
        "boundaries": {"base": {"where": {"upper": [None, 0]}, "fix": ["x", "y"]}} | boundaries,
        "stages": [{"name": "swing", "type": "dynamics", "duration": 0.1, "boundaries": ["base", *boundaries]}],
    }  # fmt: skip
    sim = build(parse_scene(scene, "."), MPI.COMM_SELF)
    sim.start()
    p, tops = sim.particles, []
    p.velocity[: p.owned, 0] = np.where(p.position[:, 1] > 0, np.sin(0.5 * np.pi * p.position[:, 1] / HEIGHT), 0.0)
    sim.ledger.initial_kinetic = sim.ledger.kinetic()
    sim.call_every(1, lambda s: tops.append((s.time, p.velocity[p.position[:, 1] > HEIGHT - SPACING].mean(axis=0)[0])))
    sim.run()
    return sim, np.array(tops)


def quarter_period(tops):
    """When the velocity of the top is zero for the first time, s."""
    k = int(np.argmax(tops[:, 1] < 0.0))
    (t0, v0), (t1, v1) = tops[k - 1 : k + 1]
    return t0 + (t1 - t0) * v0 / (v0 - v1)


def test_a_strip_with_tied_sides_swings_as_a_shear_column():
    tie = {"to": {"lower": [0.3, None]}, "components": ["x", "y"]}
    sim, tops = swinging({"sides": {"where": {"upper": [0.1, None]}, "tie": tie}})
    expected = (HEIGHT + 0.5 * SPACING) / np.sqrt(SHEAR / DENSITY)  # a quarter of 4 H / V_s, down to the points held
    assert quarter_period(tops) == pytest.approx(expected, rel=0.01)
    entries = sim.ledger.entries()
    assert abs(entries["energy_residual"] - entries["integration_term"]) < 1e-12 * sim.ledger.initial_kinetic
    assert abs(entries["prescribed_work"]) < 1e-9 * sim.ledger.initial_kinetic
