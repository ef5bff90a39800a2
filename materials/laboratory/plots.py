"""Plots of a driven point: stress-strain, stress path with yield surface, volume change, shear, pore pressure."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from periporo.core.points.material import Material
from periporo.materials.laboratory.columns import Columns
from periporo.materials.laboratory.paths import STRESS_COLUMNS

_SCALES = ((1e9, "GPa"), (1e6, "MPa"), (1e3, "kPa"), (1.0, "Pa"))
_PATH, _START, _END, _MEASURED = "C0", "0.6", "C3", "0.2"
_LABELS = {
    "axial_strain": "axial strain (%)", "shear_strain": "equivalent shear strain (%)", "gamma": "shear angle (%)",
    "volumetric_strain": "volumetric strain (%)", "void_ratio": "void ratio",
}  # fmt: skip
_STRESSES = {
    "p": "mean effective stress p", "q": "q", "tau": "tau", "axial_stress": "axial effective stress",
    "pore_pressure": "pore pressure",
}  # fmt: skip


def draw_plots(
    material: Material, columns: Columns, folder: Path, stem: str, measured: list[Columns] | None = None
) -> list[Path]:
    """Draw the columns that `drive` returned into `folder`; the names of the PNG files.

    Compression is positive in the plots, as in soil mechanics. Pore pressure is drawn if there is a column
    `pore_pressure`, tau against gamma if there is shear in the x-y plane, the yield surface if the material has a
    method `yield_surface(stress_row, state_row)`. Curves that were `measured` go over them as dots.
    """
    strain = _strain_of(columns)
    panels = {
        "stress_strain": [[(strain, "q"), (strain, "p")]],
        "stress_path": [[("p", "q")]],
        "volume": [[(strain, _volume(columns))], [("p", _volume(columns))]],
    }
    if np.abs(columns["tau"]).max() > 1e-9 * np.abs(columns["q"]).max():
        panels["shear"] = [[("gamma", "tau")], [("axial_stress", "tau")]]
    if "pore_pressure" in columns:
        panels["pore_pressure"] = [[(strain, "pore_pressure")]]
    files = []
    for name, places in panels.items():
        figure = Figure(figsize=(5.5 * len(places), 4.2), layout="constrained")
        for axes, curves in zip(figure.subplots(1, len(places), squeeze=False)[0], places, strict=True):
            if name == "stress_path" and hasattr(material, "yield_surface"):
                _yield_surfaces(axes, material, columns)
            _curves(axes, curves, columns, measured or [])
            if name == "volume":
                _turn(axes, curves[0], columns)
        files.append(folder / f"{stem}_{name}.png")
        figure.savefig(files[-1], dpi=150)
    return files


def _strain_of(columns: Columns) -> str:
    """The strain that the test is about."""
    axial, gamma, shear, volume = (
        np.abs(columns[name]).max() for name in ("axial_strain", "gamma", "shear_strain", "volumetric_strain")
    )
    if gamma > axial:
        return "gamma"
    return "axial_strain" if shear > 1e-6 * volume else "volumetric_strain"


def _volume(columns: Columns) -> str:
    return "void_ratio" if "void_ratio" in columns else "volumetric_strain"


def _curves(axes: Axes, curves: list[tuple[str, str]], columns: Columns, measured: list[Columns]) -> None:
    """Draw y against x for each of the pairs of names, measured ones as dots."""
    names = sorted({name for pair in curves for name in pair if name in _STRESSES})
    factor, unit = _unit(np.concatenate([columns[name] for name in names]) if names else np.zeros(1))

    def scaled(name: str, table: Columns) -> np.ndarray:
        if name in _STRESSES:
            return table[name] / factor
        return table[name] if name == "void_ratio" else 100.0 * table[name]

    def label(name: str) -> str:
        return f"{_STRESSES[name]} ({unit})" if name in _STRESSES else _LABELS[name]

    for number, (x, y) in enumerate(curves):
        color, line = (_PATH, _END)[number], ("-", "--")[number]
        axes.plot(scaled(x, columns), scaled(y, columns), color=color, linestyle=line, label=_STRESSES.get(y, y))
        for table in measured:
            if x in table and y in table:
                name = f"{_STRESSES.get(y, y)}, measured"
                axes.plot(scaled(x, table), scaled(y, table), "o", color=_MEASURED, markersize=3, label=name)
    if len(axes.get_lines()) > 1:
        axes.legend(frameon=False)
    axes.set_xlabel(label(curves[0][0]))
    axes.set_ylabel(label(curves[0][1]) if len(curves) == 1 else f"stress ({unit})")
    axes.grid(True, color="0.9", linewidth=0.6)


def _turn(axes: Axes, curve: tuple[str, str], columns: Columns) -> None:
    """Compression downwards; e-log p where the pressure spans decades."""
    x, y = curve
    if y == "volumetric_strain":
        axes.invert_yaxis()
    if x == "p" and np.all(columns["p"] > 0) and columns["p"].max() > 5 * columns["p"].min():
        axes.set_xscale("log")


def _unit(values: np.ndarray) -> tuple[float, str]:
    """Divisor and name of the unit in which the largest value is at least 1."""
    largest = np.max(np.abs(values), initial=0.0)
    return next((scale for scale in _SCALES if largest >= scale[0]), _SCALES[-1])


def _yield_surfaces(axes: Axes, material: Material, columns: Columns) -> None:
    """The yield surface at the start and at the end, in the unit of the stress path."""
    stress = np.stack([columns[name] for name in STRESS_COLUMNS], axis=1)
    factor, _ = _unit(np.concatenate([columns["p"], columns["q"]]))
    for row, color, label in ((0, _START, "yield surface at the start"), (-1, _END, "at the end")):
        p, q = getattr(material, "yield_surface")(stress[row], _state_row(material, columns, row))  # noqa: B009
        axes.plot(-p / factor, q / factor, color=color, linewidth=1.0, label=label)


def _state_row(material: Material, columns: Columns, row: int) -> np.ndarray:
    names = []
    for field in material.state_fields:
        names += (
            [name for name in columns if name == field.name]
            if field.kind == "scalar"
            else [f"{field.name}_{component.removeprefix('stress_')}" for component in STRESS_COLUMNS]
        )
    return np.array([columns[name][row] for name in names])
