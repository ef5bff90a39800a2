"""Gives damaged scenes to the command line on all ranks, and takes down what it answers.

    mpirun -n 2 python refusals.py answers.json [N | all]

Each scene of `periporo.configs` is damaged (see tests/mutations.py) in its share of the ways, so that their number does
not grow with that of the scenes; with N, every N-th of these damages is tried; with `all`, every damage. Half of the
scenes are to be run, half to be checked. The file gets a list of [what was done, exit status of each rank, standard
output and error of each rank, files that appeared].
"""

import contextlib
import importlib.util
import io
import json
import random
import sys
from importlib import resources
from pathlib import Path
from unittest import mock

from mpi4py import MPI

from periporo.core import cli
from periporo.core.simulation import Simulation
from periporo.core.watch.watchdog import WatchdogError
from periporo.io.input.yaml_source import read_yaml

COMM = MPI.COMM_WORLD
_SPEC = importlib.util.spec_from_file_location("mutations", Path(__file__).parents[1] / "mutations.py")
mutations = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(mutations)
SCENE = Path("scene.yaml")
SELDOM = 4  # damage to the structure is of few kinds at many places


def shipped():
    """The shipped scenes by name."""
    folder = Path(resources.files("periporo.configs"))
    return {path.stem: read_yaml(path).data for path in sorted(folder.glob("*.yaml"))}


def damages(scene, first=0, step=1, seldom=1):
    """(what, bytes) of every `step`-th damage of a scene from the `first` on, of its structure every `seldom`-th."""
    m = mutations
    special = [*m.contradictory(scene), *m.out_of_range(scene), *m.paths(scene)]
    structural = [*m.lookalikes(scene), *m.structural(scene, most=2)]
    random.Random(1).shuffle(structural)
    for what, path, damaged in special[first::step] + structural[first::seldom]:
        yield f"{what} at {path}", m.dumped(damaged).encode()
    yield from list(m.texts(scene))[first::step]


def answer(word, text):
    """Status, output and error of all ranks for a scene of these bytes, and what appeared beside it; on rank 0."""
    if COMM.rank == 0:
        SCENE.write_bytes(text)
    COMM.Barrier()
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        try:
            status = cli.main([word, str(SCENE)])
        except BaseException as crash:  # one rank alone would raise; the test wants to see it
            status = repr(crash)
    answers = COMM.gather((status, out.getvalue(), error.getvalue()))
    return None if answers is None else (*zip(*answers, strict=True), swept())


def swept():
    """Files beside the scene and in the folder above, which are then removed."""
    found = [path for path in Path("..").rglob("*") if path.name not in (SCENE.name, Path.cwd().name)]
    for path in found:
        path.unlink() if path.is_file() else None
    return sorted(map(str, found))


def accepted(sim):
    raise WatchdogError("accepted")  # ends the run on all ranks


def main(words):
    """Writes the file that is named by the first of the words."""
    target, share = Path.cwd() / words[0], words[1] if words[1:] else "1"
    folder = Path("work")
    folder.mkdir(exist_ok=True)
    found, scenes = [], shipped()
    with contextlib.chdir(folder), mock.patch.object(Simulation, "start", accepted):
        for number, (name, scene) in enumerate(scenes.items()):
            shares = () if share == "all" else (number, len(scenes), SELDOM * len(scenes))
            found += [(f"{name}: {what}", text) for what, text in damages(scene, *shares)]
        tried = list(enumerate(found))[:: 1 if share == "all" else int(share)]
        answers = [(what, answer("check" if number % 2 else "run", text)) for number, (what, text) in tried]
    if COMM.rank == 0:
        target.write_text(json.dumps([(what, *given) for what, given in answers]))
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
