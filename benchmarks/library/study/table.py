"""What is measured of a finished column, and the table of it."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from periporo.io.output.results import open_results

from .cases import HALF_WIDTH, RESULT, Case

HEAD = (
    "| case | run-out | height | front stops, s | ends, s | mm/s | steps | rebuilds | ledger, % | flying |"
)
_TURNED_OVER = ("kinetic_energy", "internal_energy", "external_work", "contact_energy", "friction_dissipation")


@dataclass(frozen=True)
class Measured:
    """Figures of a column at the end of its run; lengths over the half-width."""

    run_out: float  # of the 99 % of the connected deposit nearest to the middle, beyond the half-width
    height: float  # of the connected deposit
    front_stops: float  # s, when the outermost point has gone 99 % of its way
    ends: float  # s
    speed: float  # m/s, of the fastest point at the end
    kinetic: float  # last kinetic energy over its peak
    steps: int
    rebuilds: int
    ledger: float  # energy that the integrator made or lost since the release over the energy turned over
    points: int
    lost: int  # points that are no longer there
    flying: int  # points without bonds

    @property
    def at_rest(self) -> bool:
        """Whether motion has died out, by energy or in absolute terms: as after a fall of a micrometre."""
        return self.kinetic <= 1.01e-6 or self.speed < 5e-3


def measure(case: Case, folder: Path) -> Measured:
    """The figures of the finished run in a folder."""
    with open_results(folder / RESULT) as r:
        position, connected = r.positions(), r.field("integrity") > 0.0
        history = {name: r.history(name) for name in (*_TURNED_OVER, "time", "front", "energy_residual", "max_speed")}
        points, steps = r.point_counts, int(r.history("step")[-1])
        rebuilds = int(r.attributes["rebuilds"])
    half = 0.5 * case.spacing
    front = np.quantile(np.abs(position[connected, 0]), 0.99, method="inverted_cdf") + half
    way = history["front"] - HALF_WIDTH
    release = int(np.flatnonzero(history["time"] == 0.0)[-1])
    gained = abs(history["energy_residual"][-1] - history["energy_residual"][release])
    kinetic = history["kinetic_energy"][release:]
    return Measured(
        run_out=front / HALF_WIDTH - 1.0,
        height=(position[connected, 1].max() + half) / HALF_WIDTH,
        front_stops=float(history["time"][int(np.argmax(way >= 0.99 * way[-1]))]),
        ends=float(history["time"][-1]),
        speed=float(history["max_speed"][-1]),
        kinetic=float(kinetic[-1] / kinetic.max()),
        steps=steps,
        rebuilds=rebuilds,
        ledger=float(gained / sum(abs(history[name][-1]) for name in _TURNED_OVER)),
        points=int(points[0]),
        lost=int(points[0] - points[-1]),
        flying=int((~connected).sum()),
    )


def lines(done: dict[Case, Path]) -> list[str]:
    """The table of the finished runs, one row each."""
    rows = [HEAD, "|---" * HEAD.count(" | ") + "|---|"]
    for case, folder in done.items():
        m = measure(case, folder)
        rows.append(
            f"| {case.name} | {m.run_out:.2f} | {m.height:.2f} | {m.front_stops:.3f} | {m.ends:.3f} | "
            f"{float(f'{1e3 * m.speed:.2g}'):g}{'' if m.at_rest else ' *'} | {m.steps} | {m.rebuilds} | "
            f"{100 * m.ledger:.2g} | {m.flying}{f', {m.lost} lost' if m.lost else ''} |"
        )
    return rows


def scatter_lines(done: dict[Case, Path]) -> list[str]:
    """Means and standard deviations over the runs that differ by the seed alone."""
    groups = {}
    for case, folder in done.items():
        if case.variant is not None and case.variant.startswith("seed"):
            groups.setdefault(replace(case, variant=None), []).append(measure(case, folder))
    rows = ["| case | runs | run-out / w | height / w |", "|---|---|---|---|"]
    for case, found in groups.items():
        cells = []
        for values in ([m.run_out for m in found], [m.height for m in found]):
            spread = f" ± {np.std(values, ddof=1):.2f}" if len(values) > 1 else ""
            cells.append(f"{np.mean(values):.2f}{spread}")
        rows.append(f"| {case.name} | {len(found)} | {' | '.join(cells)} |")
    return rows if len(rows) > 2 else []


def put_into(page: Path, rows: list[str]) -> None:
    """Replace the table at the end of a page."""
    text, head, _ = page.read_text().partition(HEAD)
    if not head:
        raise ValueError(f"{page}: there is no table to replace; it begins with {HEAD}")
    page.write_text(text + "\n".join(rows) + "\n")
