"""Scenes from files, dictionaries or ready-made, read once and the same on every rank."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from mpi4py import MPI

from periporo.core.ranks.patience import wait_for_all
from periporo.core.scene.build import build
from periporo.core.simulation import Simulation
from periporo.errors import InputError
from periporo.io.input.load import load_scene, located, parse_scene
from periporo.io.schema.scene import SceneInput

Source = str | Path | dict[str, Any] | SceneInput
"""A scene: a YAML file, its dictionary, or ready-made."""


def read_everywhere(source: Source, comm: MPI.Comm) -> SceneInput:
    """The scene in the file `source` (a path), or that of a dictionary, or `source` itself if it is a `SceneInput`.

    Rank 0 reads; its InputError is raised on all ranks alike.
    """
    if isinstance(source, SceneInput):
        return source
    scene, error = None, None
    if comm.rank == 0:
        try:
            scene = load_scene(source) if isinstance(source, str | Path) else parse_scene(source)
        except InputError as problem:
            error = problem
    wait_for_all(comm)
    scene, error = comm.bcast((scene, error))
    if error is not None:
        raise error
    return scene


@contextmanager
def naming(source: Source) -> Iterator[None]:
    """Have an InputError that is raised within name the file `source`, if it is one, and the lines in it."""
    try:
        yield
    except InputError as error:
        if isinstance(source, str | Path):
            with suppress(InputError):  # in the midst of a run the file may be gone
                error = located(error, source)
        raise error from None


def simulation_of(source: Source, comm: MPI.Comm) -> Simulation:
    """The simulation of the scene `source`, see `read_everywhere`, on the ranks of `comm`. Raises InputError."""
    scene = read_everywhere(source, comm)
    with naming(source):
        return build(scene, comm)


Simulation.reader = staticmethod(simulation_of)
