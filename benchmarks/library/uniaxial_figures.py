"""The pictures of the benchmark uniaxial_compression (Menon & Song 2022, figures 6 to 13)."""

from pathlib import Path

import matplotlib

from periporo.io.pictures.drawing import STYLE

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

SCHEMES = ("standard", "bond_projected", "point_state", "point_state, sharpened", "sub_horizon")
PUBLISHED = "sub_horizon_published"
COLOURS = {
    "standard": "0.65", "bond_projected": "#1b5e8c", "point_state": "#3d8b4f", "point_state, sharpened": "#7a4fa0",
    "sub_horizon": "#d1761f", PUBLISHED: "#b03a3a",
}  # fmt: skip
PUSH = 0.5e-3  # m, of figures 6 to 11
KPA = 1e-3


def draw(done: dict, folder: Path) -> None:
    """Draw every picture from the cases that are there: a dictionary of case to what was measured of it."""
    size = max(c.counts for c in done if c.push == PUSH)
    with plt.rc_context(STYLE):
        for loading in ("static", "dynamic"):
            chosen = {c: m for c, m in done.items() if c.loading == loading and c.counts == size and _is_plain(c)}
            if chosen:
                _blocks(chosen, folder / f"uniaxial_{loading}.png")
                _axes(chosen, folder / f"uniaxial_{loading}_axis.png")
        finer = {c: m for c, m in done.items() if c.push > PUSH}
        if finer:
            _convergence(finer, folder / "uniaxial_convergence.png")
        published = {c: m for c, m in done.items() if c.scheme == PUBLISHED}
        if published:
            _published(published, folder / "uniaxial_published.png")


def _is_plain(case):
    """Whether a case is one of figures 6 to 11, of a size to be chosen."""
    return case.scheme in SCHEMES and case.influence == "constant" and case.push == PUSH and not case.step


def _nominal(case):
    """The horizon as the publication counts it."""
    return f"m = {int(case.horizon)}"


def _block(ax, case, measured):
    """Axial stress of all points, between zero and twice the exact one."""
    size = [n * case.spacing for n in case.counts]
    field = measured.stress.T * KPA
    limits = {"vmin": 2.0 * case.stress * KPA, "vmax": 0.0}
    image = ax.imshow(
        field, origin="lower", extent=(0, size[0], 0, size[1]), cmap="viridis", interpolation="none", **limits
    )
    ax.set(xticks=[0, size[0]], yticks=[0, size[1]])
    ax.set_xticklabels(["0", f"{size[0]:.2g} m"])
    ax.set_yticklabels(["0", f"{size[1]:.2g} m"])
    return image


def _blocks(chosen, path):
    """Figures 6 and 7, or 9 and 10: schemes by rows, horizons by columns."""
    schemes, horizons = [s for s in SCHEMES if any(c.scheme == s for c in chosen)], sorted({c.horizon for c in chosen})
    rows, columns = len(schemes), len(horizons)
    figure, grid = plt.subplots(
        rows, columns, figsize=(4.6 * columns + 1, 1.7 * rows), layout="constrained", squeeze=False
    )
    for case, measured in chosen.items():
        ax = grid[schemes.index(case.scheme), horizons.index(case.horizon)]
        image = _block(ax, case, measured)
        ax.set_title(f"{case.scheme}, {_nominal(case)}" + (" (pressed, no equilibrium)" if measured.failed else ""))
    figure.colorbar(image, ax=grid, label="axial stress, kPa", extend="both")
    _save(figure, path)


def _axes(chosen, path):
    """Figure 8 or 11: axial stress along the axis."""
    horizons = sorted({c.horizon for c in chosen})
    figure, axes = plt.subplots(1, len(horizons), figsize=(5 * len(horizons), 3.6), layout="constrained", squeeze=False)
    for case, measured in chosen.items():
        ax = axes[0, horizons.index(case.horizon)]
        ax.plot(measured.x, measured.axial * KPA, color=COLOURS[case.scheme], lw=1.2, label=case.scheme)
        ax.axhline(case.stress * KPA, color="k", lw=0.6, ls=":")
        ax.set(title=_nominal(case), xlabel="distance from the held end, m", ylabel="axial stress, kPa")
        ax.legend()
    _save(figure, path)


def _convergence(chosen, path):
    """Figures 12 and 13: the block and its axis with three numbers of points."""
    figure = plt.figure(figsize=(9.5, 5.6), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1, 1.1))
    grid = left.subplots(len(chosen), 1, squeeze=False)[:, 0]
    ax = right.subplots()
    for panel, (case, measured), colour in zip(grid, chosen.items(), ("#1b5e8c", "#d1761f", "#3d8b4f"), strict=False):
        points = f"{case.counts[0] * case.counts[1]} points"
        image = _block(panel, case, measured)
        panel.set_title(points)
        ax.plot(measured.x, measured.axial * KPA, color=colour, lw=1.2, label=points)
        ax.axhline(case.stress * KPA, color="k", lw=0.6, ls=":")
    left.colorbar(image, ax=grid, label="axial stress, kPa", extend="both", location="bottom", shrink=0.8)
    ax.set(xlabel="distance from the held end, m", ylabel="axial stress, kPa")
    ax.legend()
    _save(figure, path)


def _published(chosen, path):
    """The published force: its stress along the axis, and how its kinetic energy grows."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    for case, m in chosen.items():
        style = "-" if int(case.horizon) == 2 else ":"
        if m.growth is None:
            left.plot(
                m.x, m.axial * KPA, style, lw=1.2, color=COLOURS[PUBLISHED], label=f"{case.loading}, {_nominal(case)}"
            )
            left.axhline(case.stress * KPA, color="k", lw=0.6, ls=":")
        else:
            time, kinetic, bound = m.growth
            right.semilogy(
                1e3 * time[1:], kinetic[1:] / bound, style, lw=1.2, color=COLOURS[PUBLISHED], label=_nominal(case)
            )
            right.axhline(1.0, color="k", lw=0.6, ls=":")
    left.set(xlabel="distance from the held end, m", ylabel="axial stress, kPa")
    right.set(xlabel="time, ms", ylabel="kinetic energy over all that there can be")
    for ax in (left, right):
        if ax.get_lines():
            ax.legend()
    _save(figure, path)


def _save(figure, path):
    figure.savefig(path)
    plt.close(figure)
    print(path)
