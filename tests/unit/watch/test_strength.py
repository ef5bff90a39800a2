"""The factor of safety of a block under its weight, what the search leaves behind, and that it goes on when stopped."""

import os
import signal

import numpy as np
import pytest

from periporo import Simulation, run
from periporo.core.watch.state import State, capture, for_file, install, resume
from periporo.core.watch.strength import StabilityError
from periporo.errors import InputError
from periporo.io.output import checkpoint
from periporo.materials.cam_clay import CamClay
from periporo.materials.drucker_prager import DruckerPrager

C = 20e3


LAW = {"model": "drucker_prager", "density": 2000.0, "bulk_modulus": 40e6, "shear_modulus": 10e6, "friction_angle": 0.0}
OTHER = {"model": "cam_clay", "grain_density": 2200.0, "porosity": 0.2, "bulk_modulus": 1e5, "shear_modulus": 6e4,
         "critical_state_slope": 1.1, "compression_index": 0.05, "swelling_index": 0.01}  # fmt: skip


def scene(cohesion=C, law=None, **stage):
    """Clay 6 points wide and high on a smooth floor: sheared through at 45 degrees when its weight is about 4 c."""
    clay = law or LAW | {"cohesion": cohesion}
    return {
        "dimension": 2, "spacing": 0.5, "gravity": [0, -10.0], "materials": {"clay": clay},
        "bodies": [{"name": "b", "material": "clay", "shape": {"type": "box", "lower": [0, 0], "upper": [3, 3]}}],
        "boundaries": {"base": {"where": {"upper": [None, 0.5]}, "fix": ["y"]}},
        "stages": [{"name": "safety", "type": "strength_reduction", "trial": 1.0, "damping": {"viscous": 20.0},
                    "boundaries": ["base"], "accuracy": 0.05, **stage}],
    }  # fmt: skip


def block(*arguments, **keys):
    """The simulation of the scene."""
    return Simulation.from_scene(scene(*arguments, **keys))


def test_a_block_falls_when_its_strength_is_divided_by_the_factor():
    """Mean vertical stress gamma H / 2 over 2 c at the limit of a block that may spread: F = 4 c / (gamma H)."""
    sim = block()
    sim.run()
    (stage,) = sim.stages
    assert 0.0 < stage.falls - stage.stands <= 0.05 * stage.stands
    assert stage.safety == pytest.approx(4.0 * C / (2000.0 * 10.0 * 3.0), rel=0.25)
    assert sim.bonds.blocks[0].material.cohesion == C  # as it was
    p = sim.particles
    moved = np.abs(p.position - p.initial_position).max()
    assert moved > 5e-3  # thrice the elastic settlement: the last trial has failed: its results show how
    entries = sim.ledger.entries()
    assert abs(entries["energy_residual"] - entries["integration_term"]) < 1e-9 * abs(entries["external_work"])


def test_soil_that_does_not_stand_or_cannot_fall_is_told(monkeypatch):
    with pytest.raises(StabilityError, match="does not stand as it is"):
        block(cohesion=0.2 * C).run()
    with pytest.raises(StabilityError, match="stands with its strength divided by 1.1"):
        block(cohesion=10.0 * C, largest=1.1).run()
    with pytest.raises(InputError, match="needs viscous damping"):
        block(damping={"viscous": 0.0})
    block(law=OTHER)
    monkeypatch.delattr(CamClay, "weakened")
    with pytest.raises(InputError, match="does not say how its strength is reduced"):
        block(law=OTHER)


class Stopped(Exception):
    """Something killed the run."""


def stopped(sim):
    """Run it until it is 60 steps into its third trial; the tables of a checkpoint."""
    trials = {}

    def kill(sim):
        stage = sim.stages[0]
        trials.setdefault(stage.factor, sim.step_number)
        if len(trials) == 3 and sim.step_number > trials[stage.factor] + 60:
            raise Stopped

    sim.call_every(1, kill)
    with pytest.raises(Stopped):
        sim.run()
    return for_file(sim)


def test_a_search_that_is_stopped_goes_on_from_the_beginning_of_its_trial_with_the_same_bits():
    whole, parts = block(), block()
    whole.run()
    step, memory, tables = stopped(parts)
    (points, *rows) = [columns for _, _, columns in tables]
    assert step == memory["simulation"]["step_number"] < parts.step_number
    assert memory["stage"]["falls"] == parts.stages[0].falls < np.inf
    again = block()
    resume(again, State.of_tables(points, rows, memory))
    kept = capture(again)
    assert again.stages[0]._is_over(again) is False
    install(again, kept)  # as the watchdog takes it back before it has kept another state
    again.run(resumed=True)
    assert again.stages[0].safety == whole.stages[0].safety and again.step_number == whole.step_number
    assert np.array_equal(again.particles.position, whole.particles.position)
    assert np.array_equal(again.particles.velocity, whole.particles.velocity)
    assert again.bonds.blocks[0].material.cohesion == C


def test_a_trial_has_one_checkpoint(tmp_path, monkeypatch):
    """Parts that are written again would be damaged by a kill, and may be all that there is."""
    write, written, trials = checkpoint.write, [], set()

    def note(background, target, step, *others):
        written.append(step)
        return write(background, target, step, *others)

    def ask(sim):
        os.kill(os.getpid(), signal.SIGUSR1)
        trials.add(sim.stages[0].factor)
        if len(trials) == 3:
            raise Stopped

    monkeypatch.setattr(checkpoint, "write", note)
    for resume_it in (False, True):
        trials.clear()
        with pytest.raises(Stopped):
            run(scene() | {"output": {"parts": 2}}, tmp_path / "b.vtkhdf", quiet=True, resume=resume_it,
                callbacks=[(30, ask)])  # fmt: skip
    assert len(written) == len(set(written)) == 3 and written[0] == 0


def test_a_state_of_the_trial_before_has_the_strength_of_that_trial():
    """As the watchdog takes a run back."""
    sim, kept = block(), []

    def keep(sim):
        kept.append((sim.bonds.blocks[0].material.cohesion, capture(sim)))

    sim.call_every(50, keep)
    stopped(sim)
    strength, state = kept[0]
    assert strength == C > sim.bonds.blocks[0].material.cohesion
    install(sim, state)
    assert sim.stages[0]._is_over(sim) is False
    assert sim.bonds.blocks[0].material.cohesion == strength


def test_weaker_soil_has_less_of_both():
    law = DruckerPrager.example().weakened(1.5)
    strong = DruckerPrager.example()
    assert law.cohesion == pytest.approx(strong.cohesion / 1.5)
    for name in ("friction_angle", "dilation_angle"):
        ratio = np.tan(np.radians(getattr(strong, name))) / np.tan(np.radians(getattr(law, name)))
        assert ratio == pytest.approx(1.5)
