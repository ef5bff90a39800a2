"""The pictures of the study: bodies coloured by a field, and curves (Menon & Song 2022, figures 16-38)."""

from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np

from periporo.io.output.results import open_results
from periporo.io.pictures.drawing import STYLE

from .cases import HALF_WIDTH, RESULT, Case
from .laws import LAJEUNESSE_RUN_OUT, lube_height, lube_run_out
from .table import measure

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.collections import EllipseCollection  # noqa: E402

HEIGHTS = (0.05, 0.1, 0.2)  # m
TIMES = {0.05: (0.11, 0.17, 0.25), 0.1: (0.17, 0.27, 0.4), 0.2: (0.1, 0.3, 0.5)}  # s, of figures 17-22
SUCTIONS = (None, 100.0, 250.0, 500.0, 25e3, 50e3)  # Pa
FRICTIONS = (0.0, 0.25, 0.5)
SET_FRICTION = {"paper": 0.25, "granular": 0.5}
MARK = (0.6 * HALF_WIDTH, 0.25)  # m, heights: the marked point, on the first band of shear
COLOURS = ("#1b5e8c", "#d1761f", "#3d8b4f", "#8c3f76", "#6b6b6b", "#b03a3a")


def draw_all(done: dict[Case, Path], spacing: float, folder: Path) -> None:
    """Draw every picture from the runs at `spacing` m that are there."""
    book = _Book(done, spacing)
    with plt.rc_context(STYLE):
        book.initial_stress(folder / "collapse_initial_stress.png")
        for chosen in ("paper", "granular"):
            book.in_time(chosen, "shear", folder / f"collapse_strain_{chosen}.png")
            book.in_time(chosen, "stress", folder / f"collapse_stress_{chosen}.png")
        book.base_forces(folder / "collapse_base.png")
        book.aspect_ratio(folder / "collapse_aspect.png")
        book.final_by("suction", SUCTIONS, folder / "collapse_suction.png")
        book.curves_by("suction", SUCTIONS, folder / "collapse_suction_curves.png")
        book.final_by("friction", FRICTIONS, folder / "collapse_friction.png")
        book.curves_by("friction", FRICTIONS, folder / "collapse_friction_curves.png")


class _Book:
    """The finished runs, and what is drawn of them."""

    def __init__(self, done, spacing):
        self.done = done
        self.spacing = spacing

    def folder(self, chosen, height, **key) -> Path | None:
        """Folder of a run, by default one without variant, or None."""
        key = {"friction": SET_FRICTION[chosen], "suction": None, "variant": None, "spacing": self.spacing} | key
        wanted = {"set": chosen, "height": height} | key
        return next((f for c, f in self.done.items() if all(getattr(c, k) == v for k, v in wanted.items())), None)

    def initial_stress(self, path):
        """Vertical stress after settling, with the marked points (figure 16)."""
        figure, axes = plt.subplots(1, 3, figsize=(8, 4.2), layout="constrained", sharey=True)
        for ax, height in zip(axes, HEIGHTS, strict=True):
            shown = _body(ax, self.folder("paper", height), 0.0, "stress", (-3.5, 0.0))
            ax.plot(MARK[0], MARK[1] * height, "o", mfc="none", mec="w", ms=7, mew=1.5)
            ax.set(title=f"H = {height:g} m", xlim=(-0.06, 0.06), ylim=(0, 0.21))
        _colour_bar(figure, shown, axes, "vertical stress, kPa")
        _save(figure, path)

    def in_time(self, chosen, field, path):
        """A field at three times of three columns (figures 17-22)."""
        figure, axes = plt.subplots(3, 3, figsize=(13, 6.5), layout="constrained")
        limits, label = {"shear": ((0.0, 3.0), "equivalent shear strain"),
                         "stress": ((-1.5, 0.0), "vertical stress, kPa")}[field]  # fmt: skip
        for row, height in zip(axes, HEIGHTS, strict=True):
            folder = self.folder(chosen, height)
            for ax, time in zip(row, TIMES[height], strict=True):
                shown = _body(ax, folder, time, field, limits)
                ax.set_title(f"H = {height:g} m, t = {time:g} s")
            _frame(row, folder)
            _colour_bar(figure, shown, row[-1], label)
        _save(figure, path)

    def base_forces(self, path):
        """Force of the floor along the base of the deposit (figures 23 and 24)."""
        figure, axes = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
        for height, colour in zip(HEIGHTS, COLOURS, strict=False):
            folder = self.folder("paper", height)
            if folder is None:
                continue
            with open_results(folder / RESULT) as r:
                x = r.positions()[:, 0]
                touching = r.field("contact_force")[:, 1] > 0.0
                for ax, name, axis in zip(axes, ("contact_force", "friction_force"), (1, 0), strict=True):
                    force = np.abs(r.field(name)[touching, axis])
                    order = np.argsort(x[touching])
                    place = x[touching][order]
                    ax.plot(place, force[order], ".", ms=3, color=colour, alpha=0.4)
                    ax.plot(*_averages(place, force[order], 4 * self.spacing), color=colour, label=f"H = {height:g} m")
        for ax, label in zip(axes, ("normal force, N/m per point", "friction, N/m per point"), strict=True):
            ax.set(xlabel="x, m", ylabel=label)
        if axes[0].get_lines():
            axes[0].legend()
        _save(figure, path)

    def aspect_ratio(self, path):
        """Run-out and height over aspect ratio with the laws of experiments (figures 25 and 26)."""
        figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
        a = np.linspace(0.5, 5, 200)
        axes[0].plot(a, lube_run_out(a), "k-", lw=1, label="Lube et al. 2005")
        axes[0].plot(*zip(*LAJEUNESSE_RUN_OUT.items(), strict=True), "ks", mfc="none", label="Lajeunesse et al. 2005")
        axes[1].plot(a, lube_height(a), "k-", lw=1, label="Lube et al. 2005")
        shown = [*((chosen, None) for chosen in SET_FRICTION), ("granular", "repose 30")]
        for colour, (chosen, variant) in zip(COLOURS, shown, strict=False):
            for spacing, marker in ((5e-3, "^"), (2.5e-3, "o"), (1.25e-3, "D")):
                folders = [self.folder(chosen, height, spacing=spacing, variant=variant) for height in HEIGHTS]
                runs = [(h / HALF_WIDTH, measure(self._case_of(f), f))
                        for h, f in zip(HEIGHTS, folders, strict=True) if f is not None]  # fmt: skip
                label = f"{variant or chosen}, {1e3 * spacing:g} mm"
                style = {"color": colour, "marker": marker, "ls": "", "label": label}
                if runs:
                    axes[0].plot([x for x, _ in runs], [m.run_out for _, m in runs], **style)
                    axes[1].plot([x for x, _ in runs], [m.height for _, m in runs], **style)
        axes[0].set(xlabel="height / half-width", ylabel="run-out / half-width", ylim=(0, None))
        axes[1].set(xlabel="height / half-width", ylabel="height of the deposit / half-width", ylim=(0, None))
        axes[1].legend(*axes[0].get_legend_handles_labels(), loc="lower right")
        _save(figure, path)

    def final_by(self, name, values, path):
        """Shear strain in the final deposits by suction or friction (figures 27-29 and 33-35)."""
        figure, axes = plt.subplots(3, len(values), figsize=(3.6 * len(values), 6), layout="constrained")
        for row, height in zip(axes, HEIGHTS, strict=True):
            folders = [self.folder("paper", height, **{name: value}) for value in values]
            for ax, folder, value in zip(row, folders, values, strict=True):
                shown = _body(ax, folder, None, "shear", (0.0, 3.0))
                ax.set_title(f"H = {height:g} m, {_named(name, value)}")
            _frame(row, *folders)
            _colour_bar(figure, shown, row[-1], "equivalent shear strain")
        _save(figure, path)

    def curves_by(self, name, values, path):
        """Run-out, height, and shear strain of the marked points (figures 30-32 and 36-38)."""
        figure, axes = plt.subplots(2, 3, figsize=(13, 6.5), layout="constrained")
        axes[0, 2].axis("off")
        for row, height in enumerate(HEIGHTS):
            found = {v: self.folder("paper", height, **{name: v}) for v in values}
            found = {v: f for v, f in found.items() if f is not None}
            figures = [measure(self._case_of(f), f) for f in found.values()]
            places = [values.index(v) for v in found]
            style = {"marker": "o", "color": COLOURS[row], "label": f"H = {height:g} m"}
            axes[0, 0].plot(places, [m.run_out for m in figures], **style)
            axes[0, 1].plot(places, [m.height for m in figures], **style)
            for value, folder in found.items():
                time, strain = _history(folder, height)
                axes[1, row].plot(time, strain, color=COLOURS[values.index(value)], label=_named(name, value))
            axes[1, row].set(xlabel="time, s", ylabel="equivalent shear strain", xlim=(0, 0.6),
                             title=f"marked point, H = {height:g} m")  # fmt: skip
        for ax, label in zip(axes[0], ("run-out / half-width", "height / half-width"), strict=False):
            short = [_named(name, v).split("=")[-1].removesuffix(" kPa") for v in values]
            ax.set(xticks=range(len(values)), xticklabels=short, ylabel=label)
            ax.set_xlabel({"suction": "suction, kPa", "friction": "friction of the floor"}[name])
        handles = [*axes[0, 0].get_lines(), *axes[1, 1].get_lines()]
        axes[0, 2].legend(handles=handles, loc="center")
        _save(figure, path)

    def _case_of(self, folder):
        return next(case for case, other in self.done.items() if other == folder)


_VALUES: dict[str, Callable] = {
    "shear": lambda r, step: r.field("equivalent_shear_strain", step),
    "stress": lambda r, step: 1e-3 * r.field("stress", step)[:, 1],
}


def _body(ax, folder, time, field, limits):
    """Draw every point as a disc at a time (the end if None, or if that comes earlier); what the colours belong to."""
    ax.set(aspect="equal", yticks=[], xticks=[])
    ax.spines[:].set_visible(False)
    if folder is None:
        ax.text(0.5, 0.5, "not run", transform=ax.transAxes, ha="center", color="0.5")
        return None
    with open_results(folder / RESULT) as r:
        step = -1 if time is None or time > r.times[-1] else r.output(time=max(time, r.times[0]))
        x, values = r.positions(step), _VALUES[field](r, step)
        size = float(r.configuration["spacing"])
    sizes = np.full(len(x), 1.15 * size)
    discs = EllipseCollection(
        sizes, sizes, np.zeros(len(x)), units="xy", offsets=x[:, :2], offset_transform=ax.transData, array=values,
        cmap="viridis" if field == "shear" else "magma", clim=limits, lw=0,
    )  # fmt: skip
    discs.set_rasterized(True)
    ax.axhline(0.0, color="0.4", lw=1)
    return ax.add_collection(discs)


def _frame(row, *folders):
    """The same limits on the axes of a row, from the outermost points of its runs."""
    front, top = HALF_WIDTH, HALF_WIDTH
    for folder in folders:
        if folder is not None:
            with open_results(folder / RESULT) as r:
                # one point in two hundred may fly ahead of the picture
                front = max(front, float(np.quantile(np.abs(r.positions()[:, 0]), 0.995)))
                top = max(top, float(r.positions(1)[:, 1].max() if len(folders) == 1 else r.positions()[:, 1].max()))
    for ax in row:
        ax.set(xlim=(-1.05 * front, 1.05 * front), ylim=(-0.003, 1.05 * top))


def _history(folder, height):
    """Time and shear strain of the point nearest to the marked place at the start."""
    with open_results(folder / RESULT) as r:
        away = r.positions(0)[:, :2] - np.array([MARK[0], MARK[1] * height])
        point = r.ids(0)[int(np.argmin((away**2).sum(axis=1)))]
        strain = [r.field("equivalent_shear_strain", k)[np.searchsorted(r.ids(k), point)] for k in range(len(r))]
        return r.times, strain


def _averages(x, values, width):
    """Means of values over bins of x."""
    bins = np.floor(x / width)
    kept = np.unique(bins)
    return [(b + 0.5) * width for b in kept], [values[bins == b].mean() for b in kept]


def _named(name, value):
    if name == "friction":
        return f"$\\mu$ = {value:g}"
    return "dry" if value is None else f"s = {1e-3 * value:g} kPa"


def _colour_bar(figure, shown, ax, label):
    if shown is not None:
        figure.colorbar(shown, ax=ax, label=label, shrink=0.8)


def _save(figure, path):
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)
