"""Pictures of a run: the deposit, the histories and the energy ledger."""

from pathlib import Path

import numpy as np

from periporo.io.output.results import ResultError, open_results
from periporo.io.pictures.animation import animate_run
from periporo.io.pictures.drawing import STYLE, PointPicture, extent_of, require_matplotlib

LEDGER = {  # history name -> colour; the energies of a run, J
    "kinetic_energy": "#1f77b4", "internal_energy": "#d62728", "external_work": "#2b2b2b",
    "prescribed_work": "#8c8c8c", "contact_energy": "#9467bd", "friction_dissipation": "#ff7f0e",
    "damping_dissipation": "#2ca02c", "plastic_dissipation": "#e377c2",
}
RESIDUAL = "energy_residual"
INTEGRATION = "integration_term"  # the part of the residual that the finite time step explains
_BALANCE = (*LEDGER, RESIDUAL, INTEGRATION)


def plot_deposit(results, path, step=-1, field=None):
    """Picture of the points at output `step`, coloured by `field`, over the outline they had at first.

    field: a field's name, 'name.component' or 'displacement'; by default `equivalent_shear_strain`, or the
    displacement if the file lacks it. Points have their physical size; 3D shows a front and a top view.
    """
    matplotlib = require_matplotlib()
    with matplotlib.rc_context(STYLE):
        picture = PointPicture(results, field, extent=extent_of(results, (0, step)))
        picture.show(step)
        picture.figure.savefig(path)


def plot_histories(results, path):
    """Picture of all global figures over time but the energies, a panel each.

    Raises ResultError if the file holds none.
    """
    matplotlib = require_matplotlib()
    from matplotlib.figure import Figure

    names = [name for name in results.history_names if name not in ("step", "time", *_BALANCE)]
    if not names:
        raise ResultError(f"{results.path} holds no histories to draw")
    across, label = _abscissa(results)
    with matplotlib.rc_context(STYLE | {"axes.grid": True}):
        columns = 2 if len(names) in (2, 4) else min(len(names), 3)
        rows = -(-len(names) // columns)
        figure = Figure(figsize=(3.4 * columns + 0.4, 2.3 * rows + 0.5), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for panel, name in zip(panels, names, strict=False):
            panel.plot(across, results.history(name), color="#1f77b4")
            panel.set_title(_label(name, results.unit(name)), loc="left", color="0.2")
            panel.set_xlabel(label)
        for panel in panels[len(names):]:
            panel.set_axis_off()
        figure.savefig(path)


def plot_energy(results, path):
    """Picture of the energy ledger, with its residual as a share of the largest energy below.

    Energies that are zero throughout are left out. Of the residual, the part that the finite time step explains
    (`integration_term`) is drawn over it: a black line that shows is energy that nothing explains.

    Raises ResultError if the file holds no energies.
    """
    matplotlib = require_matplotlib()
    from matplotlib.figure import Figure

    names = [name for name in LEDGER if name in results.history_names]
    if not names:
        raise ResultError(f"{results.path} holds no energies; they are the histories {', '.join(LEDGER)}")
    across, label = _abscissa(results)
    ledger = {name: results.history(name) for name in names}
    with matplotlib.rc_context(STYLE | {"axes.grid": True}):
        figure = Figure(figsize=(8.6, 5.6), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3.2, 1))
        for name, energy in ledger.items():
            if not energy.any():
                continue  # the scene has nothing that could do such work
            upper.plot(across, energy, color=LEDGER[name], label=name.replace("_", " "))
        upper.set_ylabel("energy [J]")
        upper.set_title("energy ledger", loc="left", color="0.2")
        upper.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        scale = max(np.nanmax(np.abs(energy), initial=0.0) for energy in ledger.values())
        if RESIDUAL in results.history_names and scale > 0:
            lower.plot(across, 100 * results.history(RESIDUAL) / scale, color="0.2", label="residual")
            if INTEGRATION in results.history_names:
                term = 100 * results.history(INTEGRATION) / scale
                lower.plot(across, term, color="#ff7f0e", linewidth=0.8, label="of the time step")
                lower.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        lower.set_ylabel("residual [%]\nof the largest")
        lower.set_xlabel(label)
        figure.savefig(path)


def plot_run(path, out=None, animate=False, *, field=None, step=-1):
    """Make the pictures of a result file that it has the data for; the list of files written.

    out: folder, by default that of the result file. The files are named after it: `run_deposit.png`, or with a `field`
    for example `run_stress.yy.png`, of another output than the last `run_deposit_0012.png`; of wet soil
    `run_saturation.png`, or where all pores are full `run_pore_pressure.png`; `run_histories.png`, `run_energy.png`,
    and with `animate` `run_movie.mp4`, or `.gif` without ffmpeg.
    """
    path = Path(path)
    folder = Path(out) if out is not None else path.parent
    with open_results(path) as results:
        number = results.output(step)  # fails before anything is written
        folder.mkdir(parents=True, exist_ok=True)
        ending = "" if step == -1 else f"_{number:04d}"
        files = []
        for shown in (field,) if field is not None else (None, *_of_water(results, number)):
            files.append(folder / f"{path.stem}_{'deposit' if shown is None else shown}{ending}.png")
            plot_deposit(results, files[-1], step, shown)
        names = set(results.history_names)
        if names - {"step", "time", *_BALANCE}:
            files.append(folder / f"{path.stem}_histories.png")
            plot_histories(results, files[-1])
        if names & set(LEDGER):
            files.append(folder / f"{path.stem}_energy.png")
            plot_energy(results, files[-1])
        if animate:
            files.append(animate_run(results, folder / f"{path.stem}_movie", field))
    return files


def _of_water(results, number):
    """The field that shows the water in the pores best, if the file holds one."""
    if "saturation" in results.fields and results.field("saturation", number).min(initial=1.0) < 1.0:
        return ("saturation",)
    wet = "pore_pressure" in results.fields and results.field("pore_pressure", number).any()
    return ("pore_pressure",) if wet else ()


def _abscissa(results):
    """What the histories are drawn over, and its label."""
    name = "time" if "time" in results.history_names else "step"
    return results.history(name), "t [s]" if name == "time" else "step"


def _label(name, unit):
    return name.replace("_", " ") + (f" [{unit}]" if unit not in ("", "-", "1") else "")


def add_arguments(parser):
    """Arguments of `periporo plot`."""
    parser.add_argument("path", type=Path, help="result file")
    parser.add_argument("--out", type=Path, help="folder for the pictures (default: that of the result file)")
    parser.add_argument("--field", help="field to colour by: name, name.component or displacement")
    parser.add_argument("--step", type=int, default=-1, help="output to draw, -1 is the last (default)")
    parser.add_argument("--animate", action="store_true", help="make a movie as well")


def run(arguments):
    """Run `periporo plot`; the exit status."""
    for file in plot_run(arguments.path, arguments.out, arguments.animate,
                         field=arguments.field, step=arguments.step):
        print(file)
    return 0
