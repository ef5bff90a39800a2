"""The cache of machine code: its folders depend on all that the code depends on, and lie where one can write."""

import contextlib
import importlib
import os
import pkgutil
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from numba.core.runtime import _nrt_python

import periporo
from periporo.core.numerics import jit, lean

COMPILED = Dispatcher | jit.Inlined


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A program of four files, law -> algebra, plane -> step -> algebra, and a plugin, law -> help and algebra."""
    for name, text in {
        "core/algebra.py": "x = 1\n",
        "core/step.py": "def later():\n    from periporo.core import algebra as la, other\n",
        "materials/law.py": "from periporo.core.algebra import (\n    x,\n)\n",
        "contact/plane.py": "import periporo.core.step\n",
        "plug/__init__.py": "",
        "plug/help.py": "y = 1\n",
        "plug/law.py": "from . import help\nfrom periporo.core.algebra import x\n",
        "plug/spare.py": "",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(jit, "_PACKAGE", tmp_path)
    return tmp_path


REACHED = {
    "core/algebra.py": {"core/algebra.py", "core/step.py", "materials/law.py", "contact/plane.py", "plug/law.py"},
    "core/step.py": {"core/step.py", "contact/plane.py"},
    "materials/law.py": {"materials/law.py"},
    "plug/help.py": {"plug/help.py", "plug/law.py"},
    "plug/spare.py": {"plug/spare.py"},
}


@pytest.mark.parametrize("changed", REACHED)
def test_machine_code_follows_every_source_that_it_depends_on_and_no_other(package, changed):
    def names():
        forget_files()
        return {str(p.relative_to(package)): jit._digest(jit.sources_of(p)) for p in package.rglob("*.py")}

    before = names()
    (package / changed).write_text((package / changed).read_text() + "z = 2\n")
    after = names()
    assert {name for name in before if before[name] != after[name]} == REACHED[changed]


def forget_files():
    """Have sources looked at anew, which do not change while a program runs."""
    for known in (jit._content, jit._files_of, jit._imported, jit._root, jit.sources_of):
        known.cache_clear()


def test_fingerprint_of_the_program_follows_its_sources_the_compiler_and_the_processor(package, monkeypatch):
    seen = {jit.program_fingerprint()}
    for changed in ("core/step.py", "materials/law.py", "contact/plane.py"):
        (package / changed).write_text("x = 2\n")
        forget_files()
        seen.add(jit.program_fingerprint())
    monkeypatch.setattr(jit.numba, "__version__", "0.0")
    seen.add(jit.program_fingerprint())
    monkeypatch.setattr(jit.numba_config, "CPU_NAME", "generic-1")
    seen.add(jit.program_fingerprint())
    monkeypatch.setattr(jit.numba_config, "CPU_FEATURES", "+avx")
    seen.add(jit.program_fingerprint())
    assert len(seen) == 7 and jit.processor() == ("generic-1", "+avx")


def test_what_processors_have_in_common():
    processors = [("znver3", "+avx,+avx2,-avx512f,+fma"), ("haswell", "+avx,+avx2,+fma,+rtm")]
    assert jit.common_processor(processors) == ("generic", "+avx,+avx2,+fma")
    assert jit.common_processor([("haswell", "+fma,+avx"), ("haswell", "+avx,-fma")]) == ("haswell", "+avx")
    with pytest.raises(RuntimeError, match="set up for this processor already"):
        jit.compile_for("generic", "")


def test_kernels_call_only_what_is_inlined():
    """Or the last bit would depend on whether a kernel was compiled or came from the cache."""
    found = []
    for module in pkgutil.walk_packages(periporo.__path__, "periporo."):
        if module.name.startswith(("periporo.core", "periporo.materials", "periporo.contact")):
            found += [f for f in vars(importlib.import_module(module.name)).values() if isinstance(f, COMPILED)]
    assert len(found) > 100
    calls = {(f.__name__, called.__name__): called for f in found for called in called_by(f.py_func)}
    assert len(calls) > 30
    assert not [names for names, called in calls.items() if not isinstance(called, jit.Inlined)]


def called_by(function):
    """What a compiled function names of others, of its own module or another."""
    names, scope = function.__code__.co_names, function.__globals__
    places = [scope, *(vars(scope[name]) for name in names if isinstance(scope.get(name), ModuleType))]
    return [place[name] for name in names for place in places if isinstance(place.get(name), COMPILED)]


def test_the_cache_is_cold_until_a_run_has_compiled(monkeypatch, tmp_path):
    monkeypatch.setattr(jit, "CACHE_ROOT", tmp_path)
    monkeypatch.setattr(jit, "READY_MADE", None)
    assert not jit.cache_is_warm()
    jit.remember_warm()
    assert jit.cache_is_warm()


def test_an_unwritable_home_falls_back_to_the_temporary_folder(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PERIPORO_CACHE", str(tmp_path / "file"))  # below a file nobody can make a folder
    monkeypatch.setattr(jit.tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    assert jit._writable_root() == tmp_path / "temporary" / f"periporo-{os.getuid()}"
    monkeypatch.setattr(jit.tempfile, "gettempdir", lambda: str(tmp_path / "file"))
    with pytest.raises(OSError, match="no folder for compiled kernels"):
        jit._writable_root()


def test_the_temporary_folder_must_be_ours_alone(monkeypatch, tmp_path):
    """Machine code is loaded and carried out: what others could have put there is refused."""
    monkeypatch.setenv("PERIPORO_CACHE", "/dev/null/cache")
    monkeypatch.setattr(jit.tempfile, "gettempdir", lambda: str(tmp_path))
    ours = tmp_path / f"periporo-{os.getuid()}"
    assert jit._writable_root() == ours and ours.stat().st_mode & 0o777 == 0o700
    ours.chmod(0o755)  # others can read it, which does no harm
    assert jit._writable_root() == ours and ours.stat().st_mode & 0o777 == 0o700
    for mode in (0o770, 0o722, 0o777):
        ours.chmod(mode)
        with pytest.raises(OSError, match="others can write to it; remove it, or name a folder in PERIPORO_CACHE"):
            jit._writable_root()
    ours.rmdir()
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    ours.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="it is a link, or belongs to another user"):
        jit._writable_root()
    ours.unlink()
    ours.mkdir(mode=0o700)
    monkeypatch.setattr(jit.os, "getuid", lambda: 12345)
    with pytest.raises(OSError, match="it is a link, or belongs to another user"):
        jit._make_private(ours)


def test_pruning_deletes_what_was_not_used_for_a_month(tmp_path):
    for name, days in {"old": 40, "older": 400, "recent": 20}.items():
        (tmp_path / name).mkdir()
        then = time.time() - days * 86400
        os.utime(tmp_path / name, (then, then))
    jit._prune(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["recent"]


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
        "import numpy as np\nfrom periporo.core.numerics import jit\n\n\n"
        "@jit.kernel\ndef twice(x):\n    x[0] *= 2.0\n\n\n"
        "twice(np.ones(1))\nprint(len(twice.stats.cache_hits), jit.CACHE_ROOT)\n"
    )
    environment = os.environ | {"PERIPORO_CACHE": str(tmp_path / "cache")}
    runs = [subprocess.run([sys.executable, str(script)], env=environment, capture_output=True, text=True,
                           timeout=120, check=True).stdout.split() for _ in range(2)]  # fmt: skip
    assert [hits for hits, _ in runs] == ["0", "1"]
    assert any(Path(runs[0][1]).rglob("script.twice*"))


TWICE = """
import resource, sys, tempfile
import numpy as np

def refuse(dir, make=tempfile.TemporaryFile):
    if str(dir).startswith(sys.argv[1]):
        raise PermissionError(13, "Permission denied")
    return make(dir=dir)

if sys.argv[2] == "read-only":
    tempfile.TemporaryFile = refuse
from periporo.core.numerics import jit
if sys.argv[2] == "full":
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
if sys.argv[2] == "renamed":
    from numba.core.caching import Cache
    Cache.load_known = Cache._load_overload
    Cache.load_overload = lambda self, signature, context: (context.refresh(), self.load_known(signature, context))[1]
    del Cache._load_overload

@jit.kernel
def twice(x):
    x[0] *= 2.0

x = np.ones(1)
twice(x)
print(x[0], len(twice.stats.cache_hits), jit.CACHE_ROOT, jit.remarks, "numba.np.linalg" in sys.modules, sep="|")
"""


@pytest.fixture
def process(tmp_path):
    """The function that compiles a kernel in a process of its own, in a way: result, hits, folder, remarks."""
    script, cache = tmp_path / "script.py", tmp_path / "cache"
    script.write_text(TWICE)
    (tmp_path / "temporary").mkdir()
    environment = os.environ | {"PERIPORO_CACHE": str(cache), "TMPDIR": str(tmp_path / "temporary")}

    def run(way):
        done = subprocess.run([sys.executable, str(script), str(cache), way], env=environment, capture_output=True,
                              text=True, timeout=120)  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout.strip().split("|")

    return run


def test_a_full_disk_costs_a_remark(process):
    result, hits, _, remarks, _ = process("full")
    assert (result, hits) == ("2.0", "0") and "cannot be kept in" in remarks and "File too large" in remarks


def test_a_cache_that_lies_ready_is_used_though_it_cannot_be_written(process, tmp_path):
    assert process("plain")[:2] == ["2.0", "0"]
    result, hits, folder, remarks, _ = process("read-only")
    assert (result, hits) == ("2.0", "1") and folder.startswith(str(tmp_path / "temporary")) and remarks == "[]"


def test_a_kernel_that_comes_from_the_cache_does_not_set_up_the_compiler(process):
    assert [process("plain")[-1] for _ in range(2)] == ["True", "False"]


def test_kernels_work_with_a_numba_that_lacks_a_name(process):
    for expected in ("0", "1"):
        result, hits, _, remarks, compiler = process("renamed")
        assert (result, hits, compiler) == ("2.0", expected, "True")
        assert "loads machine code in another way" in remarks and "_load_overload" in remarks


@pytest.fixture
def numba_cache():
    """A kernel's cache with the names that numba's has; it answers what it was asked by numba's own way."""
    cache = SimpleNamespace(
        load_overload=lambda *what: ("own way", *what), _load_overload=lambda *what: ("alone", *what),
        save_overload=lambda *what: None, _guard_against_spurious_io_errors=contextlib.nullcontext,
        _impl=SimpleNamespace(reduce=lambda whole: whole),
    )  # fmt: skip
    return SimpleNamespace(_cache=cache)


LACKS = {
    "load_overload": "_cache", "_load_overload": "_cache", "save_overload": "_cache", "_impl": "_cache",
    "_guard_against_spurious_io_errors": "_cache", "_cache": None,
}  # fmt: skip


@pytest.mark.parametrize("name", LACKS)
def test_a_numba_that_lacks_a_name_goes_its_own_way_and_is_remarked(numba_cache, name):
    holder = numba_cache if LACKS[name] is None else numba_cache._cache
    delattr(holder, name)
    before, said = dict(vars(holder)), []
    lean.make_lean(numba_cache, None, said.append)
    assert vars(holder) == before
    assert len(said) == 1 and f"'{name}'" in said[0] and "kernels work" in said[0]


def test_a_numba_whose_names_mean_another_thing_goes_its_own_way_and_is_remarked(numba_cache, monkeypatch):
    said = []
    lean.make_lean(numba_cache, None, said.append)
    cache = numba_cache._cache
    described = SimpleNamespace(llvm_cpython_wrapper_name="entry")
    known = ("name", "object", (b"code", b"bitcode")), described, "more", ()
    (name, kind, (code, stub)), *_ = cache._impl.reduce(known)
    assert (name, kind, code) == ("name", "object", b"code") and stub != b"bitcode" and not said
    for other in ((b"code", *known[1:]), (known[0], SimpleNamespace(), "more", ()), (*known, 7), known[:1]):
        assert cache._impl.reduce(other) is other
    assert cache.load_overload(1, 2) == ("alone", 1, 2)
    count = len(said)
    assert count == 4
    monkeypatch.delattr(_nrt_python, "c_helpers")
    lean._tell_runtime.cache_clear()
    assert cache.load_overload(1, 2) == ("own way", 1, 2)
    assert len(said) == count + 1 and "c_helpers" in said[-1]
