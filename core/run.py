"""A whole run from the command line: scene, observers, summary, pictures; and its check beforehand."""

import platform
import time
from importlib import metadata
from pathlib import Path

import numba
import numpy as np
import yaml

from periporo.core import fields, jit
from periporo.core.observers import HistoryObserver, ProgressObserver, ResultObserver
from periporo.core.reductions import quantile
from periporo.core.scene import build, vertical_axis
from periporo.io.input_errors import InputError, Problem
from periporo.io.log import Progress
from periporo.io.schema import load_scene
from periporo.io.writer import ResultWriter


def load_everywhere(path, comm):
    """The scene on every rank; rank 0 reads the file, and its InputError is raised on all ranks alike."""
    scene, error = None, None
    if comm.rank == 0:
        try:
            scene = load_scene(path)
        except InputError as problem:
            error = problem
    scene, error = comm.bcast((scene, error))
    if error is not None:
        raise error
    return scene


def run_scene(arguments, comm) -> int:
    """Run the scene in the file `arguments.config`; the exit status."""
    began = time.perf_counter()
    scene = load_everywhere(arguments.config, comm)
    stem = Path(arguments.config).stem
    target = Path(scene.output.file or f"{stem}.h5")
    with Progress(comm, enabled=not arguments.quiet) as progress:
        if not jit.CACHE_IS_WARM:
            progress.message("compiling kernels (once, about half a minute)")
        sim = build(scene, comm)
        names = _output_names(scene, sim)
        declared = {n: (f.columns, f.unit) for n, f in fields.available(sim).items() if n in names}
        with ResultWriter(
            target, comm, dimension=scene.dimension, fields=declared, attributes=_attributes(scene, comm),
            history_units=HistoryObserver.UNITS, overwrite=arguments.overwrite,
        ) as writer:  # fmt: skip
            sim.start()
            history = HistoryObserver(writer, scene.output.history_interval, vertical_axis(scene))
            sim.observers += [history, ResultObserver(writer, names, scene.output.interval)]
            sim.observers.append(ProgressObserver(progress, history))
            progress.message(f"ready after {time.perf_counter() - began:.1f} s")
            sim.timing.reset()
            sim.halo.reset_counters()
            sim.run()
            sim.halo.close()
            wall_time = time.perf_counter() - began
            writer.set_attributes({"wall_time_s": wall_time, "timing": _timing(sim), **_counters(sim)})
        for line in _summary(sim, history, vertical_axis(scene)):
            progress.message(line)
        progress.message(f"results: {target}")
        if not arguments.no_plot and comm.rank == 0:
            for picture in _pictures(target):
                progress.message(f"picture: {picture}")
    return 0


def _output_names(scene, sim) -> tuple[str, ...]:
    known = fields.available(sim)
    names = scene.output.fields or fields.DEFAULT
    for name in names:
        if name not in known:
            allowed = ", ".join(sorted(known))
            raise InputError("scene", [Problem(("output", "fields"), f"no field '{name}'; this scene has: {allowed}")])
    return tuple(names)


def _attributes(scene, comm):
    versions = {name: metadata.version(name) for name in ("periporo", "numpy", "numba", "h5py", "mpi4py")}
    return {
        "configuration": yaml.safe_dump(scene.model_dump(mode="json", exclude_none=True), sort_keys=False),
        "versions": ", ".join(f"{k} {v}" for k, v in versions.items()),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cpu": numba.core.config.CPU_NAME or "host",
        "ranks": comm.size,
    }


def _timing(sim) -> str:
    return yaml.safe_dump({k: round(v, 6) for k, v in sim.timing.seconds.items()}, default_flow_style=True)


def _counters(sim) -> dict[str, int]:
    """How often neighbours were found anew, and what the ranks sent each other after the start."""
    sent = {"migrated_points": sim.halo.points_migrated, "messages": sim.halo.messages_sent,
            "bytes_sent": sim.halo.bytes_sent}  # fmt: skip
    return {"rebuilds": sim.rebuild_count, **{name: sim.comm.allreduce(count) for name, count in sent.items()}}


def _summary(sim, history, vertical) -> list[str]:
    """Energy ledger, run-out and height, and where the time went."""
    p, n = sim.particles, sim.particles.owned
    last = history.latest
    across = np.abs(np.delete(p.position[:n], vertical, axis=1)).max(axis=1, initial=0.0)
    regular = p.share[:n, 1] > 0.0
    front = quantile(sim.comm, across[regular], 0.99) + 0.5 * sim.spacing
    lost = sim.comm.allreduce(int((~regular).sum()))
    energies = [name for name, unit in history.UNITS.items() if unit == "J"]
    ledger = [f"  {name.replace('_', ' '):22s} {last[name]:+.6e} J" for name in energies]
    error = abs(last["energy_residual"] - last["integration_term"])
    return [
        "energy ledger",
        *ledger,
        f"  unexplained            {error:.1e} J",
        f"run-out {front:.4g} m (99 % of the deposit), height {last['height']:.4g} m, free-flying points {lost}",
        "time of the run",
        *(f"  {line}" for line in sim.timing.lines()),
    ]


def _pictures(target):
    try:
        from periporo.io.plots import plot_run

        return plot_run(target)
    except ImportError as error:
        return [f"none ({error})"]


def check_scene(path, comm) -> int:
    """Build the scene and say what it will cost: points, bonds, memory, time step, steps, expected run time."""
    scene = load_everywhere(path, comm)
    sim = build(scene, comm)
    _output_names(scene, sim)
    sim.start()
    sim.step()  # the first one measures the stable time step
    began, trials = time.perf_counter(), 20
    for _ in range(trials):
        sim.step()
    seconds = comm.allreduce((time.perf_counter() - began) / trials) / comm.size
    points, pairs = comm.allreduce(sim.particles.owned), comm.allreduce(len(sim.bonds.pairs.first))
    duration = sum(getattr(stage, "duration", 0.0) for stage in sim.stages)
    steps = duration / sim.dt
    if comm.rank == 0:
        print(f"{path}: valid")
        print(f"  points        {points:,}, pairs {pairs:,}, on {comm.size} rank(s)")
        print(f"  memory        {comm.size * _memory(sim) / 1e6:.1f} MB of state")
        print(f"  time step     {sim.dt:.3g} s at the start")
        print(f"  motion        {duration:g} s, about {steps:,.0f} steps or more as the soil deforms")
        cost = seconds * 1e6 / max(points, 1)
        print(f"  run time      about {steps * seconds:,.0f} s at {cost:.2f} us per point and step")
    return 0


def _memory(sim) -> int:
    arrays = [getattr(sim.particles, name) for name in sim.particles.fields]
    for block in sim.bonds.blocks:
        arrays += [block.stress, block.strain_increment, block.state, block.pair, block.side, block.active]
    pairs = sim.bonds.pairs
    arrays += [pairs.first, pairs.second, pairs.ids, pairs.weight, sim.bonds.incidence]
    return sum(a.nbytes for a in arrays)
