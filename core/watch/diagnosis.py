"""What went wrong in a run, where, and why most likely: the message and the file that describe a failure."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from periporo.core.ranks.reductions import maximum, minimum
from periporo.core.watch.state import State
from periporo.errors import OutputError, place_text

_MOST_POINTS = 10_000  # in the file, from each rank
_NEIGHBOURHOOD = 3.0  # horizons

_KINDS = {  # kind -> what was seen, and the likely cause
    "nan": (
        "is not a number",
        "a material law fails in a state it was not made for, or the time step is too long; look at the stress of the "
        "neighbours in the file, check the material's parameters, lower time_step.safety",
    ),
    "speed": (
        "moves at {size:.3g} times the wave speed",
        "the time step is too long (lower time_step.safety, or leave out time_step.fixed), or a contact or a velocity "
        "pushes harder than the material can follow",
    ),
    "strain": (
        "has a bond that strains by {size:.3g} within one step",
        "the time step is too long (lower time_step.safety, or leave out time_step.fixed), or bodies overlap at the "
        "start",
    ),
    "refused": (
        "refuses the step ({reason})",
        "the strain of a step is more than the law can follow: lower time_step.safety, or look for what pushes so hard "
        "in the file",
    ),
    "gain": (
        "has got most of the {size:.3g} of the work done that the channel '{reason}' gave and had never taken",
        "bodies or obstacles that push what they had not been pressed by: look where they meet, and whether points lie "
        "inside of both; or the time step is too long (lower time_step.safety); raise monitor.energy_tolerance if such "
        "a gain is acceptable",
    ),
    "energy": (
        "has the largest part in an energy error of {size:.3g} of the work done",
        "the time step is too long (lower time_step.safety, or leave out time_step.fixed); raise "
        "monitor.energy_tolerance if such an error is acceptable",
    ),
}


@dataclass(frozen=True)
class Fault:
    """A failure: its kind and size, and the worst point. `str(fault)` names them and the likely cause."""

    kind: str
    size: float
    step: int
    time: float
    point: int
    position: tuple[float, ...]
    material: str
    offenders: np.ndarray  # ids of this rank's
    origin: tuple[float, ...]  # that the position is counted from, m
    reason: str = ""  # of a law that refuses a step

    def __str__(self) -> str:
        seen, cause = _KINDS[self.kind]
        place = place_text(self.position, self.origin, 6)
        return (
            f"t = {self.time:.6g} s, step {self.step}: point {self.point} at ({place}) m, material "
            f"'{self.material}', {seen.format(size=self.size, reason=self.reason)}. Likely cause: {cause}"
        )


def find_fault(sim, kind: str, excess: np.ndarray, materials: list[str], kept: State, size=None) -> Fault:
    """The fault of a `kind`; points offend where `excess` (owned,) is over 1, the worst has the largest; collective.

    A position that is not a number any more is that of the state `kept` in memory.
    """
    comm, p, n = sim.comm, sim.particles, sim.particles.owned
    worst = maximum(comm, float(excess.max(initial=0.0)))
    mine = p.id[:n][excess == worst]
    point = int(minimum(comm, float(mine.min(initial=2**53))))
    found = None
    row = np.flatnonzero(p.id[:n] == point)
    if len(row):
        found = p.position[row[0]].tolist(), materials[p.material[row[0]]]
    found = next(f for f in comm.allgather(found) if f is not None)
    before = None
    row = np.flatnonzero(kept.points["id"] == point)
    if len(row):
        before = kept.points["position"][row[0]].tolist()
    before = next(b for b in comm.allgather(before) if b is not None)
    position = found[0] if np.isfinite(found[0]).all() else before
    return Fault(
        kind, worst if size is None else size, sim.step_number, sim.time, point, tuple(position), found[1],
        p.id[:n][(excess > 1.0) | (p.id[:n] == point)], tuple(sim.origin.tolist()),
    )  # fmt: skip


def report(sim, fault: Fault, path: Path) -> None:
    """Write the offending points and the neighbourhood of the worst one as a table (CSV); collective."""
    p, n = sim.particles, sim.particles.owned
    distance = np.sqrt(((p.position[:n] - np.array(fault.position)) ** 2).sum(axis=1))
    offends = np.isin(p.id[:n], fault.offenders)
    rows = np.flatnonzero(offends | (distance < _NEIGHBOURHOOD * sim.scheme.horizon))[:_MOST_POINTS]
    table = np.column_stack(list(_columns(sim, rows, offends).values()))
    tables = sim.comm.gather(table)
    failure = None
    if sim.comm.rank == 0:
        table = np.concatenate(tables)
        try:
            _write_table(path, list(_columns(sim, rows[:0], offends)), table[np.argsort(table[:, 0])], fault)
        except OSError as error:
            failure = f"cannot write {path}: {error.strerror}\n{fault}"
    failure = sim.comm.bcast(failure)
    if failure is not None:
        raise OutputError(failure)


def _columns(sim, rows, offends):
    """Columns (rows,) by name with unit."""
    p, axes = sim.particles, "xyz"[: sim.particles.dimension]
    columns = {"id": p.id[rows], "offends": offends[rows], "material": p.material[rows]}
    vectors = {"position [m]": p.position + sim.origin, "velocity [m/s]": p.velocity}
    vectors |= {f"{name} force [N]": getattr(p, f"{name}_force") for name in sim.forces.names}
    for name, array in vectors.items():
        columns |= {f"{axis} {name}": array[rows, a] for a, axis in enumerate(axes)}
    columns |= {"volume [m^3]": p.present_volume()[rows], "integrity": p.share[rows, 1]}
    sim.bonds.average(p, rows)
    stress = np.zeros((len(rows), p.components))
    for block in sim.bonds.blocks:
        own = p.material[rows] == block.index
        stress[own] = getattr(p, block.average)[rows[own], 1 : 1 + p.components]
    names = ("xx", "yy", "zz", "xy", "yz", "xz")[: p.components]
    return columns | {f"stress {name} [Pa]": stress[:, c] for c, name in enumerate(names)}


def _write_table(path, names, table, fault):
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([f"# {fault}"])
        writer.writerow(names)
        integers = sum(name in ("id", "offends", "material") for name in names)
        for row in table.tolist():
            writer.writerow([*(int(v) for v in row[:integers]), *row[integers:]])
