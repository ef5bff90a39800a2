"""Columns with parameters drawn at random: none may abort, become NaN, or be faster than its fall allows.

    python -m benchmarks robustness [--draws 60] [--spacing 5e-3] [--duration 0.5]

Drawn are the height of a column of half-width 5 cm, friction of the floor, suction, slope of the critical state line,
plastic compressibility, viscosity, jitter, influence function, horizon and share of the stable time step. The table
is docs/figures/robustness.csv; draws that are in it are not run again. Exit status 1 if a draw fails.
"""

import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

from periporo.core.motion.relaxation import RelaxationError
from periporo.core.scene.build import build
from periporo.core.watch.observers import Observer
from periporo.core.watch.watchdog import Watchdog, WatchdogError
from periporo.io.input.load import parse_scene

from . import FIGURES, option_parser
from .library.rows import read_rows, write_rows

TABLE = FIGURES / "robustness.csv"
SEED = 2022
HALF_WIDTH, GRAVITY = 0.05, 9.81
FASTEST = 3.0  # times the speed sqrt(2 g H) of a fall from the top
INFLUENCES = ("cubic", "conical", "gaussian", "constant")


@dataclass(frozen=True)
class Draw:
    """Parameters in SI units; `suction` None is dry soil, `horizon` in spacings, `safety` of the time step."""

    number: int
    height: float
    friction: float
    suction: float | None
    slope: float
    compressibility: float
    viscosity: float
    jitter: float
    influence: str
    horizon: float
    safety: float


@dataclass(frozen=True)
class Outcome:
    """How a draw went: `speed` over sqrt(2 g H), lengths over the half-width, repairs by the watchdog."""

    verdict: str
    speed: float
    front: float
    height_left: float
    kinetic: float  # last over peak
    steps: int
    retries: int
    flying: int
    seconds: float

    @property
    def sound(self) -> bool:
        """Whether the draw did what it must; NaN does not."""
        return self.verdict == "done" and self.speed <= FASTEST and np.isfinite([self.front, self.height_left]).all()


def draw(number: int) -> Draw:
    """Draw `number`, the same whatever was drawn before."""
    rng = np.random.default_rng([SEED, number])
    wet, viscous = rng.random() < 0.6, rng.random() < 0.7
    return Draw(
        number=number,
        height=0.005 * round(float(10 ** rng.uniform(np.log10(5), np.log10(40)))),
        friction=float(rng.uniform(0.0, 1.0)),
        suction=float(rng.uniform(0.0, 1000.0)) if wet else None,
        slope=float(rng.uniform(0.6, 1.5)),
        compressibility=float(10 ** rng.uniform(-3, -1)),
        viscosity=float(10 ** rng.uniform(0, 10)) if viscous else 0.0,
        jitter=float(rng.uniform(0.0, 0.3)),
        influence=INFLUENCES[rng.integers(4)],
        horizon=float(rng.uniform(1.8, 3.2)),
        safety=float(rng.uniform(0.3, 0.9)),
    )


def scene(d: Draw, spacing: float, duration: float) -> dict:
    """The input of a draw: settled between rollers, then let go."""
    wall = HALF_WIDTH - spacing
    soil = {
        "model": "cam_clay", "grain_density": 2200.0, "porosity": 0.2, "bulk_modulus": 25e6, "shear_modulus": 15e6,
        "critical_state_slope": d.slope, "compression_index": 0.005 + d.compressibility, "swelling_index": 0.005,
        "viscosity": d.viscosity, "overconsolidation_ratio": 1.25,
    }  # fmt: skip
    column = {"type": "box", "lower": [-HALF_WIDTH, 0.0], "upper": [HALF_WIDTH, d.height]}
    water = {"pore_water": {"suction": d.suction, "retention": {"set": "fitted"}}} if d.suction is not None else {}
    return water | {
        "dimension": 2, "spacing": spacing, "horizon": d.horizon, "influence": d.influence, "seed": d.number,
        "gravity": [0.0, -GRAVITY], "materials": {"soil": soil},
        "bodies": [{"name": "column", "material": "soil", "shape": column, "jitter": d.jitter}],
        "initial_stress": {"type": "geostatic", "K0": 0.7},
        "boundaries": {
            "left": {"where": {"upper": [-wall, None]}, "fix": ["x"]},
            "right": {"where": {"lower": [wall, None]}, "fix": ["x"]},
        },
        "contacts": [{"type": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": d.friction}],
        "time_step": {"safety": d.safety},
        "stages": [
            {"name": "settle", "type": "relax", "tolerance": 1e-3, "boundaries": ["left", "right"]},
            {"name": "collapse", "type": "dynamics", "duration": duration, "stop_when_at_rest": 1e-6},
        ],
    }  # fmt: skip


class Peaks(Observer):
    """The largest speed (m/s) and kinetic energy (J) of the motion; NaN stays."""

    def __init__(self):
        self.speed, self.kinetic = 0.0, 0.0

    def after_step(self, sim):
        """Look now and then."""
        if not sim.rate_independent and sim.step_number % 20 == 0:
            velocity = sim.particles.velocity[: sim.particles.owned]
            self.speed = np.maximum(self.speed, np.sqrt((velocity**2).sum(axis=1).max()))
            self.kinetic = max(self.kinetic, sim.ledger.kinetic())


def run(d: Draw, spacing: float, duration: float) -> Outcome:
    """Run a draw under the watchdog, as from the command line."""
    began = time.perf_counter()
    sim, peaks = build(parse_scene(scene(d, spacing, duration)), MPI.COMM_SELF), Peaks()
    sim.observers.append(peaks)
    verdict = "done"
    with tempfile.TemporaryDirectory() as folder:
        watchdog = Watchdog(0.01, ["soil"], Path(folder) / "diagnostic.csv", message=lambda text: None)
        sim.guards = [watchdog]
        sim.start()
        try:
            sim.run()
        except (WatchdogError, RelaxationError) as error:  # the failures that this benchmark counts
            verdict = f"{type(error).__name__}: {error}".splitlines()[0]
    p, n = sim.particles, sim.particles.owned
    bonded = p.share[:n, 1] > 0.0
    return Outcome(
        verdict=verdict,
        speed=float(peaks.speed / np.sqrt(2.0 * GRAVITY * d.height)),
        front=float((np.quantile(np.abs(p.position[:n, 0]), 0.99) + 0.5 * spacing) / HALF_WIDTH),
        height_left=float((p.position[:n, 1][bonded].max() + 0.5 * spacing) / HALF_WIDTH),
        kinetic=float(sim.ledger.kinetic() / max(peaks.kinetic, 1e-300)),
        steps=sim.step_number,
        retries=watchdog.retries,
        flying=int((~bonded).sum()),
        seconds=round(time.perf_counter() - began, 1),
    )


def main(words=None):
    """Run what the table lacks, and sum up."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--draws", type=int, default=60)
    parser.add_argument("--spacing", type=float, default=5e-3, help="m")
    parser.add_argument("--duration", type=float, default=0.5, help="s, at most")
    parser.add_argument("--table", type=Path, default=TABLE)
    arguments = parser.parse_args(words)
    rows = read_rows(arguments.table)
    for number in range(arguments.draws):
        if number in rows:
            continue
        d = draw(number)
        outcome = run(d, arguments.spacing, arguments.duration)
        rows[number] = _row(d, outcome)
        write_rows(arguments.table, rows)
        print(f"{number:3d} {outcome.verdict}, speed {outcome.speed:.2f}, {outcome.seconds} s", flush=True)
    bad = [number for number, row in rows.items() if row["sound"] != "yes"]
    fastest = max(float(row["speed"]) for row in rows.values())
    print(f"{len(rows)} draws, fastest point {fastest:.2f} sqrt(2 g H), not sound: {bad or 'none'}")
    sys.exit(1 if bad else 0)


def _row(d, outcome):
    entries = asdict(d) | asdict(outcome) | {"sound": "yes" if outcome.sound else "no"}
    return {k: f"{v:.4g}" if isinstance(v, float) else "" if v is None else str(v) for k, v in entries.items()}
