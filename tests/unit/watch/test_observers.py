"""Observers and stages: what is called, when results and histories are written, how a stage ends."""

from types import SimpleNamespace

import numpy as np
import pytest

from periporo.core.loads.boundary import Gravity, ViscousDamping
from periporo.core.motion.stages import DynamicsStage, RelaxStage
from periporo.core.points.particles import Particles
from periporo.core.watch import observers

SPACING = 0.01


class Notebook:
    """A writer that remembers."""

    def __init__(self):
        self.outputs, self.rows = [], []

    def write(self, time, step, ids, position, values):
        self.outputs.append((time, step, position.copy(), values))

    def append_history(self, row):
        self.rows.append(dict(row))


class Witness(observers.Observer):
    """Notes every call."""

    def __init__(self):
        self.calls = []

    def start_stage(self, sim, stage):
        self.calls.append(("start", stage.name, sim.time))

    def after_step(self, sim):
        self.calls.append("step")

    def finish_stage(self, sim, stage, summary):
        self.calls.append(("finish", stage.name, summary))


@pytest.fixture
def flight(cloud, grid):
    """A block in free fall, dt = 1e-4 s, with two stages of 10 and 5 steps."""
    gravity = [Gravity(np.array([0.0, -10.0]))]
    sim = cloud(grid(4, 3, spacing=SPACING), fixed=1e-4, loads=gravity)
    sim.stages = [DynamicsStage("a", loads=gravity, duration=1e-3), DynamicsStage("b", loads=gravity, duration=5e-4)]
    return sim


def test_calls_come_in_order(flight):
    flight.observers = [witness := Witness()]
    flight.run()
    steps = [c for c in witness.calls if c == "step"]
    others = [c for c in witness.calls if c != "step"]
    assert len(steps) == 15
    assert [c[:2] for c in others] == [("start", "a"), ("finish", "a"), ("start", "b"), ("finish", "b")]
    assert others[2][2] == pytest.approx(1e-3) and others[3][2] == "t = 0.0015 s"


def test_an_observer_may_do_nothing(flight):
    flight.observers = [observers.Observer()]
    flight.run()
    assert flight.step_number == 15


def test_results_at_start_interval_and_end(flight):
    book = Notebook()
    flight.observers = [observers.ResultObserver(book, ["velocity"], 2.5e-4)]
    flight.run()
    assert [step for _, step, _, _ in book.outputs] == [0, 3, 5, 8, 10, 13, 15]
    time, _, position, values = book.outputs[-1]
    assert time == pytest.approx(1.5e-3) and position.shape == (12, 2)
    assert values["velocity"][:, 1] == pytest.approx(np.full(12, -1.5e-2), rel=1e-9)


@pytest.mark.parametrize("dt", [1e-4, 1e-5 / 3, 7e-6])
def test_outputs_of_fixed_steps_come_at_multiples_of_the_interval(dt):
    """Sums of many steps fall short of n intervals, or exceed them, by a few units in the last place."""
    book, clock = Notebook(), SimpleNamespace(time=0.0, step_number=0, bonds=None, forces=SimpleNamespace(names=[]))
    clock.particles, clock.point_processes, clock.reactions = Particles(2), [], []
    observer = observers.ResultObserver(book, [], 3 * dt)
    observer.start_stage(clock, DynamicsStage("long", duration=300 * dt))
    for number in range(1, 301):
        clock.time, clock.step_number = clock.time + dt, number
        observer.after_step(clock)
    assert [step for _, step, *_ in book.outputs] == list(range(0, 301, 3))
    times = np.array([time for time, *_ in book.outputs])
    assert times / (3 * dt) == pytest.approx(np.arange(101), rel=0, abs=1e-9)


def test_results_default_to_a_fiftieth_of_the_stage(flight):
    book = Notebook()
    flight.stages = [DynamicsStage("long", duration=0.02)]
    flight.observers = [observers.ResultObserver(book, [], None)]
    flight.run()
    assert len(book.outputs) == 51
    times = [time for time, *_ in book.outputs]
    assert times == pytest.approx(np.linspace(0.0, 0.02, 51), abs=1.01e-4)  # within a step, never before it is due


def test_histories_hold_the_figures_of_the_motion(flight):
    book = Notebook()
    flight.observers = [history := observers.HistoryObserver(book, 4)]
    flight.run()
    assert [row["step"] for row in book.rows] == [0, 4, 8, 10, 12, 15]
    figures = set(observers.HistoryObserver.UNITS) - {"plastic_dissipation", "water_work"}  # which nothing here reports
    assert set(book.rows[0]) == {"step", *figures}
    last = book.rows[-1]
    assert last == history.latest
    fallen = 0.5 * 10.0 * 1.5e-3**2
    assert last["height"] == pytest.approx(0.03 - fallen, rel=1e-9) and last["front"] == pytest.approx(0.02, rel=1e-9)
    assert last["max_speed"] == pytest.approx(1.5e-2, rel=1e-9) and last["dt"] == 1e-4
    assert last["kinetic_energy"] == pytest.approx(last["external_work"], rel=1e-9)


def test_nan_shows_in_the_histories(flight):
    book = Notebook()
    flight.observers = [observers.HistoryObserver(book, 1)]
    flight.particles.velocity[2, 0] = np.nan
    flight.run()
    assert np.isnan([book.rows[-1][name] for name in ("max_speed", "kinetic_energy", "front")]).all()


def test_progress_is_told_what_the_history_holds(flight):
    class Display:
        calls = []

        def start_stage(self, name, end, points):
            self.calls.append((name, end, points))

        def update(self, time, dt, step, **figures):
            self.calls.append((step, figures["max_speed"], figures["rebuilds"]))

        def finish_stage(self, summary):
            self.calls.append(summary)

    flight.stages = flight.stages[:1]
    history = observers.HistoryObserver(Notebook(), 1)
    flight.observers = [history, observers.ProgressObserver(Display(), history)]
    flight.run()
    assert Display.calls[0] == ("a", pytest.approx(1e-3), 12) and Display.calls[-1] == "t = 0.001 s"
    assert Display.calls[5] == (5, pytest.approx(5e-3, rel=1e-9), 1)


def test_a_stage_ends_early_at_rest(cloud, grid):
    sim = cloud(grid(4, 3, spacing=SPACING), fixed=1e-4, velocity=np.full((12, 2), 1.0), start=False)
    sim.forces.need("damping")
    sim.start()
    sim.observers = [witness := Witness()]
    damping = [ViscousDamping(200.0)]
    sim.stages = [DynamicsStage("slow", loads=damping, duration=10.0, rest_fraction=1e-3, rest_interval=10)]
    sim.run()
    decay = np.log(1e3) / 400.0  # kinetic energy falls as exp(-2 r t) from its first look, at t = 1 ms
    assert sim.time == pytest.approx(decay + 1e-3, abs=2e-3)
    assert witness.calls[-1][2].startswith("at rest at t = ")


def test_stages_put_their_conditions_in_force(cloud, grid):
    sim = cloud(grid(4, 3, spacing=SPACING), fixed=1e-5)
    pull = [Gravity(np.array([1.0, 0.0]))]
    sim.stages = [DynamicsStage("pulled", loads=pull, duration=1e-4), DynamicsStage("free", duration=1e-4)]
    sim.run()
    assert sim.loads == [] and sim.particles.velocity[:, 0] == pytest.approx(np.full(12, 1e-4), rel=1e-9)
    assert not sim.particles.external_force.any()


def test_a_relaxation_stage_reports_and_takes_no_time(scene_of, started):
    walls = {"fix": ["x"], "where": {"body": "block"}}
    scene = scene_of(counts=(4, 4), boundaries={"walls": walls})
    scene["stages"] = [{"name": "settle", "type": "relax", "tolerance": 1e-3, "boundaries": ["walls"]}]
    sim = started(scene)
    book = Notebook()
    sim.observers = [witness := Witness(), observers.ResultObserver(book, [], None)]
    sim.run()
    assert isinstance(sim.stages[0], RelaxStage) and sim.time == 0.0
    assert "out-of-balance force" in witness.calls[-1][2] and "of the load after" in witness.calls[-1][2]
    assert len(book.outputs) == 1  # a scene that only relaxes: its end
