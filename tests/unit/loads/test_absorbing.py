"""Boundaries that absorb: waves leave through them, or come in, and what they hold they go on to hold."""

import numpy as np
import pytest

from periporo import Simulation

H, TALL = 1.0, 40
SOIL = {"model": "elastic", "density": 2000.0, "bulk_modulus": 40e6, "shear_modulus": 20e6}
SPEED = {"x": np.sqrt(20e6 / 2000.0), "y": np.sqrt((40e6 + 80e6 / 3) / 2000.0)}
OTHER = {"x": "y", "y": "x"}


def column(along, duration, absorb=None, gravity=0.0, beyond=1.0):
    """A column three points wide in which waves run up and down with particles that move `along` an axis."""
    box = {"type": "box", "lower": [0, 0], "upper": [3 * H, TALL * H]}
    scene = {
        "dimension": 2, "spacing": H, "gravity": [0, -gravity],
        "materials": {"soil": SOIL, "rock": SOIL | {"density": 2000.0 * beyond**2}},
        "bodies": [{"name": "soil", "material": "soil", "shape": box}],
        "boundaries": {"line": {"where": {"body": "soil"}, "fix": [OTHER[along]]},
                       "base": {"where": {"upper": [None, H]}, "absorb": {"side": "y-", **(absorb or {})}}},
        "stages": [{"name": "wave", "type": "dynamics", "duration": duration, "boundaries": ["line", "base"]}],
    }  # fmt: skip
    if gravity:
        scene["initial_stress"] = {"type": "geostatic", "K0": 0.5}
        scene["boundaries"]["rock"] = {"where": {"upper": [None, H]}, "fix": ["y"]}
        settle = {"name": "settle", "type": "relax", "tolerance": 1e-6, "boundaries": ["line", "rock"]}
        scene["stages"].insert(0, settle)
    return Simulation.from_scene(scene)


@pytest.mark.parametrize("along", ["x", "y"])
def test_nothing_comes_back_at_normal_incidence(along):
    sim = column(along, 2.2 * TALL * H / SPEED[along])
    y, axis = sim.particles.position[:, 1], "xy".index(along)
    sim.particles.velocity[:, axis] = 0.01 * np.exp(-(((y - 20.0) / 4.0) ** 2))
    sim.run()
    entries = sim.ledger.entries()
    left = entries["kinetic_energy"] + entries["internal_energy"]
    assert left < 2e-3 * sim.ledger.initial_kinetic  # less than 5 % of a wave is reflected
    assert entries["external_work"] == pytest.approx(-sim.ledger.initial_kinetic, rel=4e-3)


@pytest.mark.parametrize("ratio", [1.0 / 3.0, 3.0])
def test_what_comes_back_follows_the_impedance_beyond(ratio):
    """(1 - r)/(1 + r) of a wave, the square of that of its energy."""
    sim = column("x", 0.75 * TALL * H / SPEED["x"], {"beyond": "rock"}, beyond=ratio)
    p = sim.particles
    wave = 0.01 * np.exp(-(((p.position[:, 1] - 20.0) / 4.0) ** 2))
    sim.start()
    p.velocity[:, 0] = wave
    for block in sim.bonds.blocks[:1]:  # all of it runs down: stress is impedance times velocity
        block.stress[:, 3] = 2000.0 * SPEED["x"] * wave[block.first]
    sim.apply_loads(0.0)
    sim.ledger.initial_kinetic = sim.ledger.kinetic()
    sim.run()
    start = 2.0 * sim.ledger.initial_kinetic
    lost = -sim.ledger.entries()["external_work"] / start
    assert 1.0 - lost == pytest.approx(((1.0 - ratio) / (1.0 + ratio)) ** 2, abs=0.01)


@pytest.mark.parametrize("along", ["x", "y"])
def test_a_wave_that_comes_in_doubles_at_the_free_surface(along):
    times = np.linspace(0.0, 0.2, 41)
    pulse = 0.01 * np.sin(np.pi * times / 0.2) ** 2
    history = {along: {"times": times.tolist(), "values": pulse.tolist()}}
    sim = column(along, TALL * H / SPEED[along] + 0.2, {"velocity": history})
    top = sim.particles.position[:, 1] > (TALL - 1) * H
    seen = []
    sim.call_every(1, lambda s: seen.append(s.particles.velocity[top, "xy".index(along)].mean()))
    sim.run()
    assert max(seen) == pytest.approx(0.02, rel=0.03)


def test_what_it_held_it_goes_on_to_hold():
    """A column in balance under its weight, whose base absorbs, neither falls nor creeps."""
    sim = column("y", 1.0, gravity=9.81)
    sim.start()
    sim.stages[0].run(sim)
    x = sim.particles.position.copy()
    sim.stage_number = 1
    sim.stages[1].run(sim)
    assert sim.time == pytest.approx(1.0, rel=0.01)
    assert np.abs(sim.particles.position - x).max() < 1e-6 * 0.5 * 9.81 * 1.0**2
