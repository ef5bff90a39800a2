"""Spectra of the correspondence schemes: are they stable, and what costs no energy?

    python -m benchmarks stability [--quick] [--scheme point_state] [--folder docs/figures]

For a free elastic block the linear operator of each scheme is assembled by probing the program's own kernels with
unit displacements, over influence function, horizon m, jitter and dimension. Of its eigenvalues omega^2 the table
says: asymmetry, most negative and most complex one, growth rate over the highest frequency, motions without energy,
lowest frequency of a motion that is not rigid, and the largest stable time step against the one the program takes.
Writes stability.csv, stability.md and the plots stability_growth.png, stability_modes.png, stability_runs.png; the
figures of one scheme are only printed.
"""

import csv
import itertools
import time
from pathlib import Path

import numpy as np

from periporo.core.motion.timestep import apply_stiffness

from . import FIGURES, option_parser
from .library.elastic_block import SCHEMES, SPACING, WAVE_SPEED, block

ZERO = 1e-9  # eigenvalues below this part of the largest are motions without energy
ROUNDING = 1e-13  # and below this they are rounding

RUNS = (  # with constant influence, lattice points exactly at the horizon would flicker in and out of it: m = 2.1
    ("bond_projected", "cubic", 2.2), ("point_state", "cubic", 2.2), ("point_state", "constant", 2.1),
    ("point_state, sharpened", "cubic", 2.2), ("point_state, sharpened", "constant", 2.1),
    ("sub_horizon", "cubic", 2.2), ("standard", "cubic", 2.2),
    ("sub_horizon", "constant", 2.1), ("bond_projected", "constant", 2.1), ("bond_projected", "constant", 2.0),
    ("published", "cubic", 2.2), ("published", "cubic", 3.1), ("published", "constant", 2.1),
    ("published", "constant", 3.1), ("published, own ends", "constant", 3.1),
)  # fmt: skip
COLUMNS = (
    "scheme", "dimension", "influence", "m", "jitter", "asymmetry", "most_negative", "most_complex", "growth",
    "zero_modes", "lowest", "stable_step", "chosen_step",
)  # fmt: skip


def operator(sim) -> np.ndarray:
    """Stiffness over mass (n d, n d), 1/s^2, one production step for each unit displacement."""
    p = sim.particles
    size = p.owned * p.dimension
    matrix = np.empty((size, size))
    for k in range(size):
        displacement = np.zeros((p.owned, p.dimension))
        displacement.flat[k] = 1.0
        matrix[:, k] = (apply_stiffness(sim, displacement) / p.mass[:, None]).ravel()
    return matrix


def eigenvalues(matrix) -> np.ndarray:
    """Eigenvalues, by the solver for symmetric matrices if the matrix is symmetric to rounding."""
    if asymmetry(matrix) < 1e-12:
        return np.linalg.eigvalsh(0.5 * (matrix + matrix.T)).astype(complex)
    return np.linalg.eigvals(matrix)


def asymmetry(matrix) -> float:
    """Largest difference to the transpose over the largest entry."""
    return float(np.abs(matrix - matrix.T).max() / np.abs(matrix).max())


def figures(sim, matrix) -> dict[str, float]:
    """What the spectrum of `matrix` says; eigenvalues in units of the largest."""
    values = eigenvalues(matrix)
    largest = np.abs(values).max()
    ratio = values / largest
    ratio[np.abs(ratio) < ROUNDING] = 0.0
    rigid = 3 if sim.particles.dimension == 2 else 6
    unit = SPACING / WAVE_SPEED
    return {
        "asymmetry": asymmetry(matrix),
        "most_negative": float(ratio.real.min()),
        "most_complex": float(np.abs(ratio.imag).max()),
        "growth": float(np.abs(np.sqrt(ratio).imag).max()),
        "zero_modes": int((np.abs(ratio) < ZERO).sum()),
        "lowest": float(np.sqrt(np.sort(np.abs(ratio))[rigid])),
        "stable_step": float(2.0 / np.sqrt(largest) / unit),
        "chosen_step": float(sim.time_step.choose(sim) / unit),
    }


def cases(quick):
    """(scheme, counts, influence, m, jitter) of every spectrum."""
    if quick:
        yield from itertools.product(SCHEMES, [(9, 6)], ("cubic", "constant"), (2.0, 2.2, 3.0), (0.0, 0.2))
        yield from itertools.product(SCHEMES, [(4, 4, 3)], ("cubic",), (2.2,), (0.0, 0.2))
        return
    every = ("cubic", "conical", "gaussian", "constant")
    yield from itertools.product(SCHEMES, [(14, 9)], every, (2.0, 2.2, 3.0), (0.0, 0.2))
    yield from itertools.product(SCHEMES, [(6, 5, 5)], ("cubic", "constant"), (2.0, 2.2, 3.0), (0.0, 0.2))


def free_flight(scheme, counts, influence, m, jitter, steps):
    """Kinetic energy over its start, every tenth step, of a block with tiny random velocities; ends when it is 1e6."""
    sim = block(counts, scheme, influence, m, jitter, safety=0.8)
    p = sim.particles
    p.velocity[:] = 1e-6 * WAVE_SPEED * np.random.default_rng(1).uniform(-1, 1, p.velocity.shape)
    start = sim.ledger.kinetic()
    energies = []
    for step in range(steps):
        sim.step()
        if step % 10 == 9:
            energies.append(sim.ledger.kinetic() / start)
            if not energies[-1] < 1e6:
                break
    return 10 * np.arange(1, len(energies) + 1), np.array(energies)


def write_rows(rows, path):
    """All rows as CSV."""
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)


def table(rows):
    """The worst of each scheme as a table in Markdown."""
    lines = [
        "| scheme | d | asymmetry | most negative | most complex | growth | free motions | lowest | step | chosen |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for scheme, d in itertools.product(SCHEMES, (2, 3)):
        own = [r for r in rows if r["scheme"] == scheme and r["dimension"] == d]
        if not own:
            continue
        zero = [r["zero_modes"] for r in own]
        ratio = [r["chosen_step"] / r["stable_step"] for r in own]
        step = [r["stable_step"] for r in own]
        lines.append(
            f"| {scheme} | {d} | {max(r['asymmetry'] for r in own):.1e} | {min(r['most_negative'] for r in own):.1e} | "
            f"{max(r['most_complex'] for r in own):.1e} | {max(r['growth'] for r in own):.1e} | "
            f"{min(zero)}-{max(zero)} | {min(r['lowest'] for r in own):.1e} | {min(step):.2f}-{max(step):.2f} | "
            f"{min(ratio):.3f}-{max(ratio):.3f} |"
        )
    return "\n".join(lines)


def plot_growth(plt, rows, path):
    """Growth rate of every case, one column of points for each scheme."""
    figure, axes = plt.subplots(figsize=(9.5, 4.2), layout="constrained")
    marks = {(2, 0.0): ("o", "2D, grid"), (2, 0.2): ("s", "2D, jitter 0.2"), (3, 0.0): ("^", "3D, grid"),
             (3, 0.2): ("v", "3D, jitter 0.2")}  # fmt: skip
    for (d, jitter), (mark, label) in marks.items():
        own = [r for r in rows if (r["dimension"], r["jitter"]) == (d, jitter)]
        place = [list(SCHEMES).index(r["scheme"]) + 0.12 * (2 * (d - 2) + (jitter > 0)) - 0.18 for r in own]
        axes.plot(place, [max(r["growth"], 1e-12) for r in own], mark, ms=4, mfc="none", label=label)
    axes.set_yscale("log")
    axes.set_xticks(range(len(SCHEMES)), [s.replace(", ", ",\n") for s in SCHEMES])
    axes.set_ylabel("growth rate / highest frequency (1e-12: none)")
    axes.legend(ncols=2)
    figure.savefig(path, dpi=130)


def plot_modes(plt, spectra, path):
    """Frequencies in ascending order: motions without energy lie at the left edge."""
    figure, axes = plt.subplots(figsize=(8, 4.2), layout="constrained")
    for scheme, values in spectra.items():
        frequency = np.sqrt(np.sort(np.maximum(np.abs(values), 1e-16 * np.abs(values).max())))
        axes.semilogy(np.linspace(0, 1, len(frequency)), frequency * SPACING / WAVE_SPEED, label=scheme)
    axes.set(xlabel="share of all motions", ylabel="frequency × Δ / c_p", ylim=(1e-4, 4))
    axes.set_title("cubic, m = 2.2, 2D grid")
    axes.legend()
    figure.savefig(path, dpi=130)


def plot_runs(plt, runs, path):
    """Kinetic energy of the free block."""
    figure, axes = plt.subplots(figsize=(8, 4.2), layout="constrained")
    for number, (label, (step, energy)) in enumerate(runs.items()):
        axes.loglog(step, energy, "-" if number < 10 else "--", lw=1, label=label)
    axes.set(xlabel="time step", ylabel="kinetic energy / start", ylim=(1e-1, 1e6))
    axes.legend(fontsize=8, loc="upper right")
    figure.savefig(path, dpi=130)


def main(words=None):
    """Spectra, table and plots."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    parser = option_parser(__name__, __doc__)
    parser.add_argument("--quick", action="store_true", help="small blocks, few cases: a minute")
    parser.add_argument("--scheme", choices=SCHEMES, help="only this one; what is written is left as it is")
    parser.add_argument("--folder", type=Path, default=FIGURES)
    arguments = parser.parse_args(words)
    arguments.folder.mkdir(parents=True, exist_ok=True)
    began, rows, spectra = time.perf_counter(), [], {}
    chosen = SCHEMES if arguments.scheme is None else (arguments.scheme,)
    for scheme, counts, influence, m, jitter in cases(arguments.quick):
        if scheme not in chosen:
            continue
        sim = block(counts, scheme, influence, m, jitter)
        matrix = operator(sim)
        case = {"scheme": scheme, "dimension": len(counts), "influence": influence, "m": m, "jitter": jitter}
        rows.append(case | figures(sim, matrix))
        if (len(counts), influence, m, jitter) == (2, "cubic", 2.2, 0.0):
            spectra[scheme] = eigenvalues(matrix)
    print(table(rows))
    steps = 2000 if arguments.quick else 20_000
    runs = {}
    for scheme, influence, m in RUNS:
        if scheme in chosen:
            runs[f"{scheme}, {influence}, m = {m}"] = free_flight(scheme, (14, 9), influence, m, 0.0, steps)
    for label, (step, energy) in runs.items():
        print(f"free block, {label}: {step[-1]} steps, kinetic energy x {energy[-1]:.3g}, largest x {energy.max():.3g}")
    print(f"{len(rows)} spectra in {time.perf_counter() - began:.0f} s")
    if arguments.scheme is not None:
        return
    write_rows(rows, arguments.folder / "stability.csv")
    (arguments.folder / "stability.md").write_text(table(rows) + "\n")
    plot_growth(plt, rows, arguments.folder / "stability_growth.png")
    plot_modes(plt, spectra, arguments.folder / "stability_modes.png")
    plot_runs(plt, runs, arguments.folder / "stability_runs.png")
