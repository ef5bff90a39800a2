"""The command line: `periporo config.yaml` runs a scene, other words name the tools around it."""

import argparse
import contextlib
import difflib
import gc
import importlib
import os
import sys
import traceback
from importlib import metadata

TOOLS = {  # word -> module with add_arguments and run, and what it does
    "plot": ("periporo.io.pictures.plots", "draw the deposit, the histories and the energy ledger of a result file"),
    "info": ("periporo.io.output.info", "summarise a result file"),
    "compare": ("periporo.io.output.compare", "compare two result files"),
    "merge": ("periporo.io.output.merge", "make one file of a result file in parts"),
    "export": ("periporo.io.output.export", "export a result file to VTU and CSV"),
    "raster": ("periporo.io.output.rasters", "write depth, speed and arrival of a landslide as rasters"),
    "surface": ("periporo.io.pictures.surface", "write what an obstacle bears along its surface: table, picture"),
    "profile": ("periporo.io.output.profile_command", "write a field along a line as a table"),
    "section": ("periporo.io.pictures.section", "draw an upright section of a result in space"),
    "report": ("periporo.io.pictures.report", "make one HTML page of a result file"),
    "new": ("periporo.io.input.examples", "list the example scenes, or write one to begin with"),
    "schema": ("periporo.io.schema.reference", "print the JSON Schema of scenes for editors, or the input reference"),
    "materials": ("periporo.io.schema.material_list", "list the installed materials with parameters, units and bounds"),
    "fit": ("periporo.materials.laboratory.fit_command", "find the parameters of a law that fit measured tests"),
    "study": ("periporo.core.study.study", "run variants of a scene side by side, with one table and one page"),
    "drive": ("periporo.materials.laboratory.command", "run one material point along a path"),
}
INPUT_ERROR, RUN_ERROR, INTERRUPTED = 2, 3, 130

_OTHER_MPIRUN = "Use the mpirun that belongs to it (with the extra 'mpi': the one in the environment's bin folder)."
LAUNCHERS = {  # variable with the number of processes -> who sets it, and what to do instead; the first one counts
    "OMPI_COMM_WORLD_SIZE": ("Open MPI's mpirun", _OTHER_MPIRUN),
    "PMI_SIZE": ("MPICH's mpirun", _OTHER_MPIRUN),
    "SLURM_STEP_NUM_TASKS": (
        "srun",
        "Use srun --mpi=pmix for Open MPI, --mpi=pmi2 for MPICH, or its own mpirun; for one rank in an interactive "
        "shell of SLURM, unset SLURM_STEP_NUM_TASKS.",
    ),
}


def main(argv: list[str] | None = None) -> int:
    """Entry point; returns the exit status: 0 done, 1 differences found, 2 bad input, 3 the run failed."""
    argv = sys.argv[1:] if argv is None else argv
    words = (*TOOLS, "run", "check")
    if argv and argv[0] not in words and not argv[0].startswith("-"):
        mistake = _mistake(argv[0], words)
        if mistake is not None:
            print(f"periporo: {mistake}", file=sys.stderr)
            return INPUT_ERROR
        argv = ["run", *argv]
    arguments = _parser(argv[0] if argv else "").parse_args(argv)
    if arguments.word in ("run", "check"):
        return _simulate(arguments)
    return _use_tool(arguments)


def _mistake(word: str, words) -> str | None:
    """What is wrong with a word that should name a scene, as far as one can tell."""
    if word.endswith((".vtkhdf", ".h5", ".hdf5")):
        return f"'{word}' is the name of a result file, not of a scene; did you mean 'periporo plot {word}'?"
    meant = difflib.get_close_matches(word, words, n=1)
    if meant and "." not in word and not os.path.exists(word):
        return f"there is no command, and no file, '{word}'; did you mean '{meant[0]}'?"
    return None


def _parser(chosen: str) -> argparse.ArgumentParser:
    """What reads the command line; of the tools only the chosen one is loaded, for they hold kernels."""
    parser = argparse.ArgumentParser(
        prog="periporo", description="Extreme deformation of soils by updated-Lagrangian periporomechanics."
    )
    parser.add_argument("--version", action="version", version=f"periporo {metadata.version('periporo')}")
    words = parser.add_subparsers(dest="word", required=True, metavar="WORD")
    run = words.add_parser("run", help="run a scene; the word may be left out: periporo config.yaml")
    run.add_argument("config", help="YAML file of the scene")
    start = run.add_mutually_exclusive_group()
    start.add_argument("--overwrite", action="store_true", help="replace an existing result file")
    start.add_argument("--resume", action="store_true", help="go on from the newest checkpoint")
    run.add_argument("--walltime", type=_seconds, metavar="S", help="write a checkpoint and stop before S seconds")
    run.add_argument("--no-plot", action="store_true", help="write no pictures at the end")
    run.add_argument("--quiet", action="store_true", help="no progress display")
    check = words.add_parser("check", help="check a scene and say what it will cost, without running it")
    check.add_argument("config", help="YAML file of the scene")
    for word, (module, text) in TOOLS.items():
        tool = words.add_parser(word, help=text)
        if word == chosen:
            importlib.import_module(module).add_arguments(tool)
        tool.set_defaults(module=module)
    return parser


def _seconds(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number of seconds")
    return value


def _use_tool(arguments) -> int:
    from periporo.errors import OutputError
    from periporo.io.output.results import ResultError

    try:
        status = importlib.import_module(arguments.module).run(arguments)
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        print(f"periporo {arguments.word}: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # whoever reads the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (ResultError, OutputError, ImportError, OSError) as error:
        print(f"periporo {arguments.word}: {error}", file=sys.stderr)
        return INPUT_ERROR


@contextlib.contextmanager
def _without_collector():
    """Load modules without Python's garbage collector, which is on afterwards if it was before.

    It would look through all objects again and again as modules make them, and find no garbage among them: a twentieth
    of the time that a run takes to start.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _simulate(arguments) -> int:
    _doubt_shared_memory()
    if arguments.word == "run":  # one rank can check a scene as well as many
        _refuse_foreign_launcher()
    with _without_collector():
        from mpi4py import MPI

        from periporo.core.ranks.processors import agree
        from periporo.errors import ContactError, InputError, OutputError, WaterError

    comm = MPI.COMM_WORLD
    try:  # before any kernel is imported
        agree(comm, lambda: _wants_common_processor(arguments.config))
    except InputError as error:
        if comm.rank == 0:
            print(f"periporo: {error}", file=sys.stderr, flush=True)
        return INPUT_ERROR

    with _without_collector():
        from periporo.core.bonds.bonds import RefusedStep
        from periporo.core.motion.relaxation import RelaxationError
        from periporo.core.run import run
        from periporo.core.watch.strength import StabilityError
        from periporo.core.watch.watchdog import WatchdogError

    try:
        if arguments.word == "check":
            from periporo.core.scene.check import check_scene

            return check_scene(arguments.config, comm)
        run(
            arguments.config, comm=comm, resume=arguments.resume, overwrite=arguments.overwrite,
            walltime=arguments.walltime, pictures=not arguments.no_plot, quiet=arguments.quiet,
        )  # fmt: skip
        return 0
    except (
        InputError, OutputError, ContactError, RelaxationError, RefusedStep, StabilityError, WatchdogError, WaterError
    ) as error:  # the same on all ranks
        if comm.rank == 0:
            print(f"periporo: {error}", file=sys.stderr, flush=True)
        comm.Barrier()
        return INPUT_ERROR if isinstance(error, InputError | OutputError) else RUN_ERROR
    except KeyboardInterrupt:
        return _give_up(comm, "interrupted while the scene was made; nothing to resume", INTERRUPTED)
    except Exception:  # in a plugin, or a fault of the program
        return _give_up(comm, f"rank {comm.rank} failed:\n{traceback.format_exc()}", RUN_ERROR)


def _wants_common_processor(config: str) -> bool:
    """Whether the scene in a file says `cpu_target: common`; what else is wrong with it is said later."""
    from periporo.errors import InputError
    from periporo.io.input.yaml_source import read_yaml

    try:
        data = read_yaml(config).data
    except InputError:
        return False
    return isinstance(data, dict) and data.get("cpu_target") == "common"


def _give_up(comm, message: str, status: int) -> int:
    """Say why this rank ends, and end the others, which may be waiting for it."""
    print(f"periporo: {message}", file=sys.stderr, flush=True)
    if comm.size > 1:
        comm.Abort(status)
    return status


def _doubt_shared_memory() -> None:
    """MPI may die without a word that helps where a container has no shared memory: say so before."""
    if os.path.isdir("/dev") and not os.access("/dev/shm", os.W_OK):
        remedy = "give the container one (docker: --tmpfs /dev/shm, apptainer: --bind /dev/shm)"
        doubt = "/dev/shm cannot be written, and MPI may not start without it, not even on one rank"
        print(f"periporo: {doubt}; {remedy}", file=sys.stderr, flush=True)


def _refuse_foreign_launcher() -> None:
    """A launcher that the MPI library does not understand starts unconnected copies of a program: say so instead."""
    from mpi4py import MPI

    told = {name: os.environ.get(name, "") for name in LAUNCHERS}
    variable = next((name for name, count in told.items() if count.isdecimal()), None)  # an empty one says nothing
    if variable is None or int(told[variable]) < 2 or MPI.COMM_WORLD.size > 1:
        return
    launcher, remedy = LAUNCHERS[variable]
    name, version = MPI.get_vendor()
    print(
        f"periporo: started by {launcher} as {told[variable]} processes, but mpi4py here is built on {name} "
        f"{'.'.join(map(str, version))}, so they do not see each other. {remedy}",
        file=sys.stderr,
    )
    raise SystemExit(INPUT_ERROR)


if __name__ == "__main__":
    raise SystemExit(main())
