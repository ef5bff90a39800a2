"""The watchdog: faults are found in time, taken back and tried again, or reported with their place and cause."""

import csv

import numpy as np
import pytest

from periporo.core.bonds.bonds import RefusedStep
from periporo.core.loads.boundary import Gravity
from periporo.core.motion.rebuilds import rebuild
from periporo.core.motion.stages import DynamicsStage
from periporo.core.points.forces import WORK
from periporo.core.points.material import StepRefused, UpdatesFailed, moduli_without_stress
from periporo.core.watch.watchdog import (
    MOST_RETRIES,
    STRAIN_JUMP,
    Watchdog,
    WatchdogError,
    borrowed,
    nan_points,
    speed_ratios,
    strain_jumps,
    survey,
    wave_speeds,
)
from periporo.errors import InputError
from periporo.materials.elastic import Elastic

SPACING = 0.01


class Reluctant(Elastic):
    """Refuses steps in which a row strains by more than it `bears`, after spoiling them all."""

    bears: float = 1.0

    def compute_stress(self, stress, strain_increment, state, dt):
        over = np.flatnonzero(np.abs(strain_increment).max(axis=1, initial=0.0) > self.bears)
        super().compute_stress(stress, strain_increment, state, dt)
        if len(over):
            stress[:] = np.nan
            raise StepRefused(over, f"it bears {self.bears:g}")


def stretching(position, speed):
    """Velocity (n, 2) m/s of a smooth motion."""
    return speed * np.sin(20.0 * position)


class Saboteur:
    """Spoils the state after the step `at`, `times` times, before the guards look; remembers when it was found."""

    def __init__(self, spoil, at, times=1):
        self.spoil, self.at, self.times = spoil, at, times

    def start_stage(self, sim, stage):
        pass

    def check(self, sim):
        if self.times and sim.step_number == self.at:
            self.times -= 1
            self.spoil(sim)

    def refused(self, sim, refusal):
        pass

    def conclude(self, sim):
        self.check(sim)
        return True


def nan_velocity(sim):
    sim.particles.velocity[5, 0] = np.nan


def nan_stress(sim):
    sim.bonds.blocks[0].stress[3, 1] = np.nan


def too_fast(sim):
    sim.particles.velocity[7] = [3.0 * wave_speeds(sim)[0], 0.0]


def strain_jump(sim):
    """A point leaps and is back within the next step, and the law does not notice: only its bonds' strain tells."""
    deform = sim.scheme.deform

    def leap(particles, *arguments):
        sim.scheme.deform = deform
        kept = particles.velocity.copy()
        particles.velocity[9] += 3.0 * STRAIN_JUMP * SPACING / sim.dt
        deform(particles, *arguments)
        particles.velocity[:] = kept
        for block in sim.bonds.blocks:
            block.strain_increment[:] = 0.0

    sim.scheme.deform = leap


def energy_from_nowhere(sim):
    sim.particles.velocity[: sim.particles.owned] *= 1.2


def contact_gives(sim):
    """As much as the motion has, and the ledger knows it."""
    energy = 0.5 * sim.particles.mass * (sim.particles.velocity[: sim.particles.owned] ** 2).sum(axis=1)
    sim.particles.velocity[: sim.particles.owned] *= np.sqrt(2.0)
    sim.particles.work[:, WORK.index("contact")] += energy


AROUND_9 = range(24)  # four columns of six

FAULTS = {  # kind -> spoil, text of the message
    "nan_velocity": (nan_velocity, "is not a number"),
    "nan_stress": (nan_stress, "is not a number"),
    "speed": (too_fast, "times the wave speed"),
    "strain": (strain_jump, "within one step"),
    "energy": (energy_from_nowhere, "energy error of"),
    "gain": (contact_gives, "the channel 'contact' gave and had never taken"),
}


@pytest.fixture
def flight(cloud, grid):
    """A block that stretches in free fall, with one stage of 300 steps."""
    return falling_block(cloud, grid)


def falling_block(cloud, grid):
    gravity, position = [Gravity(np.array([0.0, -10.0]))], grid(8, 6, spacing=SPACING)
    sim = cloud(position, velocity=stretching(position, 0.1), loads=gravity, fixed=2e-5)
    sim.stages = [DynamicsStage("fall", loads=gravity, duration=300 * 2e-5)]
    return sim


def guarded(sim, tmp_path, saboteur, **options):
    messages = []
    dog = Watchdog(0.01, ["sand"], tmp_path / "run.diagnostic.csv", message=messages.append, **options)
    sim.guards = [saboteur, dog]
    return dog, messages


def test_a_sound_run_is_left_alone_to_the_last_bit(flight, cloud, grid, tmp_path):
    dog, messages = guarded(flight, tmp_path, Saboteur(nan_velocity, at=-1))
    flight.run()
    watched = flight.particles.position.copy()
    again = falling_block(cloud, grid)
    again.run()
    assert dog.retries == 0 and not messages
    assert flight.step_number == 300 and (watched == again.particles.position).all()


@pytest.mark.parametrize("kind", FAULTS)
def test_a_passing_fault_is_taken_back_and_the_run_goes_on(flight, tmp_path, kind):
    spoil, text = FAULTS[kind]
    rewound = []
    dog, messages = guarded(flight, tmp_path, Saboteur(spoil, at=191), rewind=rewound.append)
    flight.run()
    assert dog.retries == 1 and rewound == [0]
    assert len(messages) == 2 and text in messages[0] and "step 200:" in messages[0]  # within 10 steps
    assert "material 'sand'" in messages[0] and "Likely cause" in messages[0]
    assert kind != "strain" or any(f"point {i} at" in messages[0] for i in AROUND_9)
    assert "back to step 0 with 0.5" in messages[0]
    # half the step up to step 500; after an energy error to the end, since it would only come back
    lasting = kind in ("energy", "gain")
    assert flight.time_step.reduction == (0.5 if lasting else 1.0) and "sound again" in messages[1]
    assert flight.step_number == (600 if lasting else 550) and flight.time == pytest.approx(300 * 2e-5, rel=1e-9)
    assert np.isfinite(flight.particles.position).all()


@pytest.mark.parametrize(("at", "found"), [(3, 10), (296, 297)])
def test_energy_is_looked_at_from_the_start_of_a_stage_to_its_end(flight, tmp_path, at, found):
    """A gain in the first steps; and one between the last look and the last step, which is none of every ten."""
    flight.stages[0].duration = 297 * 2e-5
    dog, messages = guarded(flight, tmp_path, Saboteur(energy_from_nowhere, at=at))
    flight.run()
    assert dog.retries == 1 and f"step {found}:" in messages[0] and flight.time_step.reduction == 0.5
    assert "energy error" in messages[0] if at > 100 else "'integration' gave" in messages[0]
    assert flight.step_number == 2 * 297 and flight.time == pytest.approx(297 * 2e-5, rel=1e-9)


def test_what_velocity_verlet_lends_is_no_gain(cloud, grid, tmp_path):
    """A vibration of the grid has (omega dt)^2/4 of its energy beyond it where it is squeezed most, and gives it back.
    """
    position = grid(8, 6, spacing=SPACING)
    sim = cloud(position, velocity=1e-3 * (-1.0) ** np.round(position / SPACING - 0.5))
    sim.stages = [DynamicsStage("shake", duration=90 * sim.dt)]
    dog, _ = guarded(sim, tmp_path, Saboteur(nan_velocity, at=-1))
    shares = []
    sim.call_every(1, lambda s: shares.append((s.ledger.entries()["energy_residual"], borrowed(s))))
    sim.run()
    gained, lent = np.array(shares).T / sim.ledger.initial_kinetic
    assert dog.retries == 0 and gained.max() > 0.1
    assert gained == pytest.approx(lent, abs=1e-3)


def test_after_a_sound_while_the_full_step_returns(flight, tmp_path, monkeypatch):
    monkeypatch.setattr("periporo.core.watch.watchdog.SNAPSHOT_INTERVAL", 100)
    dog, messages = guarded(flight, tmp_path, Saboteur(nan_velocity, at=150))
    flight.run()
    assert dog.retries == 1 and "back to step 100" in messages[0] and "sound again" in messages[1]
    assert flight.time_step.reduction == 1.0 and flight.dt == 2e-5
    assert flight.step_number == 350  # 100, 100 of half the step to 150 of the others, 150


def reluctant_block(cloud, grid, bears):
    """The falling block of a law that bears so much strain in a step; it strains by 3.4e-5 in its first."""
    gravity, position = [Gravity(np.array([0.0, -10.0]))], grid(8, 6, spacing=SPACING)
    law = Reluctant(**Elastic.example().model_dump(), bears=bears)
    sim = cloud(position, laws=[law], velocity=stretching(position, 0.1), loads=gravity, fixed=2e-5)
    sim.stages = [DynamicsStage("fall", loads=gravity, duration=10 * 2e-5)]
    return sim


def test_a_refused_step_is_answered_with_half_of_it(cloud, grid, tmp_path):
    """Found before anything is made of what the law left; the motion is that of half the step from the start."""
    sim = reluctant_block(cloud, grid, bears=3e-5)
    dog, messages = guarded(sim, tmp_path, Saboteur(nan_velocity, at=-1))
    sim.run()
    assert dog.retries == 1 and "refuses the step (Reluctant: it bears 3e-05)" in messages[0]
    assert "step 1:" in messages[0] and "back to step 0 with 0.5" in messages[0]
    smaller = reluctant_block(cloud, grid, bears=1.0)
    smaller.time_step.fixed = smaller.dt = 1e-5
    smaller.run()
    assert sim.step_number == smaller.step_number == 20
    assert np.isfinite(sim.particles.position).all() and (sim.particles.position == smaller.particles.position).all()


def test_a_law_that_always_refuses_ends_the_run_with_its_reason(cloud, grid, tmp_path):
    sim = reluctant_block(cloud, grid, bears=1e-9)
    guarded(sim, tmp_path, Saboteur(nan_velocity, at=-1))
    with pytest.raises(WatchdogError, match="it bears 1e-09"):
        sim.run()
    assert "it bears 1e-09" in (tmp_path / "run.diagnostic.csv").read_text()


@pytest.mark.parametrize("last", [False, True])
def test_without_a_watchdog_a_refusal_is_an_error(cloud, grid, last):
    """In the next step, or where the stage ends."""
    sim = reluctant_block(cloud, grid, bears=3e-5)
    sim.stages[0].duration = 2e-5 if last else 1.0
    with pytest.raises(RefusedStep, match="refused by Reluctant: it bears 3e-05. The time step is too long"):
        sim.run()
    assert sim.step_number == 1


class Unwilling(Elastic):
    """Has no state for any stress."""

    def initial_state(self, stress, ids, volume):
        raise ValueError("row 0 is too weak")


def test_a_law_without_a_state_to_begin_with_is_an_error_of_the_input(cloud, grid):
    law = Unwilling(**Elastic.example().model_dump())
    with pytest.raises(InputError, match="materials: no start for Unwilling: row 0 is too weak"):
        cloud(grid(4, 4, spacing=SPACING), laws=[law]).start()
    with pytest.raises(InputError, match="materials: no start for Unwilling: row 0 is too weak"):
        moduli_without_stress(law)


class Forgetful(Elastic):
    """Forgets two rows in every call with some strain."""

    def compute_stress(self, stress, strain_increment, state, dt):
        super().compute_stress(stress, strain_increment, state, dt)
        if strain_increment.any():
            raise UpdatesFailed([0, 5])


def test_failed_updates_are_counted_but_not_in_steps_that_are_taken_back(cloud, grid, tmp_path):
    gravity, position = [Gravity(np.array([0.0, -10.0]))], grid(8, 6, spacing=SPACING)
    law = Forgetful(**Elastic.example().model_dump())
    sim = cloud(position, laws=[law], velocity=stretching(position, 0.1), loads=gravity, fixed=2e-5)
    sim.stages = [DynamicsStage("fall", loads=gravity, duration=20 * 2e-5)]
    guarded(sim, tmp_path, Saboteur(nan_velocity, at=9))
    sim.run()
    assert sim.step_number == 40 and sim.failed_updates() == 2 * 40


def test_a_lasting_fault_is_reported(flight, tmp_path):
    dog, messages = guarded(flight, tmp_path, Saboteur(too_fast, at=100, times=99))
    with pytest.raises(WatchdogError) as failure:
        flight.run()
    text = str(failure.value)
    assert f"{MOST_RETRIES} repairs were tried" in text and "point 7 at (" in text and "'sand'" in text
    assert "moves at 3 times the wave speed" in text and "run.diagnostic.csv" in text and "step 100:" in text
    with open(tmp_path / "run.diagnostic.csv", newline="") as file:
        comment, names, *rows = csv.reader(file)
    assert "Likely cause" in comment[0]
    table = {int(row[0]): dict(zip(names, row, strict=True)) for row in rows}
    assert table[7]["offends"] == "1" and float(table[7]["x velocity [m/s]"]) == flight.particles.velocity[7, 0]
    assert sum(row["offends"] == "1" for row in table.values()) == 1 and len(table) > 5
    assert {"xx", "zz", "xy"} <= {name.split()[1] for name in names if name.startswith("stress")}
    place = flight.particles.position
    near = np.sqrt(((place - place[7]) ** 2).sum(axis=1)) < 3 * flight.scheme.horizon
    assert set(table) == set(flight.particles.id[near].tolist())


def test_a_point_without_a_place_is_reported_where_it_was(flight, tmp_path):
    def lose(sim):
        sim.particles.position[11] = np.nan

    before = flight.particles.position[11].copy()
    guarded(flight, tmp_path, Saboteur(lose, at=50, times=99))
    with pytest.raises(WatchdogError, match=rf"point 11 at \({before[0]:.6g}, {before[1]:.6g}\)"):
        flight.run()


def test_an_unstable_step_is_cured_by_a_smaller_one(cloud, grid, tmp_path):
    """One and a half times the stable step: repairs reach a stable one, and the motion is right."""
    position = grid(8, 6, spacing=SPACING)
    sim = cloud(position, velocity=stretching(position, 1e-3))
    limit = sim.dt / 0.8
    sim.time_step.fixed = sim.dt = 1.5 * limit
    sim.stages = [DynamicsStage("shake", duration=400 * limit)]
    dog, messages = guarded(sim, tmp_path, Saboteur(nan_velocity, at=-1))
    sim.run()
    assert 1 <= dog.retries <= 2 and "time step is too long" in messages[0]
    assert sim.ledger.kinetic() < sim.ledger.initial_kinetic


def test_what_is_measured(flight):
    """Figures against their definitions."""
    flight.step()
    p, n = flight.particles, flight.particles.owned
    speeds = wave_speeds(flight)
    law = flight.materials[0]
    assert speeds == pytest.approx([np.sqrt((law.bulk_modulus + 4 / 3 * law.shear_modulus) / law.density)], rel=1e-12)
    ratios, jumps = speed_ratios(flight, speeds), strain_jumps(flight)
    pairs = flight.bonds.pairs
    i, j = (np.concatenate(ends) for ends in ((pairs.first, pairs.second), (pairs.second, pairs.first)))
    w = np.tile(pairs.weight, 2) * p.volume[j]
    sums = [np.bincount(i, w * x, n) for x in (np.ones(len(w)), *(p.velocity[i] - p.velocity[j]).T)]
    assert ratios == pytest.approx(np.hypot(sums[1], sums[2]) / sums[0] / speeds[0], rel=1e-12)
    block = flight.bonds.blocks[0]
    assert jumps.max() == pytest.approx(np.linalg.norm(block.strain_increment[block.active], axis=1).max(), rel=1e-12)
    assert jumps.max() == pytest.approx(np.sqrt(block.peak[0]), rel=1e-12) and block.peak[1] >= 0
    fastest = np.linalg.norm(p.velocity[:n], axis=1).max() / speeds[0]
    assert survey(flight, speeds) == pytest.approx([0.0, fastest, jumps.max()], rel=1e-12)
    p.position[4, 1] = np.inf
    assert survey(flight, speeds)[0] == 1.0 and np.flatnonzero(nan_points(flight)).tolist() == [4]


def test_a_body_may_fly_faster_than_its_waves(cloud, grid, tmp_path):
    """A soft lump after a fall of 50 m, for example: nothing in it moves relative to its neighbours."""
    position = grid(8, 6, spacing=SPACING)
    sim = cloud(position, velocity=np.tile([0.0, -400.0], (48, 1)), fixed=2e-5)
    assert 2.0 * wave_speeds(sim)[0] < 400.0
    sim.stages = [DynamicsStage("fall", duration=200 * 2e-5)]
    dog, messages = guarded(sim, tmp_path, Saboteur(nan_velocity, at=-1))
    sim.run()
    assert dog.retries == 0 and not messages and speed_ratios(sim, wave_speeds(sim)).max() < 1e-9


def test_one_loose_grain_does_not_take_the_run_back(cloud, grid, tmp_path):
    """It passes a block within its horizon at three times the wave speed, and straddles bonds within a step."""
    block = grid(8, 6, spacing=SPACING)
    position = np.concatenate([block, [[-0.02, 0.07]]])
    velocity = np.zeros_like(position)
    sim = cloud(position, velocity=velocity, fixed=2e-5)
    fast = 3.0 * wave_speeds(sim)[0]
    sim.particles.velocity[48, 0] = fast
    sim.stages = [DynamicsStage("pass", duration=30 * 2e-5)]
    dog, messages = guarded(sim, tmp_path, Saboteur(nan_velocity, at=-1))
    company = []
    sim.call_every(1, lambda s: company.append((s.particles.share[48, 1], len(s.bonds.pairs.first))))
    sim.run()
    assert survey(sim, wave_speeds(sim))[1] > 2.5 and max(count for _, count in company) > min(c for _, c in company)
    assert dog.retries == 0 and not messages
    sim.particles.velocity[20, 0] = fast  # one of the block is no grain
    assert np.flatnonzero(speed_ratios(sim, wave_speeds(sim)) > 1.0).tolist() == [20]


def test_the_largest_strain_is_remembered_through_a_rebuild(flight):
    """Until it is looked at, and with the ids of its ends."""
    for block in flight.bonds.blocks:
        block.forget_peak()
    strain_jump(flight)
    flight.step()
    block = flight.bonds.blocks[0]
    peak, ends = block.peak[0], flight.bonds.peak_ends(block).copy()
    assert np.sqrt(peak) > STRAIN_JUMP and 9 in ends
    rebuild(flight)
    flight.step()
    assert block.peak[0] == peak and flight.bonds.peak_ends(block).tolist() == ends.tolist()
    jumps = strain_jumps(flight)
    assert set(np.flatnonzero(jumps > STRAIN_JUMP)) == set(ends) and jumps.max() == np.sqrt(peak)
    block.forget_peak()
    assert block.peak[0] == 0.0 and (flight.bonds.peak_ends(block) == -1).all()
