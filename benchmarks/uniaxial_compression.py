"""Uniaxial compression of an elastic block: oscillations of the stress and what removes them.

    python -m benchmarks uniaxial_compression [--quick] [--only PATTERN] [--folder DIR] [--draw]

Example 1 of Menon & Song (2022, section 4.1): quasi-static and dynamic, by every scheme. Each case runs in a folder
of its own below DIR, as an ordinary scene. What is finished is skipped, what was interrupted goes on. Then the
pictures and the table uniaxial_compression.md in docs/figures are made from the cases that are there; --draw does
only that. --quick runs 1100 points and leaves pictures and table in DIR. --only takes the cases whose name matches
a pattern such as 'static-*'. Exit status 1 if a stable scheme fails, or oscillates more than a twentieth of `standard`
with the constant influence of the publication.
"""

import sys
import time
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
from mpi4py import MPI

from periporo.core.cli import RUN_ERROR
from periporo.core.points import fields
from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene
from periporo.io.output.results import open_results

from . import FIGURES, option_parser
from .library import runs
from .library.uniaxial_figures import draw
from .library.verification_cases import BALANCED, OPTIONS

SCENE, RESULT, FAILURE = "block.yaml", "block.vtkhdf", "failure.npz"
LENGTH = 0.975  # m, between the innermost held points
LAYERS = 3  # columns of points that are held, or driven, at each end
SPEED = 5e-3  # m/s, of the driven end
BULK, SHEAR = 25e6, 15e6  # Pa
PLANE_MODULUS = (
    4.0 * SHEAR * (3.0 * BULK + SHEAR) / (3.0 * BULK + 4.0 * SHEAR)
)  # E/(1 - nu^2): free sides, plane strain
SHARPENED, PUBLISHED = "point_state, sharpened", "sub_horizon_published"
STABLE = ("bond_projected", "point_state", SHARPENED, "sub_horizon")
TIMES_LOWER = 20.0  # than in `standard`, that is what the oscillations of a stable scheme must be
GROWTH = 1e5  # of the largest kinetic energy that there can be: a run without a watchdog ends there
QUICK = (60, 18)


@dataclass(frozen=True)
class Case:
    """A block of `counts` points along and across, the largest displacement of whose end is `push` m.

    `horizon` in spacings; `jitter` of the points in spacings; `step` s is a fixed time step.
    """

    loading: str  # static or dynamic
    scheme: str
    horizon: float = 2.1
    influence: str = "constant"
    jitter: float = 0.0
    counts: tuple[int, int] = (200, 60)
    push: float = 0.5e-3
    step: float | None = None

    @property
    def name(self) -> str:
        """Name of the case's folder."""
        parts = [
            self.loading,
            self.scheme.replace(", ", "_"),
            self.influence,
            f"m{self.horizon:g}",
            f"{self.counts[0] * self.counts[1]}",
        ]
        parts += [f"jitter{self.jitter:g}"] if self.jitter else []
        parts += [f"dt{1e6 * self.step:g}us"] if self.step else []
        return "-".join(parts)

    @property
    def spacing(self) -> float:
        """Distance of the points, m."""
        return LENGTH / (self.counts[0] + 1 - 2 * LAYERS)

    @property
    def stress(self) -> float:
        """Axial stress of the bar in equilibrium, Pa."""
        return -PLANE_MODULUS * self.push / LENGTH

    def scene(self) -> dict:
        """The input of the case, as `periporo` reads it."""
        (columns, rows), spacing = self.counts, self.spacing
        layer = LAYERS * spacing
        duration = self.push / SPEED if self.loading == "dynamic" else 0.02
        motion = {"times": [0.0, duration], "values": [0.0, -self.push]}
        ends = {
            "held": {"where": {"upper": [layer, None]}, "fix": ["x"]},
            "driven": {"where": {"lower": [columns * spacing - layer, None]}, "displacement": {"x": motion}},
        }
        press = {"name": "press", "type": "dynamics", "duration": duration, "boundaries": list(ends)}
        stages = [press]
        if self.loading == "static":
            press["damping"] = {"viscous": 2000.0}
            stages.append({"name": "settle", "type": "relax", "tolerance": 1e-6, "max_steps": 20_000,
                           "boundaries": list(ends)})  # fmt: skip
        corners = {"lower": [0.0, -0.5 * rows * spacing], "upper": [columns * spacing, 0.5 * rows * spacing]}
        return {
            "title": self.name,
            "dimension": 2,
            "spacing": spacing,
            "horizon": self.horizon,
            "influence": self.influence,
            "correspondence": OPTIONS.get(self.scheme, self.scheme),
            "materials": {
                "soil": {"model": "elastic", "density": 1760.0, "bulk_modulus": BULK, "shear_modulus": SHEAR}
            },
            "bodies": [
                {"name": "block", "material": "soil", "jitter": self.jitter, "shape": {"type": "box"} | corners}
            ],
            "boundaries": ends,
            "stages": stages,
            "time_step": {"fixed": self.step},
            # the driven end sets out like a blow: what that takes is much of the work of the first hundred steps
            "monitor": {"energy_tolerance": 1.0 if self.loading == "dynamic" else 0.01},
            "output": {"fields": ["displacement", "stress"], "file": RESULT, "interval": 0.05 * duration},
            "checkpoint": {"interval": 60.0},
        }


def all_cases() -> list[Case]:
    """The cases of the publication, then those with another influence, displaced points, and its short time step."""
    schemes = ("standard", *STABLE, PUBLISHED)
    loadings = ("static", "dynamic")
    cases = [Case(loading, s, m) for loading in loadings for m in (2.1, 3.1) for s in schemes]
    finer = [(224, 67), (315, 95), (405, 123)]
    cases += [Case("dynamic", "bond_projected", counts=n, push=1e-3) for n in finer]
    cases += [Case(loading, s, 2.2, "cubic", j) for j in (0.0, 0.1) for loading in loadings for s in schemes[:-1]]
    cases += [Case(loading, scheme, 2.2, "cubic", 0.1) for loading in loadings for scheme in BALANCED]
    return cases + [
        Case("dynamic", s, counts=QUICK, step=t) for t in (None, 3e-6) for s in ("standard", "bond_projected")
    ]


def quick_cases() -> list[Case]:
    """Small blocks by every scheme."""
    chosen = (c for c in all_cases() if c.horizon == 2.1 and c.counts == (200, 60))
    return [replace(c, counts=QUICK) for c in chosen]


def has_ended(folder: Path) -> bool:
    """Whether the run in a folder came to its end, or failed."""
    return (folder / FAILURE).exists() or runs.is_finished(folder / RESULT)


def run(case: Case, folder: Path) -> None:
    """Run a case in `folder`, or the rest of it. A changed case starts anew; FAILURE records one that fails.

    The published force is run without a watchdog if it is to move: it fails, sooner or later. Raises RuntimeError if
    the scene cannot be run at all.
    """
    scene, failure = folder / SCENE, folder / FAILURE
    if runs.is_same(case.scene(), scene) and has_ended(folder):
        return
    failure.unlink(missing_ok=True)
    if case.scheme == PUBLISHED and case.loading == "dynamic":
        runs.write(case.scene(), scene)
        np.savez_compressed(failure, **unwatched(case))
        return
    status = runs.run(case.scene(), scene, folder / RESULT)
    if status == RUN_ERROR and case.loading == "static":
        np.savez_compressed(failure)
    elif status:
        raise RuntimeError(f"{folder}: periporo ended with status {status}")


def unwatched(case: Case) -> dict[str, np.ndarray]:
    """Time, s, and kinetic energy, J, of a case that nothing stops, and the stress of its points when it bursts.

    Kinetic energy cannot exceed that of a block as fast as the driven end, `bound`; it has burst then. `GROWTH` times
    that is the end. Raises RuntimeError if the case comes to its end before.
    """
    sim = build(parse_scene(case.scene()), MPI.COMM_SELF)
    sim.start()
    p, stage = sim.particles, sim.stages[0]
    sim.prescribed_motions, sim.contacts, sim.loads = stage.prescribed_motions, stage.contacts, stage.loads
    bound = 0.5 * p.mass.sum() * SPEED**2
    times, kinetic, burst = [0.0], [0.0], {}
    while kinetic[-1] < GROWTH * bound:
        if sim.time >= stage.duration:
            raise RuntimeError(f"{case.name}: kinetic energy never exceeds {GROWTH * bound:.3g} J")
        sim.step()
        times.append(sim.time)
        kinetic.append(sim.ledger.kinetic())
        if not burst and kinetic[-1] > bound:
            order = np.argsort(p.id[: p.owned])
            stress = fields.values(sim, ("stress",))["stress"][:, 0]
            burst = {"passed": sim.time, "stress": stress[order], "x": p.initial_position[order, 0]}
    return burst | {"time": np.array(times), "kinetic": np.array(kinetic), "bound": bound}


@dataclass(frozen=True)
class Measured:
    """Figures of a case at its end."""

    x: np.ndarray  # m, (n,) of the points next above the axis, from the innermost held point on
    axial: np.ndarray  # Pa, (n,) their axial stress
    stress: np.ndarray  # Pa, (columns, rows) axial stress of all points
    time: float  # s
    steps: int
    seconds: float  # wall time
    failed: bool
    growth: tuple | None  # of motion that failed: times, s, kinetic energies, J, and the largest that can be


def measure(case: Case, folder: Path) -> Measured:
    """The end of a run; of motion that failed, when its kinetic energy became more than it can be."""
    failed, growth, seconds = (folder / FAILURE).exists(), None, np.nan
    if failed and case.loading == "dynamic":
        with np.load(folder / FAILURE) as f:
            x, stress, time, growth = f["x"], f["stress"], float(f["passed"]), (f["time"], f["kinetic"], f["bound"])
        steps = int(np.searchsorted(growth[0], time))
    else:
        with open_results(folder / RESULT) as r:
            stress, time, steps = r.field("stress")[:, 0], float(r.times[-1]), int(r.history("step")[-1])
            x, seconds = (r.positions() - r.field("displacement"))[:, 0], r.attributes.get("wall_time_s", np.nan)
    stress, x = stress.reshape(case.counts), x.reshape(case.counts)  # ids run along the columns
    row = case.counts[1] // 2
    return Measured(x[:, row] - x[LAYERS - 1, row], stress[:, row], stress, time, steps, seconds, failed, growth)


def oscillation(case: Case, measured: Measured) -> float:
    """Total variation of the axial stress along the axis beyond that of a monotone profile, over the exact stress.

    sum |s_{k+1} - s_k| - |s_n - s_1| for the points of a row that are three or more columns from held ones.
    """
    s = inner(measured)
    return float((np.abs(np.diff(s)).sum() - abs(s[-1] - s[0])) / abs(case.stress))


def inner(measured: Measured) -> np.ndarray:
    """Axial stress of the points of the row whose neighbourhoods hold no held point, Pa."""
    return measured.axial[2 * LAYERS : -2 * LAYERS]


HEAD = "| loading | influence, m | points | scheme | oscillation | standard / it | mean / exact | steps | wall, s | |"


def table(done: dict[Case, Measured]) -> tuple[list[str], bool]:
    """Lines of the table, and whether the stable schemes do what they must."""
    lines, sound = [HEAD, "|---" * 10 + "|"], True
    for case, m in done.items():
        cloud = f"{case.counts[0] * case.counts[1]}" + (f", jitter {case.jitter:g}" if case.jitter else "")
        cloud += f", Δt {1e6 * case.step:g} µs" if case.step else ""
        start = f"| {case.loading} | {case.influence}, {case.horizon:g} | {cloud} | {case.scheme} |"
        stable, times = case.scheme in (*STABLE, *BALANCED), ""
        value, reference = oscillation(case, m), done.get(replace(case, scheme="standard"))
        if stable and reference is not None:
            ratio = oscillation(case, reference) / value
            times = f"{ratio:.0f}"
            sound &= bool(ratio >= TIMES_LOWER) or case.influence != "constant"
        sound &= not (stable and m.failed)
        mean, end = inner(m).mean() / case.stress, ""
        if m.failed:
            end = f"bursts after {1e3 * m.time:.2g} ms" if m.growth else "pressed; finds no equilibrium"
        seconds = "" if m.failed else f"{m.seconds:.0f}"
        lines.append(f"{start} {value:.3g} | {times} | {mean:.3f} | {m.steps} | {seconds} | {end} |")
    return lines, sound


def main(words=None):
    """Run, draw, tabulate."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--quick", action="store_true", help="1100 points, pictures and table into the folder")
    parser.add_argument("--only", default="*", metavar="PATTERN", help="only cases whose name matches")
    parser.add_argument("--folder", type=Path, default=Path("uniaxial_compression"), help="where the runs are kept")
    parser.add_argument("--draw", action="store_true", help="run nothing")
    arguments = parser.parse_args(words)
    folder = arguments.folder.resolve()
    cases = quick_cases() if arguments.quick else all_cases()
    for case in [] if arguments.draw else cases:
        if fnmatch(case.name, arguments.only):
            began = time.monotonic()
            run(case, folder / case.name)
            print(f"{case.name} {time.monotonic() - began:.0f} s", flush=True)
    done = {case: measure(case, folder / case.name) for case in cases if has_ended(folder / case.name)}
    target = folder if arguments.quick else FIGURES
    lines, sound = table(done)
    print("\n".join(lines))
    (target / "uniaxial_compression.md").write_text("\n".join(lines) + "\n")
    draw(done, target)
    sys.exit(0 if sound else 1)
