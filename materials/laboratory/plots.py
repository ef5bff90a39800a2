"""Plots of a driven point: stress-strain, stress path with yield surface, volume change, pore pressure."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from periporo.core.numerics.tensors import deviator_norm, equivalent_shear, mean
from periporo.core.points.material import Material
from periporo.materials.laboratory.paths import STRAIN_COLUMNS, STRESS_COLUMNS

_SCALES = ((1e9, "GPa"), (1e6, "MPa"), (1e3, "kPa"), (1.0, "Pa"))
_PATH, _START, _END = "C0", "0.6", "C3"


def draw_plots(material: Material, columns: dict[str, np.ndarray], folder: Path, stem: str) -> list[Path]:
    """Draw the columns that `drive` returned into `folder`; the names of the PNG files.

    Compression is positive in the plots, as in soil mechanics. Pore pressure is drawn if there is a column
    `pore_pressure`, the yield surface if the material has a method `yield_surface(stress_row, state_row)`.
    """
    stress = np.stack([columns[name] for name in STRESS_COLUMNS], axis=1)
    strain = np.stack([columns[name] for name in STRAIN_COLUMNS], axis=1)
    pressure, q = -mean(stress), equivalent_shear(stress)
    shear = 100 * np.sqrt(2 / 3) * deviator_norm(strain)
    volumetric = -300 * mean(strain)
    plots = {
        "stress_strain": lambda axes: _stress_strain(axes[0], shear, volumetric, pressure, q),
        "stress_path": lambda axes: _stress_path(axes[0], material, columns, stress),
        "volume": lambda axes: _volume(axes, shear, volumetric, pressure),
    }
    if "pore_pressure" in columns:
        plots["pore_pressure"] = lambda axes: _pore_pressure(
            axes[0], shear, volumetric, columns["pore_pressure"]
        )
    files = []
    for name, draw in plots.items():
        count = 2 if name == "volume" else 1
        figure = Figure(figsize=(5.5 * count, 4.2), layout="constrained")
        draw(figure.subplots(1, count, squeeze=False)[0])
        files.append(folder / f"{stem}_{name}.png")
        figure.savefig(files[-1], dpi=150)
    return files


def _unit(values: np.ndarray) -> tuple[float, str]:
    """Divisor and name of the unit in which the largest value is at least 1."""
    largest = np.max(np.abs(values), initial=0.0)
    return next((scale for scale in _SCALES if largest >= scale[0]), _SCALES[-1])


def _label(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(True, color="0.9", linewidth=0.6)


def _strain_axis(shear: np.ndarray, volumetric: np.ndarray) -> tuple[np.ndarray, str]:
    """The strain (%) that the test is about: the shear strain, or the volumetric one without shear."""
    if shear.max() > 1e-6 * np.abs(volumetric).max():
        return shear, "equivalent shear strain (%)"
    return volumetric, "volumetric strain, compression (%)"


def _stress_strain(axes: Axes, shear, volumetric, pressure, q) -> None:
    strain, label = _strain_axis(shear, volumetric)
    factor, unit = _unit(np.append(q, pressure))
    axes.plot(strain, q / factor, color=_PATH, label="q")
    axes.plot(strain, pressure / factor, color=_END, linestyle="--", label="mean stress, -p")
    axes.legend(frameon=False)
    _label(axes, label, f"stress ({unit})")


def _stress_path(axes: Axes, material: Material, columns: dict[str, np.ndarray], stress: np.ndarray) -> None:
    pressure, q = -mean(stress), equivalent_shear(stress)
    factor, unit = _unit(np.append(q, pressure))
    if hasattr(material, "yield_surface"):
        for row, color, label in ((0, _START, "yield surface at the start"), (-1, _END, "at the end")):
            p_surface, q_surface = material.yield_surface(stress[row], _state_row(material, columns, row))
            axes.plot(-p_surface / factor, q_surface / factor, color=color, linewidth=1.0, label=label)
    axes.plot(pressure / factor, q / factor, color=_PATH, label="path")
    axes.plot(pressure[0] / factor, q[0] / factor, "o", color=_PATH, markersize=4)
    axes.legend(frameon=False)
    _label(axes, f"mean stress, -p ({unit})", f"q ({unit})")


def _state_row(material: Material, columns: dict[str, np.ndarray], row: int) -> np.ndarray:
    names = []
    for field in material.state_fields:
        names += (
            [name for name in columns if name == field.name]
            if field.kind == "scalar"
            else [f"{field.name}_{component.removeprefix('stress_')}" for component in STRESS_COLUMNS]
        )
    return np.array([columns[name][row] for name in names])


def _volume(axes: np.ndarray, shear, volumetric, pressure) -> None:
    axes[0].plot(shear, volumetric, color=_PATH)
    _label(axes[0], "equivalent shear strain (%)", "volumetric strain, compression (%)")
    factor, unit = _unit(pressure)
    axes[1].plot(pressure / factor, volumetric, color=_PATH)
    if np.all(pressure > 0) and pressure.max() > 5 * pressure.min():
        axes[1].set_xscale("log")
    _label(axes[1], f"mean stress, -p ({unit})", "volumetric strain, compression (%)")
    for panel in axes:
        panel.invert_yaxis()


def _pore_pressure(axes: Axes, shear, volumetric, pore_pressure) -> None:
    strain, label = _strain_axis(shear, volumetric)
    factor, unit = _unit(pore_pressure)
    axes.plot(strain, pore_pressure / factor, color=_PATH)
    _label(axes, label, f"pore pressure ({unit})")
