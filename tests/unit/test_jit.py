"""The cache of machine code: its folder depends on all that the code depends on, and is found where one can write."""

import importlib
import os
import pkgutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

import periporo
from periporo.core import jit


def fingerprint_with(monkeypatch, package):
    monkeypatch.setattr(jit, "_PACKAGE", package)
    return jit._fingerprint()


@pytest.fixture
def package(tmp_path):
    for folder in ("core", "materials/inner", "contact", "io"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "source.py").write_text("x = 1\n")
    return tmp_path


@pytest.mark.parametrize("changed", ["core/source.py", "materials/inner/source.py", "contact/source.py"])
def test_fingerprint_follows_every_source_of_kernels(monkeypatch, package, changed):
    before = fingerprint_with(monkeypatch, package)
    assert fingerprint_with(monkeypatch, package) == before
    (package / changed).write_text("x = 2\n")
    assert fingerprint_with(monkeypatch, package) != before


def test_fingerprint_follows_the_compiler_and_the_processor(monkeypatch):
    before = jit._fingerprint()
    monkeypatch.setattr(jit.numba, "__version__", "0.0")
    assert jit._fingerprint() != before
    monkeypatch.undo()
    monkeypatch.setattr(jit.numba_config, "CPU_NAME", "generic-1")
    assert jit._fingerprint() != before


def test_kernels_call_only_what_is_inlined():
    """Or the last bit would depend on whether a kernel was compiled or came from the cache."""
    found = []
    for module in pkgutil.walk_packages(periporo.__path__, "periporo."):
        if module.name.startswith(("periporo.core", "periporo.materials", "periporo.contact")):
            found += [f for f in vars(importlib.import_module(module.name)).values() if isinstance(f, Dispatcher)]
    assert len(found) > 100
    calls = {(f.__name__, called.__name__): called for f in found for called in called_by(f.py_func)}
    assert len(calls) > 30
    assert not [names for names, called in calls.items() if not called.targetoptions.get("forceinline")]


def called_by(function):
    """What a compiled function names of others, of its own module or another."""
    names, scope = function.__code__.co_names, function.__globals__
    places = [scope, *(vars(scope[name]) for name in names if isinstance(scope.get(name), ModuleType))]
    return [place[name] for name in names for place in places if isinstance(place.get(name), Dispatcher)]


def test_folder_is_cold_once_and_warm_when_it_holds_something(monkeypatch, tmp_path):
    monkeypatch.setenv("PERIPORO_CACHE", str(tmp_path))
    folder, warm = jit._cache_folder()
    assert folder.parent == tmp_path and folder.is_dir() and not warm
    (folder / "kernel").write_text("")
    assert jit._cache_folder() == (folder, True)


def test_an_unwritable_home_falls_back_to_the_temporary_folder(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PERIPORO_CACHE", str(tmp_path / "file"))  # below a file nobody can make a folder
    monkeypatch.setattr(jit.tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    folder, _ = jit._cache_folder()
    assert folder.parent == tmp_path / "temporary" / f"periporo-{os.getuid()}"
    monkeypatch.setattr(jit.tempfile, "gettempdir", lambda: str(tmp_path / "file"))
    with pytest.raises(OSError, match="no folder for compiled kernels"):
        jit._cache_folder()


def test_pruning_keeps_the_newest_and_whatever_is_in_use(tmp_path):
    for k in range(8):
        (tmp_path / f"old{k}").mkdir()
        os.utime(tmp_path / f"old{k}", (1e9 + k, 1e9 + k))
    current = tmp_path / "current"
    current.mkdir()
    (tmp_path / "recent").mkdir()  # another version, in use right now
    jit._prune(tmp_path, current)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["current", "old5", "old6", "old7", "recent"]


@jit.kernel
def _add(values, total):
    for value in values:
        total[0] += value


def test_kernels_keep_the_order_of_sums_and_show_nan():
    values = np.array([1e16, 1.0, -1e16, 1.0])
    total = np.zeros(1)
    _add(values, total)
    assert total[0] == ((1e16 + 1.0) - 1e16) + 1.0
    _add(np.array([np.nan]), total)
    assert np.isnan(total[0])


def test_machine_code_lies_in_the_folder(tmp_path):
    """A second process finds what the first one compiled."""
    script = tmp_path / "script.py"
    script.write_text(
        "import numpy as np\nfrom periporo.core import jit\n\n\n@jit.kernel\ndef twice(x):\n    x[0] *= 2.0\n\n\n"
        "twice(np.ones(1))\nprint(len(twice.stats.cache_hits), jit.CACHE_FOLDER)\n"
    )
    environment = os.environ | {"PERIPORO_CACHE": str(tmp_path / "cache")}
    runs = [subprocess.run([sys.executable, str(script)], env=environment, capture_output=True, text=True,
                           timeout=120, check=True).stdout.split() for _ in range(2)]  # fmt: skip
    assert [hits for hits, _ in runs] == ["0", "1"]
    assert any(Path(runs[0][1]).rglob("script.twice*"))
