"""What is said of a run when it has ended: its figures, for the file, and a summary, for the log."""

import math
import time

import yaml

from periporo.core.motion import added_inertia, sleep
from periporo.core.motion.energy import OBSTACLES
from periporo.core.points import departures
from periporo.core.ranks.reductions import quantile
from periporo.core.watch.observers import HistoryObserver
from periporo.core.watch.strength import StrengthReductionStage
from periporo.core.watch.watchdog import Watchdog


def history_units() -> dict[str, str]:
    """Histories of the scene as a whole, with units."""
    return HistoryObserver.UNITS | departures.UNITS | OBSTACLES | sleep.UNITS | added_inertia.UNITS


def figures_of(sim, history: HistoryObserver, watchdog: Watchdog, began: float) -> dict:
    """What the file says of the run as a whole; `began` on the monotonic clock, s; collective."""
    figures = {"wall_time_s": time.monotonic() - began, "timing": _timing(sim), "retries": watchdog.retries}
    for stage in sim.stages:
        if isinstance(stage, StrengthReductionStage):
            figures[f"factor_of_safety_{stage.name}"] = stage.safety
    return figures | _deposit(sim, history) | _counters(sim)


def _timing(sim) -> str:
    return yaml.safe_dump({k: round(v, 6) for k, v in sim.timing.seconds.items()}, default_flow_style=True)


def _counters(sim) -> dict[str, int]:
    """How often neighbours were found anew and laws failed, and what the ranks sent each other after the start."""
    sent = {"migrated_points": sim.halo.points_migrated, "messages": sim.halo.messages_sent,
            "bytes_sent": sim.halo.bytes_sent}  # fmt: skip
    counts = {"rebuilds": sim.rebuild_count, "failed_updates": sim.failed_updates()}
    return {**counts, **{name: sim.comm.allreduce(count) for name, count in sent.items()}}


def _deposit(sim, history) -> dict:
    """Run-out, the half-width that holds 99 % of the deposit; height; and points that belong to nothing."""
    p, n = sim.particles, sim.particles.owned
    across = sim.extent.distance(p.position[:n])
    regular = p.share[:n, 1] > 0.0
    return {
        "run_out_m": quantile(sim.comm, across[regular], 0.99) + 0.5 * sim.spacing,  # NaN if all fly freely
        "height_m": history.latest["height"],
        "free_flying_points": sim.comm.allreduce(int((~regular).sum())),
    }


def summary(sim, history: HistoryObserver, figures: dict) -> list[str]:
    """Energy ledger, run-out and height, what laws failed in, and where the time went."""
    last, units = history.latest, history_units()
    energies = [name for name in last if units.get(name) == "J"]
    ledger = [f"  {name.replace('_', ' '):22s} {last[name] + 0.0:+.6e} J" for name in energies]  # + 0.0: no minus zero
    run_out, height = f"{figures['run_out_m']:.4g} m (99 % of the deposit)", f"{figures['height_m']:.4g} m"
    if math.isnan(figures["run_out_m"]):
        run_out = "none (no point has regular company)"
    if math.isnan(figures["height_m"]):
        height = "none (no point is left)"
    error, failed = abs(last["energy_residual"] - last["integration_term"]), figures["failed_updates"]
    return [
        "energy ledger",
        *ledger,
        f"  unexplained            {error:.1e} J",
        f"run-out {run_out}, height {height}, "
        f"free-flying points {figures['free_flying_points']}",
        *([f"{last['departed_points']:,} points left the domain"] if "departed_points" in last else []),
        *([f"{failed:,} updates of laws failed: those rows kept their stress"] if failed else []),
        "time of the run",
        *(f"  {line}" for line in sim.timing.lines()),
    ]
