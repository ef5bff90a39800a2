"""Run time against error: which scheme, horizon, influence and time step are worth their cost?

    python -m benchmarks pareto [--quick] [--problem V5] [--draw] [--folder docs/figures]

Sweeps scheme x influence x m x spacing x safety of the time step over V5, plane P and S packets (error of the phase
speed); V6, a manufactured solution on a grid and on a cloud (displacement, L2); V7, a column under its weight
(settlement of the highest points). Schemes, and one thing at a time around the default, over a footing pushed into
clay (load, against Prandtl's); the pile of `aluminium_bars` (surface, against the measured one); and the collapse of
configs/column_collapse.yaml (how far from where they belong points come to rest, against the mean of the finest runs
of the default, whose volumes are true). Chance decides where single grains come to rest, so every collapse is run
twice, from grids that are shaken by 2 % of a spacing; errors are means. Time is processor time of the run with kernels
compiled before; the least of some repetitions where a run is short. A run is on the front if none is as quick and more
accurate; what the default is to be compared with is the front of the stable schemes, without `standard`. The second
table has, for every choice, its processor time over that of the quickest stable run with no larger error, the geometric
mean over its resolutions: 1 is on that front everywhere. A choice is on the front of all problems together if no stable
one is at least as near to it in each of them. A choice that finds no equilibrium in some problem is left out. Writes
pareto_<problem>.csv, pareto.md and pareto.png. A problem that is run alone leaves the others' figures as they are;
--draw runs none.
"""

import csv
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from periporo.core.motion.relaxation import RelaxationError

from . import FIGURES, option_parser
from .library import problems
from .library.verification_cases import OPTIONS, collapse

UNEVEN = "point_state, sharpened, not regular"
REPEATED_BELOW = 0.1  # s: shorter runs are timed three times
SCHEMES = {
    name: OPTIONS.get(name, name)
    for name in (
        "bond_projected", "bond_projected, points", "point_state", "point_state, sharpened", "sub_horizon", "standard",
    )
} | {UNEVEN: {"scheme": "point_state", "sharpened": True}}  # fmt: skip
UNSTABLE = ("standard",)  # has motions that cost no energy: the beam of V9 bursts, example 1 oscillates
SHAKES = (1, 2)  # seeds of the collapses
MARKS = dict(zip(SCHEMES, "oDsP^xv", strict=True))


@dataclass(frozen=True)
class Choice:
    """What a user may choose; the defaults are those of the program."""

    scheme: str = "point_state, sharpened"
    influence: str = "cubic"
    m: float = 2.2
    safety: float = 0.8

    @property
    def correspondence(self) -> str | dict:
        """The scheme with its options, as in the input file."""
        return SCHEMES[self.scheme]

    def keys(self) -> dict:
        """The other keys of the input file."""
        return {"influence": self.influence, "horizon": self.m, "time_step": {"safety": self.safety}}


DEFAULT = Choice()


@dataclass(frozen=True)
class Run:
    """A run's choice and resolution (points over a length that belongs to the problem), its error and seconds."""

    choice: Choice
    resolution: float
    error: float
    seconds: float


def choices(quick):
    """What is swept in the problems that are quick to solve: influence and m, and the time step at their defaults.

    These are elastic, so what is regular differs in nothing; `sub_horizon` finds no equilibrium with m = 3.
    """
    if quick:
        return [Choice(s) for s in SCHEMES]
    shapes = [(i, m) for i in ("cubic", "conical") for m in (1.8, 2.0, 2.2, 3.0)]
    shapes += [("gaussian", 2.2), ("gaussian", 3.0)]
    shapes += [("constant", 2.1), ("constant", 3.1)]  # it jumps at the horizon: lattice points must not lie there
    found = [Choice(s, *shape) for s in SCHEMES for shape in shapes
             if s != UNEVEN and (s != "sub_horizon" or shape[1] < 3.0)]  # fmt: skip
    return found + [Choice(s, safety=safety) for s in SCHEMES if s != UNEVEN for safety in (0.4, 0.95)]


def sweep(resolutions, error, quick):
    """Every choice at every resolution."""
    for scheme in SCHEMES:
        error(min(resolutions), Choice(scheme))  # compiles
    for choice in choices(quick):
        for resolution in resolutions:
            yield measured(resolution, choice, error)


def measured(resolution, choice, error):
    """The run's error, infinite if it finds no equilibrium, and processor time, the least of three if it is short."""
    seconds = []
    while not seconds or (len(seconds) < 3 and seconds[0] < REPEATED_BELOW):
        began = time.process_time()
        try:
            value = error(resolution, choice)
        except RelaxationError:
            value = np.inf
        seconds.append(time.process_time() - began)
    return Run(choice, resolution, value, min(seconds))


def flow_plan(coarse, fine):
    """(resolution, choice) of problems that take long: all schemes, and around the default one thing at a time."""
    around = [Choice(m=m) for m in (1.8, 3.0)] + [Choice(influence="conical")]
    around += [Choice(safety=s) for s in (0.4, 0.95)]
    plan = [(n, Choice(s)) for n in (*coarse, fine) for s in SCHEMES if n < fine or s != "sub_horizon"]
    return plan + [(n, other) for n in coarse for other in around]


def flows(coarse, fine, error, quick):
    """The runs of a plan, or two of them."""
    plan = [(coarse[0], Choice(s)) for s in ("bond_projected", DEFAULT.scheme)] if quick else flow_plan(coarse, fine)
    for scheme in {choice.scheme for _, choice in plan}:
        error(coarse[0], Choice(scheme))  # compiles
    for resolution, choice in plan:
        yield measured(resolution, choice, error)


def compile_collapse(scheme):
    """Compile all kernels, by the start of a collapse."""
    start = [{"name": "settle", "type": "relax", "tolerance": 0.1, "boundaries": ["left", "right"]},
             {"name": "fall", "type": "dynamics", "duration": 1e-3}]  # fmt: skip
    collapse.fallen(0.01, SCHEMES[scheme], stages=start)


def collapses(quick):
    """The runs of the plan, against the mean of the finest runs of the default."""
    finest, plan = 28, flow_plan((10, 14), 20)
    if quick:
        finest, plan = 12, [(10, Choice(s)) for s in ("bond_projected", "point_state")]
    for scheme in {DEFAULT.scheme} | {choice.scheme for _, choice in plan}:
        compile_collapse(scheme)
    finest = [problems.deposit(finest, DEFAULT, seed) for seed in SHAKES]
    print(f"collapse: two of the finest runs differ by {problems.distance(*finest[:2]):.4f} half-widths", flush=True)
    reference = np.mean(finest, axis=0)
    for cells, choice in plan:
        began = time.process_time()
        errors = [problems.distance(problems.deposit(cells, choice, seed), reference) for seed in SHAKES]
        yield Run(choice, cells, float(np.mean(errors)), (time.process_time() - began) / len(SHAKES))


PROBLEMS = {
    "V5": lambda quick: sweep((8, 12) if quick else (10, 20, 40), problems.wave_error, quick),
    "V6 grid": lambda quick: sweep((6, 8) if quick else (8, 16, 32), problems.grid_error, quick),
    "V6 cloud": lambda quick: sweep((6, 8) if quick else (8, 16, 32), problems.cloud_error, quick),
    "V7": lambda quick: sweep((6, 10) if quick else (10, 20, 40), problems.settlement_error, quick),
    "footing": lambda quick: flows((8, 16), 32, problems.footing_error, quick),
    "bars": lambda quick: flows((10,), 20, problems.bars_error, quick),
    "collapse": collapses,
}
ELASTIC = ("V5", "V6 grid", "V6 cloud", "V7")


def stable(runs):
    """The runs of stable schemes."""
    return [r for r in runs if r.choice.scheme not in UNSTABLE]


def front(runs):
    """The runs that none is as quick as and more accurate than, from the quickest on."""
    found = []
    for run in sorted(runs, key=lambda r: (r.seconds, r.error)):
        if run.error < (found[-1].error if found else np.inf):
            found.append(run)
    return found


def excess(runs, choice):
    """Processor time over that of the quickest stable run no less accurate: geometric mean over the resolutions."""
    own = [r for r in runs if r.choice == choice]
    if not all(np.isfinite(r.error) for r in own):
        return np.nan
    ratios = [r.seconds / min((o.seconds for o in stable(runs) if o.error <= r.error), default=r.seconds) for r in own]
    return float(np.exp(np.log(ratios).mean())) if ratios else np.nan


def twin(choice, problem):
    """The choice, or the default in its place where nothing flows and the two are one."""
    return DEFAULT if choice.scheme == UNEVEN and problem in ELASTIC else choice


def dominates(one, other):
    """Whether ratios (problems,) are nowhere larger than others, and smaller somewhere."""
    return bool((one <= other).all() and (one < other).any())


def path_of(folder, problem):
    """Where the runs of a problem are kept."""
    return folder / f"pareto_{problem.replace(' ', '_')}.csv"


def write_runs(path, runs):
    """The runs as CSV, those of the front marked, and those of the front of the stable schemes."""
    best, sound = front(runs), front(stable(runs))
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        choice = "scheme", "influence", "m", "safety"
        writer.writerow([*choice, "resolution", "error", "seconds", "front", "stable front"])
        for run in runs:
            numbers = run.resolution, f"{run.error:.5g}", f"{run.seconds:.4g}", int(run in best), int(run in sound)
            writer.writerow([*asdict(run.choice).values(), *numbers])


def read_runs(path):
    """The runs of a file."""
    with open(path, newline="") as file:
        return [
            Run(Choice(r["scheme"], r["influence"], float(r["m"]), float(r["safety"])), float(r["resolution"]),
                float(r["error"]), float(r["seconds"])) for r in csv.DictReader(file)
        ]  # fmt: skip


def tables(found):
    """Markdown: the fronts of the stable schemes, and how far each choice is from them."""
    lines = ["| problem | runs | scheme | influence | m | safety | resolution | error | seconds |", "|---" * 9 + "|"]
    for name, runs in found.items():
        for k, r in enumerate(front(stable(runs))):
            c = r.choice
            start = f"| {name} | {len(runs)} " if k == 0 else "| | "
            words = f"{c.scheme} | {c.influence} | {c.m} | {c.safety}"
            lines.append(f"{start}| {words} | {r.resolution:g} | {r.error:.2e} | {r.seconds:.3g} |")
    every = list(dict.fromkeys(r.choice for runs in found.values() for r in runs))
    ratios = {c: np.array([excess(runs, twin(c, name)) for name, runs in found.items()]) for c in every}
    complete = {c: float(np.exp(np.log(r).mean())) for c, r in ratios.items() if np.isfinite(r).all()}
    ranked = sorted(complete, key=complete.get)
    shown = ranked[:12] + [c for c in ranked[12:] if c == DEFAULT or c == Choice(c.scheme)]
    candidates = {c: r for c, r in ratios.items() if c in complete and c.scheme not in UNSTABLE}
    columns = ["scheme", "influence", "m", "safety", *found, "mean", "front"]
    lines += ["", f"| place | {' | '.join(columns)} |", "|---" * (1 + len(columns)) + "|"]
    for c in shown:
        values = " | ".join(f"{r:.2f}" for r in ratios[c])
        words = f"{c.scheme.removeprefix('point_state, ')} | {c.influence} | {c.m} | {c.safety}"
        best = "yes" if c in candidates and not any(dominates(r, ratios[c]) for r in candidates.values()) else ""
        lines.append(f"| {ranked.index(c) + 1} | {words} | {values} | {complete[c]:.2f} | {best} |")
    return lines


def draw(found, path):
    """Error against seconds: all runs, the front, and the defaults."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import NullFormatter

    figure, axes = plt.subplots(2, 4, figsize=(16, 8), layout="constrained")
    for ax, (name, runs) in zip(axes.flat, found.items(), strict=False):
        for scheme, mark in MARKS.items():
            own = [r for r in runs if r.choice.scheme == scheme]
            ax.plot([r.seconds for r in own], [r.error for r in own], mark, ms=4, mfc="none", alpha=0.6, label=scheme)
        for some, line, label in ((runs, "k:", "front"), (stable(runs), "k-", "front of the stable schemes")):
            best = front(some)
            ax.plot([r.seconds for r in best], [r.error for r in best], line, lw=1, label=label)
        own = [r for r in runs if r.choice == DEFAULT]
        ax.plot([r.seconds for r in own], [r.error for r in own], "r*-", ms=9, lw=0.7, label="defaults")
        ax.set(xscale="log", yscale="log", title=name, xlabel="processor time, s", ylabel="error")
        ax.xaxis.set_minor_formatter(NullFormatter())
    for ax in axes.flat[len(found) :]:
        ax.set_axis_off()
    figure.legend(*axes.flat[0].get_legend_handles_labels(), loc="lower right", fontsize=11)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main(words=None):
    """Run, write, draw."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--quick", action="store_true", help="few and small runs: a minute")
    parser.add_argument("--problem", choices=PROBLEMS, help="only this one")
    parser.add_argument("--draw", action="store_true", help="tables and picture of the runs that are there")
    parser.add_argument("--folder", type=Path, default=FIGURES)
    arguments = parser.parse_args(words)
    arguments.folder.mkdir(parents=True, exist_ok=True)
    chosen = [arguments.problem] if arguments.problem else PROBLEMS
    for name in [] if arguments.draw else chosen:
        began = time.perf_counter()
        runs = list(PROBLEMS[name](arguments.quick))
        write_runs(path_of(arguments.folder, name), runs)
        print(f"{name}: {len(runs)} runs in {time.perf_counter() - began:.0f} s", flush=True)
    found = {n: read_runs(path_of(arguments.folder, n)) for n in PROBLEMS if path_of(arguments.folder, n).exists()}
    lines = tables(found)
    (arguments.folder / "pareto.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))
    draw(found, arguments.folder / "pareto.png")
