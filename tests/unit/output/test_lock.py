"""Two runs never write one result file."""

import os
import signal
import subprocess
import sys
import time

import pytest

from periporo.errors import OutputError
from periporo.io.output.lock import Lock, Locked
from periporo.io.output.vtkhdf import ResultFile

HOLD = """
import sys, time
from pathlib import Path
from periporo.io.output.lock import Lock
Lock(Path(sys.argv[1]))
print("held", flush=True)
time.sleep(100)
"""


def result(path, **options):
    return ResultFile(path, 2, {}, history_units={}, overwrite=True, **{"resume_step": None} | options)


def test_a_lock_keeps_others_out_until_it_is_released(tmp_path):
    path = tmp_path / "run.h5"
    lock = Lock(path)
    with pytest.raises(Locked, match=f"process {os.getpid()} on "):
        Lock(path)
    lock.release()
    assert not list(tmp_path.iterdir())
    Lock(path).release()


def test_a_lock_ends_with_its_process(tmp_path):
    path = tmp_path / "run.h5"
    with subprocess.Popen([sys.executable, "-c", HOLD, path], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "held\n"
        with pytest.raises(Locked, match=f"process {other.pid} on "):
            Lock(path)
        other.send_signal(signal.SIGKILL)
    patience = time.monotonic() + 10
    while True:
        try:
            Lock(path).release()
            break
        except Locked:
            assert time.monotonic() < patience
            time.sleep(0.01)


def test_a_result_file_that_is_written_is_neither_replaced_nor_resumed(tmp_path):
    path = tmp_path / "run.h5"
    first = result(path)
    before = path.stat().st_ino
    for options in ({}, {"resume_step": 0}):
        with pytest.raises(OutputError, match="run.h5 is being written by another run"):
            result(path, **options)
    assert path.stat().st_ino == before
    first.close()
    assert [p.name for p in tmp_path.iterdir()] == ["run.h5"]
    result(path, resume_step=0).close()


def test_a_file_that_cannot_be_resumed_is_not_left_locked(tmp_path):
    with pytest.raises(OutputError, match="does not exist"):
        result(tmp_path / "run.h5", resume_step=0)
    assert not list(tmp_path.iterdir())
