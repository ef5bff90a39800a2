"""Runs of the variants side by side, each in a process and a folder of its own; what is finished is not run again."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import yaml

from periporo.core.study.variants import Study, Variant
from periporo.io.output.results import ResultError, open_results

SCENE, RESULT, LOG = "scene.yaml", "scene.vtkhdf", "log.txt"
_PAUSE = 0.05  # s between looks at the processes
_GRACE = 30.0  # s that interrupted runs have for their checkpoints


@dataclass
class _Running:
    variant: Variant
    process: subprocess.Popen
    began: float


def run_variants(study: Study, folder: Path, cores: int, say: Callable[[str], None]) -> list[str]:
    """Run what is not finished, `cores` at a time; names of the variants that failed.

    A run that was interrupted goes on from its checkpoint, if the scene has them. KeyboardInterrupt is passed to the
    runs, which write theirs, and raised again.
    """
    waiting = [v for v in study.variants if not _is_done(folder / v.name, v)]
    total = len(study.variants)
    done = total - len(waiting)
    if done:
        say(f"{done} of {total} variants are finished already")
    running: list[_Running] = []
    failed: list[str] = []
    try:
        while waiting or running:
            while waiting and len(running) < cores:
                variant = waiting.pop(0)
                running.append(_Running(variant, _start(folder / variant.name, variant), time.monotonic()))
            time.sleep(_PAUSE)
            for job in [job for job in running if job.process.poll() is not None]:
                running.remove(job)
                done += 1
                told = f"{time.monotonic() - job.began:.0f} s"
                if job.process.returncode != 0:
                    failed.append(job.variant.name)
                    told = f"failed, see {folder / job.variant.name / LOG}"
                say(f"{done}/{total} {job.variant.name}: {told}")
    except BaseException:
        _stop(running)
        raise
    return failed


def is_finished(folder: Path) -> bool:
    """Whether the run in a folder came to its end."""
    try:
        with open_results(folder / RESULT) as results:
            return "finished" in results.attributes
    except ResultError:
        return False


def _text(variant: Variant) -> str:
    return yaml.safe_dump(variant.scene.model_dump(mode="json", exclude_none=True), sort_keys=False)


def _is_same(folder: Path, variant: Variant) -> bool:
    file = folder / SCENE
    return file.exists() and file.read_text() == _text(variant)


def _is_done(folder: Path, variant: Variant) -> bool:
    return _is_same(folder, variant) and is_finished(folder)


def _start(folder: Path, variant: Variant) -> subprocess.Popen:
    """A process that runs a variant, or the rest of it; a changed one starts anew."""
    same = _is_same(folder, variant)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / SCENE).write_text(_text(variant))
    how = "--resume" if same else "--overwrite"
    words = [sys.executable, "-m", "periporo.core.cli", "run", SCENE, how, "--quiet", "--no-plot"]
    with open(folder / LOG, "w") as log:
        alone = {name: value for name, value in os.environ.items() if not name.startswith(("PMI_", "OMPI_", "SLURM_"))}
        return subprocess.Popen(words, cwd=folder, stdout=log, stderr=subprocess.STDOUT, env=alone)


def _stop(running: list[_Running]) -> None:
    """Ask runs to end, and wait for them."""
    for job in running:
        if job.process.poll() is None:
            job.process.send_signal(signal.SIGINT)
    for job in running:
        try:
            job.process.wait(_GRACE)
        except subprocess.TimeoutExpired:
            job.process.kill()
            job.process.wait()
