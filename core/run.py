"""A whole run from the command line: scene, observers, summary, pictures."""

import platform
import time
from collections.abc import Callable, Iterable
from contextlib import closing
from importlib import metadata
from pathlib import Path

import yaml
from mpi4py import MPI

from periporo.core.numerics import jit
from periporo.core.points import fields
from periporo.core.points.probes import Probes
from periporo.core.ranks.patience import wait_for_all
from periporo.core.ranks.processors import agree
from periporo.core.scene.build import build, output_names
from periporo.core.scene.doubts import without_company
from periporo.core.scene.source import Source, naming, read_everywhere
from periporo.core.scene.water_doubts import units_of_water
from periporo.core.simulation import Simulation
from periporo.core.watch.interrupt import Interrupted, Keeper, Signals
from periporo.core.watch.observers import Callback, HistoryObserver, ProgressObserver, ResultObserver, present_obstacles
from periporo.core.watch.state import State, StateError, for_file
from periporo.core.watch.state import resume as resume_from
from periporo.core.watch.summary import figures_of, history_units, summary
from periporo.core.watch.watchdog import Watchdog
from periporo.core.water import flow
from periporo.errors import InputError, OutputError
from periporo.io.geometry.origin import relative
from periporo.io.output import checkpoint, parts
from periporo.io.output.log import Progress
from periporo.io.output.results import ResultError, open_results
from periporo.io.output.writer import ResultWriter
from periporo.io.schema.scene import Checkpoint


def run(
    source: Source, file: str | Path | None = None, *, comm: MPI.Comm | None = None, resume: bool = False,
    overwrite: bool = False, walltime: float | None = None, pictures: bool = False, quiet: bool = False,
    callbacks: Iterable[tuple[int, Callable[[Simulation], object]]] = (),
) -> Path:  # fmt: skip
    """Run a scene, or the rest of it, as the command line does: with results, checkpoints, watchdog and progress.

    - `source`: YAML file, dictionary or `SceneInput`
    - `file`: of the results; by default what the scene says, or the name of its file with .vtkhdf
    - `comm`: the ranks, by default all
    - `resume`: go on from the newest checkpoint; `overwrite`: replace an existing result file
    - `walltime`: s after which to write a checkpoint and stop
    - `pictures`: draw them at the end; `quiet`: no progress display
    - `callbacks`: pairs (n, function); function(simulation) is called on every rank after every n-th step

    Returns the path of the result file. On all ranks alike raises `InputError` if the scene cannot be used,
    `OutputError` if its file cannot be written, `RelaxationError` if equilibrium is not found, `WatchdogError` if the
    motion fails and smaller steps do not help, and ValueError if there is no name for the file.

    >>> soil = {"model": "elastic", "density": 1800, "bulk_modulus": 25e6, "shear_modulus": 15e6}
    >>> box = {"type": "box", "lower": [0, 0], "upper": [0.1, 0.05]}
    >>> scene = {
    ...     "dimension": 2, "spacing": 0.01, "gravity": [0, -9.81], "materials": {"soil": soil},
    ...     "bodies": [{"name": "block", "material": "soil", "shape": box}],
    ...     "stages": [{"name": "fall", "type": "dynamics", "duration": 1e-3}],
    ... }
    >>> file = run(scene, "fall.vtkhdf", quiet=True)
    >>> file.name
    'fall.vtkhdf'
    """
    began = time.monotonic()
    comm = MPI.COMM_WORLD if comm is None else comm
    scene = read_everywhere(source, comm)
    agree(comm, lambda: scene.cpu_target == "common")
    target = _target(scene, source, file, resume)
    with Progress(comm, enabled=not quiet) as progress, Signals() as signals:
        if resume and everywhere(comm, _is_finished, target):
            progress.message(f"{target}: this run has finished; nothing to resume")
            return target
        with naming(source):
            sim = build(scene, comm)
            names = output_names(scene, sim)
        probes = Probes(relative(scene, sim.origin).monitor.points, sim.particles, comm)
        state = _state_to_resume(scene, target, comm, progress.message) if resume else None
        replace = overwrite or (resume and state is None)
        with closing(sim.halo), _writer(scene, target, sim, names, probes, replace, state) as writer:
            if state is None:
                everywhere(comm, checkpoint.remove, target)  # they belong to a run that is gone
            history = _observe(scene, sim, writer, names, probes, progress, callbacks)
            keeper = _keeper(scene, target, writer, walltime, signals, progress.message, began, state)
            rewind = _rewinding(sim, target, writer, keeper)
            watchdog = _watchdog(scene, target, rewind, progress.message)
            sim.guards = [watchdog, keeper]  # in this order: no checkpoint of a state that is taken back
            _begin(scene, sim, source, target, state, progress.message)
            progress.message(f"ready after {time.monotonic() - began:.1f} s")
            sim.timing.reset()
            sim.halo.reset_counters()
            try:
                with naming(source):  # what a stage digs may leave a boundary without a face
                    sim.run(resumed=state is not None)
            except Interrupted as reason:
                progress.message(f"{reason}\ngo on with: {_how_to_resume(source)}")
                return target
            figures = figures_of(sim, history, watchdog, began)
            writer.set_attributes({**figures, "finished": 1})
        everywhere(comm, checkpoint.remove, target)
        for line in summary(sim, history, figures):
            progress.message(line)
        progress.message(f"results: {target}")
        if pictures and comm.rank == 0:
            for picture in _pictures(target):
                progress.message(f"picture: {picture}")
    return target


def _target(scene, source, file, resume) -> Path:
    """The result file: as asked for, as the scene says, or named after the scene's file."""
    if file is None and scene.output.file is None and not isinstance(source, str | Path):
        raise ValueError("where should the results go? Give run(..., file='name.vtkhdf') or the scene's output.file")
    if file or scene.output.file:
        return Path(file or scene.output.file)
    target, former = (Path(f"{Path(source).stem}{ending}") for ending in (".vtkhdf", ".h5"))
    return former if resume and former.exists() and not target.exists() else target  # .h5 before 0.2.0


def _how_to_resume(source) -> str:
    return f"periporo {source} --resume" if isinstance(source, str | Path) else "run(..., resume=True)"


def _observe(scene, sim, writer, names, probes, progress, callbacks) -> HistoryObserver:
    """Have histories and results written, progress shown and functions called; what writes the histories."""
    history = HistoryObserver(writer, scene.output.history_interval, probes)
    results = ResultObserver(writer, names, scene.output.interval, present_obstacles if writer.obstacles else None)
    sim.observers += [history, results, ProgressObserver(progress, history), *(Callback(*c) for c in callbacks)]
    return history


def _begin(scene, sim, source, target, state, message):
    """Start the simulation, or put it into the `state` to go on from; say what is doubtful about it."""
    if sim.comm.rank == 0 and not jit.cache_is_warm():
        message(jit.COMPILING)
    _start(sim, source, target) if state is None else _go_on(sim, state, target)
    if sim.comm.rank == 0:
        jit.remember_warm()
    for remark in jit.remarks:
        message(remark)
    units = units_of_water(scene) if state is None else []  # said once
    for remark in [*without_company(sim, scene), *units]:
        message(f"doubtful: {remark}")


def _start(sim, source, target):
    try:
        with naming(source):
            sim.start()
    except InputError:  # seen only now, for example that nothing limits the time step: as if it had not begun
        everywhere(sim.comm, _discard, target)
        raise


def _discard(target):
    parts.remove(target)
    target.unlink()


def _go_on(sim, state, target):
    try:
        resume_from(sim, state)
    except StateError as error:
        raise OutputError(
            f"cannot resume {target}: the checkpoint does not fit this version of periporo, {error}; go on with the "
            "version that wrote it, or start anew with --overwrite"
        ) from None


def everywhere(comm, function, *arguments):
    """What the function returns on rank 0, or its OSError as OutputError, on all ranks."""
    value, failure = None, None
    if comm.rank == 0:
        try:
            value = function(*arguments)
        except OSError as error:
            failure = str(error)
    wait_for_all(comm)
    value, failure = comm.bcast((value, failure))
    if failure is not None:
        raise OutputError(failure)
    return value


def _writer(scene, target, sim, names, probes, overwrite, state):
    declared = {n: (f.columns, f.unit) for n, f in fields.available(sim).items() if n in names}
    told = {name: unit for part in sim.reactions for name, unit in part.units.items()}
    return ResultWriter(
        target, sim.comm, dimension=scene.dimension, fields=declared,
        attributes=_attributes(scene, sim) if sim.comm.rank == 0 else None,  # which alone writes them
        history_units=history_units() | flow.UNITS | probes.units | told, overwrite=overwrite,
        parts=scene.output.parts, obstacles=any(hasattr(c, "outline") for stage in sim.stages for c in stage.contacts),
        resume_step=None if state is None else state.memory["simulation"]["step_number"],
    )  # fmt: skip


def _watchdog(scene, target, rewind, message):
    return Watchdog(
        scene.monitor.energy_tolerance, scene.materials, target.with_suffix(".diagnostic.csv"), rewind=rewind,
        message=message,
    )  # fmt: skip


def _rewinding(sim, target, writer, keeper):
    """What drops all that was recorded of `sim` after the step to which it was taken back."""

    def rewind(step):
        writer.rewind(step)
        newest = everywhere(sim.comm, checkpoint.existing, target)[:1]
        if any(path.name > checkpoint.path_of(target, step).name for path in newest):
            keeper.write(sim)  # takes the place of those that were made since

    return rewind


def _keeper(scene, target, writer, walltime, signals, message, began, state):
    """Checkpoints as the scene asks for them; without, only when the run is asked to stop.

    `state` is that from which the run goes on, or None.
    """
    chosen = scene.checkpoint or Checkpoint()
    last = None if state is None else checkpoint.path_of(target, state.memory["simulation"]["step_number"])

    def write(sim):
        nonlocal last
        step, kept, tables = for_file(sim)
        if checkpoint.path_of(target, step) == last:
            return last  # of the same increment or trial, for example: to write it anew would only put it at risk
        writer.sync()
        configuration = _fingerprint(scene) if sim.comm.rank == 0 else ""  # which alone writes it
        last = checkpoint.write(
            writer.background, target, step, kept, tables, configuration, chosen.keep, scene.output.parts
        )
        return last

    interval = None if scene.checkpoint is None else chosen.interval
    return Keeper(write, signals, writer.background, interval=interval, walltime=walltime, message=message, began=began)


def _fingerprint(scene) -> str:
    """The scene as JSON without what may change between the parts of a run."""
    free = {"title": True, "cpu_target": True, "checkpoint": True, "monitor": {"energy_tolerance"}}
    return scene.model_dump_json(exclude=free)


def _state_to_resume(scene, target, comm, message):
    """The state in the newest checkpoint that can be read; None to begin anew, for there is none yet.

    Raises CheckpointError if all are damaged, OutputError if they belong to another scene or there are results of a
    run that was to have no checkpoints.
    """
    paths, damage = everywhere(comm, checkpoint.existing, target), None
    for path in paths:
        try:
            state = State.of_tables(*checkpoint.read(path, comm, _fingerprint(scene), message))
        except checkpoint.CheckpointError as error:
            message(str(error))
            damage = error
            continue
        clock = state.memory["simulation"]
        message(f"resuming at t = {clock['time']:.6g} s, step {clock['step_number']}, from {path.name}")
        return state
    if damage is not None:
        raise damage
    if scene.checkpoint is None and everywhere(comm, target.exists):
        raise OutputError(f"cannot resume {target}: there is no checkpoint beside it; start anew with --overwrite")
    message("no checkpoint yet: starting from the beginning")
    return None


def _is_finished(target) -> bool:
    try:
        with open_results(target) as results:
            return "finished" in results.attributes
    except ResultError:
        return False


def _attributes(scene, sim):
    versions = {name: metadata.version(name) for name in ("periporo", "numpy", "numba", "h5py", "mpi4py")}
    return {
        "configuration": yaml.safe_dump(scene.model_dump(mode="json", exclude_none=True), sort_keys=False),
        "versions": ", ".join(f"{k} {v}" for k, v in versions.items()),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cpu": jit.processor()[0],
        "ranks": sim.comm.size,
        **({"origin": sim.origin} if sim.origin.any() else {}),
    }


def _pictures(target):
    try:
        from periporo.io.pictures.plots import plot_run

        return plot_run(target)
    except (ImportError, ResultError) as error:
        return [f"none ({error})"]
