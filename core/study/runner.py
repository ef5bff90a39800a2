"""Runs of the variants side by side, one process for each core; what is finished is not run again."""

import json
import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, cast

import yaml

from periporo.core.study.variants import Study, Variant
from periporo.io.output.results import ResultError, open_results

SCENE, RESULT, LOG = "scene.yaml", "scene.vtkhdf", "log.txt"
_GRACE = 30.0  # s that interrupted runs have for their checkpoints


class _Worker:
    """A process that runs one variant after the other, each in a folder of its own."""

    def __init__(self):
        alone = {name: value for name, value in os.environ.items() if not name.startswith(("PMI_", "OMPI_", "SLURM_"))}
        words, pipe = [sys.executable, "-m", "periporo.core.worker"], subprocess.PIPE
        self.process = subprocess.Popen(words, stdin=pipe, stdout=pipe, text=True, env=alone)
        self.answers = cast(IO[str], self.process.stdout)
        self.began = 0.0

    def begin(self, folder: Path, variant: Variant) -> None:
        """Have a variant run, or the rest of it; a changed one starts anew."""
        how = "--resume" if _is_same(folder, variant) else "--overwrite"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / SCENE).write_text(_text(variant))
        self.began = time.monotonic()
        line = json.dumps([str(folder.resolve()), LOG, "run", SCENE, how, "--quiet", "--no-plot"])
        print(line, file=self.process.stdin, flush=True)

    def end(self) -> None:
        """Wait for the process, which ends when nothing more is asked of it."""
        try:
            self.process.communicate(timeout=_GRACE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()


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
    workers = [_Worker() for _ in range(min(cores, len(waiting)))]
    failed: list[str] = []
    try:
        for worker, variant, fine in _carried_out(workers, waiting, folder):
            done += 1
            told = f"{time.monotonic() - worker.began:.0f} s"
            if not fine:
                failed.append(variant.name)
                told = f"failed, see {folder / variant.name / LOG}"
            say(f"{done}/{total} {variant.name}: {told}")
    except BaseException:
        for worker in workers:
            worker.process.send_signal(signal.SIGINT)
        raise
    finally:
        for worker in workers:
            worker.end()
    return failed


def _carried_out(
    workers: list[_Worker], waiting: list[Variant], folder: Path
) -> Iterator[tuple[_Worker, Variant, bool]]:
    """Worker and variant of each run that has ended, and whether it succeeded; a process that died is replaced."""
    idle = list(range(len(workers)))
    with selectors.DefaultSelector() as busy:
        while waiting or busy.get_map():
            while waiting and idle:
                k, variant = idle.pop(0), waiting.pop(0)
                workers[k].begin(folder / variant.name, variant)
                busy.register(workers[k].answers, selectors.EVENT_READ, (k, variant))
            for key, _ in busy.select():
                k, variant = key.data
                busy.unregister(key.fileobj)
                answer = workers[k].answers.readline()
                yield workers[k], variant, answer == "0\n"
                if not answer and waiting:
                    workers[k].end()
                    workers[k] = _Worker()
                idle.append(k)


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
