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


@pytest.mark.parametrize("rate", [5.0, 40.0])
def test_a_shaken_base_is_amplified_as_it_should_be(rate):
    """Surface over base of a column with damping relative to the base, by its complex wave number.

    G w'' + rho (w0^2 - i w0 c) w = -rho w0^2 u_b for the way w relative to the base; 1/cos(kH) without damping.
    """
    omega, height, duration = 2.0 * np.pi * 5.0, HEIGHT + 0.5 * SPACING, 1.6 if rate < 10.0 else 0.8
    times = np.linspace(0.0, duration, 801)
    scene = {
        "dimension": 2, "spacing": SPACING, "materials": {"soil": SOIL},
        "bodies": [{"name": "strip", "material": "soil",
                    "shape": {"type": "box", "lower": [0, -SPACING], "upper": [0.4, HEIGHT]}}],
        "boundaries": {
            "base": {"where": {"upper": [None, 0]}, "velocity": {
                "x": {"times": times.tolist(), "values": (0.01 * np.sin(omega * times)).tolist()}, "y": 0.0}},
            "sides": {"where": {"upper": [0.1, None]}, "tie": {"to": {"lower": [0.3, None]}, "components": ["x", "y"]}},
        },
        "stages": [{"name": "shake", "type": "dynamics", "duration": duration, "boundaries": ["base", "sides"],
                    "damping": {"viscous": rate, "relative_to": "base"}}],
    }  # fmt: skip
    sim = build(parse_scene(scene, "."), MPI.COMM_SELF)
    sim.start()
    top, tops = sim.particles.position[:, 1] > HEIGHT - SPACING, []
    sim.call_every(1, lambda s: tops.append((s.time, s.particles.velocity[top, 0].mean(),
                                             s.ledger.entries()["damping_dissipation"])))  # fmt: skip
    sim.run()
    time, speed, taken = np.array(tops).T
    assert (np.diff(taken) > -1e-6 * taken[-1]).all()  # what the base drags along is no gain of damping
    late = time > duration - 2.0 * np.pi / omega
    squared = omega**2 - 1j * omega * rate
    factor = 1.0 - omega**2 / squared * (1.0 - 1.0 / np.cos(np.sqrt(squared / (SHEAR / DENSITY)) * height))
    assert np.ptp(speed[late]) / 0.02 == pytest.approx(abs(factor), rel=0.03)
