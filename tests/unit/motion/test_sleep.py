"""Points at rest sleep: what they keep, what wakes them, and that no energy is lost unseen."""

import numpy as np
import pytest

from periporo import Simulation
from periporo.core.loads.boundary import Gravity
from periporo.core.motion.sleep import LOOK_INTERVAL
from periporo.core.points.fields import values
from periporo.errors import InputError

SOIL = {"model": "elastic", "density": 1500.0, "bulk_modulus": 6e5, "shear_modulus": 3e5}
WAVE = np.sqrt((6e5 + 4e5) / 1500.0)  # m/s
SPACING, LENGTH, DEPTH = 0.01, 0.6, 0.05
BOUND = 0.02  # m/s


def slab(end=(0.0, 0.0), **keys):
    """A slab on a floor, whose right tenth begins with a velocity; it needs gravity to be felt in the contact."""

    def part(name, left, right, velocity):
        shape = {"type": "box", "lower": [left, 0.0], "upper": [right, DEPTH]}
        return {"name": name, "material": "soil", "velocity": list(velocity), "shape": shape}

    scene = {
        "dimension": 2, "spacing": SPACING, "gravity": [0.0, -0.1], "materials": {"soil": SOIL},
        "bodies": [part("slab", 0.0, 0.9 * LENGTH, (0.0, 0.0)), part("end", 0.9 * LENGTH, LENGTH, end)],
        "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.4}],
        "stages": [{"name": "motion", "type": "dynamics", "duration": 0.1}],
        "sleep": {"speed": BOUND, "steps": 2 * LOOK_INTERVAL},
    }  # fmt: skip
    return Simulation.from_scene(scene | keys)


def go(sim, steps):
    """Take steps in the first stage; before the first, start."""
    if sim.step_number == 0:
        sim.start()
    for _ in range(steps):
        sim.step()


def by_id(sim, values):
    """Rows of the owned points in the order of their ids."""
    return values[: sim.particles.owned][np.argsort(sim.particles.id[: sim.particles.owned])]


def test_a_wave_wakes_what_it_reaches_and_the_ledger_closes():
    sim, whole = slab(end=(-0.5, 0.0)), slab(end=(-0.5, 0.0), sleep=None)
    go(sim, 2 * LOOK_INTERVAL + 5)
    p = sim.particles
    place = by_id(sim, p.position[:, 0])
    asleep = by_id(sim, p.asleep) != 0
    feels = 0.9 * LENGTH - WAVE * sim.time  # where the wave has come
    assert asleep[place < feels - 8 * SPACING].all() and not asleep[place > feels].any()
    assert not by_id(sim, p.velocity)[asleep].any()
    ends = np.concatenate([sim.bonds.pairs.first, sim.bonds.pairs.second])
    assert p.awake < ends.max() + 1 == p.stirred < p.owned  # sleepers that are far from others stand last
    assert p.flux[p.awake :].any() and (p.flux[p.awake :] == p.held_flux[p.awake :]).all()
    held = by_id(sim, p.position)[asleep]
    while sim.time < 0.5 * LENGTH / WAVE:
        sim.step()
    asleep_later = by_id(sim, p.asleep)[asleep] != 0
    assert (by_id(sim, p.position)[asleep][asleep_later] == held[asleep_later]).all()
    assert 0.1 < asleep_later.mean() < 0.9
    go(whole, sim.step_number)
    while whole.time < sim.time:
        whole.step()
    difference = by_id(sim, p.velocity) - by_id(whole, whole.particles.velocity)
    assert np.sqrt((difference**2).sum(axis=1)).max() < 2.0 * BOUND
    entries = sim.ledger.entries()
    assert entries["energy_residual"] == pytest.approx(entries["integration_term"], abs=1e-13)
    assert 0.0 < entries["set_aside_energy"] < 0.5 * p.mass.sum() * BOUND**2
    assert entries["asleep"] == pytest.approx(1.0 - p.awake / p.owned)


def test_all_sleep_without_a_step_of_any_law_and_wake_when_a_load_changes():
    sim = slab()
    go(sim, 3 * LOOK_INTERVAL)
    p = sim.particles
    assert p.awake == 0 and len(sim.bonds.pairs.first) == 0 and len(sim.bonds.blocks[0].stress) == 0
    state = p.position.copy()
    go(sim, 2 * LOOK_INTERVAL)
    assert (p.position == state).all() and sim.ledger.kinetic() == 0.0
    sim.loads = [Gravity(np.array([0.0, -30.0]))]
    go(sim, LOOK_INTERVAL + 2)
    assert p.awake == p.owned
    assert -30.0 * (LOOK_INTERVAL + 2) * sim.dt < p.velocity[:, 1].min() < -20.0 * sim.dt
    entries = sim.ledger.entries()
    assert entries["energy_residual"] == pytest.approx(entries["integration_term"], abs=1e-13)


def test_what_is_moved_slowly_from_outside_stays_awake_with_its_neighbours():
    pulled = {"pull": {"where": {"upper": [0.01, None]}, "velocity": {"x": -0.1 * BOUND}}}
    stages = [{"name": "motion", "type": "dynamics", "duration": 0.1, "boundaries": ["pull"]}]
    sim = slab(boundaries=pulled, stages=stages)
    sim.start()
    sim.prescribed_motions = sim.stages[0].prescribed_motions
    go(sim, 3 * LOOK_INTERVAL)
    place, asleep = by_id(sim, sim.particles.position[:, 0]), by_id(sim, sim.particles.asleep) != 0
    assert not asleep[place < 0.01 + 1.8 * 2.2 * SPACING - SPACING].any() and asleep[place > 0.1].all()


def test_stress_of_sleepers_is_written_and_the_next_stage_wakes_them():
    both = [{"name": name, "type": "dynamics", "duration": 0.03} for name in ("one", "two")]
    stress = {"type": "uniform", "components": {"xx": -40.0, "yy": -60.0, "zz": -40.0}}
    walls = [{"type": "plane", "point": [x, 0], "normal": [n, 0], "friction": 0.0} for x, n in ((0, 1), (LENGTH, -1))]
    floor = {"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.4}
    sim = slab(stages=both, initial_stress=stress, contacts=[floor, *walls])
    seen, stresses = [], []

    def look(sim):
        seen.append((sim.stage_number, 1.0 - sim.particles.awake / sim.particles.owned))
        stresses.append(by_id(sim, values(sim, ["stress"])["stress"]))

    sim.call_every(1, look)
    sim.run()
    fell = seen.index((0, 1.0))
    assert np.abs(stresses[fell]).mean() > 10.0 and (stresses[fell] == stresses[fell + 1]).all()
    assert np.abs(stresses[fell] - stresses[fell - 1]).max() < 2.0
    first = [share for stage, share in seen if stage == 1]
    assert first[0] == 0.0 and max(first) == 1.0
    entries = sim.ledger.entries()
    assert entries["energy_residual"] == pytest.approx(entries["integration_term"], abs=1e-13)


@pytest.mark.parametrize("keys, key", [
    ({"correspondence": "bond_projected"}, "sleep"),
    ({"correspondence": {"scheme": "point_state", "balance": True}}, "sleep"),
    ({"pore_water": {"suction": 0.0}}, "sleep"),
])  # fmt: skip
def test_where_points_cannot_sleep_the_scene_is_refused(keys, key):
    with pytest.raises(InputError, match=key):
        slab(**keys)
