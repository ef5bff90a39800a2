"""Runs that are kept, each in a folder of its own: what is finished is not run again."""

import contextlib
from pathlib import Path

import yaml

from periporo.core.cli import main as periporo
from periporo.io.output.results import ResultError, open_results


def is_finished(result: Path) -> bool:
    """Whether a result file is of a run that came to its end."""
    try:
        with open_results(result) as results:
            return "finished" in results.attributes
    except ResultError:
        return False


def is_same(scene: dict, file: Path) -> bool:
    """Whether `file` holds this scene, so that its run can go on."""
    return file.exists() and file.read_text() == _text(scene)


def write(scene: dict, file: Path) -> None:
    """Write a scene, and the folder of its run."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(_text(scene))


def run(scene: dict, file: Path, result: Path, *options: str) -> int:
    """Run a scene from its `file`, or the rest of it; the exit status of `periporo`. A changed scene starts anew.

    result: where the scene has its results. options: more words for `periporo run`.
    """
    same = is_same(scene, file)
    if same and is_finished(result):
        return 0
    write(scene, file)
    with contextlib.chdir(file.parent):
        return periporo(["run", file.name, "--resume" if same else "--overwrite", "--quiet", "--no-plot", *options])


def _text(scene: dict) -> str:
    return yaml.safe_dump(scene, sort_keys=False)
