"""What an obstacle bears along its surface, as a table and a picture."""

import csv
from pathlib import Path

import numpy as np

from periporo.io.output.results import ResultError, open_results
from periporo.io.pictures.drawing import STYLE, require_matplotlib


def surface_run(path, name, out=None, *, step=-1, axis=None):
    """Write the load on the obstacle `name` at output `step`, see `Results.surface`: `run_NAME.csv` and `run_NAME.png`.

    out: folder, by default that of the result file. The list of both files.
    """
    path = Path(path)
    folder = Path(out) if out is not None else path.parent
    with open_results(path) as results:
        number = results.output(step)
        load, time = results.surface(name, number, axis=axis), float(results.times[number])
    columns = {"along [m]": load.along} | {f"{a} [m]": load.place[:, k] for k, a in enumerate("xyz")}
    if load.normal is None:
        drawn = {f"force {a}": load.force[:, k] for k, a in enumerate("xyz") if load.force[:, k].any()}
        columns |= {f"force_{a} [N/m]": load.force[:, k] for k, a in enumerate("xyz")}
        unit = "N/m"
    else:
        drawn = {"pressure": load.pressure, "shear stress": load.shear}
        columns |= {"pressure [Pa]": load.pressure, "shear [Pa]": load.shear}
        unit = "Pa"
    if not drawn or not any(values.any() for values in drawn.values()):
        raise ResultError(f"{path}: nothing touches {name!r} at t = {time:.4g} s")
    folder.mkdir(parents=True, exist_ok=True)
    table, picture = (folder / f"{path.stem}_{name}{ending}" for ending in (".csv", ".png"))
    with open(table, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(np.column_stack(list(columns.values())).tolist())
    _draw(picture, load, drawn, unit, f"{name}, t = {time:.4g} s", f"along {axis or 'the surface'} [m]")
    return [table, picture]


def _draw(picture, load, drawn, unit, title, across):
    matplotlib = require_matplotlib()
    from matplotlib.figure import Figure

    loaded = np.flatnonzero(np.any([values != 0.0 for values in drawn.values()], axis=0))
    shown = slice(max(loaded[0] - 1, 0), loaded[-1] + 2)
    with matplotlib.rc_context(STYLE | {"axes.grid": True}):
        figure = Figure(figsize=(7.0, 3.6), layout="constrained")
        axes = figure.subplots()
        for label, values in drawn.items():
            axes.plot(load.along[shown], values[shown], label=label)
        axes.set(xlabel=across, ylabel=f"[{unit}]")
        axes.set_title(title, loc="left", color="0.2")
        axes.legend()
        figure.savefig(picture)


def add_arguments(parser):
    """Arguments of `periporo surface`."""
    parser.add_argument("path", type=Path, help="result file, with the field force_on_NAME")
    parser.add_argument("name", help="name of the obstacle")
    parser.add_argument("--axis", choices="xyz", help="force per length along it (default in 2D: along the outline)")
    parser.add_argument("--step", type=int, default=-1, help="output, -1 is the last (default)")
    parser.add_argument("--out", type=Path, help="folder for both files (default: that of the result file)")


def run(arguments):
    """Run `periporo surface`; the exit status."""
    for file in surface_run(arguments.path, arguments.name, arguments.out, step=arguments.step, axis=arguments.axis):
        print(file)
    return 0
