"""Compilation of kernels: one decorator, and a cache that is never stale.

Numba's on-disk cache looks only at the file of the decorated function, so a change in a function it calls
would go unnoticed. Each kernel's folder is therefore named by a hash of everything that its machine code depends on:
its own file, the files of the program and of its own package that this one imports, directly or not, the numba version
and the CPU. What a change does not reach need not be compiled again.
"""

import contextlib
import functools
import hashlib
import os
import re
import shutil
import stat
import tempfile
import time
from importlib import metadata
from pathlib import Path

import llvmlite.binding
import numba
import numba.extending
from numba.core import config as numba_config
from numba.core import types
from numba.core.registry import cpu_target

from periporo.core.numerics.lean import make_lean

_PACKAGE = Path(__file__).resolve().parents[2]
_UNUSED = 30 * 86400.0  # s after which machine code that no process asked for is deleted
_IMPORTS = re.compile(r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([\w.]+))", re.M)

# NaN and infinity stay visible: the flags that assume them away ("nnan", "ninf") are left out. Sums keep the
# order in which they are written ("reassoc" is left out): it decides the last bit, and costs nothing here.
FASTMATH = {"contract", "arcp", "nsz"}


def processor() -> tuple[str, str]:
    """Name and features of the processor that kernels are compiled for: this one's, or what numba is told.

    The variables NUMBA_CPU_NAME and NUMBA_CPU_FEATURES tell it, or `compile_for`.
    """
    name, features = _host()
    chosen = numba_config.CPU_FEATURES
    return numba_config.CPU_NAME or name, features if chosen is None else chosen


@functools.cache
def _host() -> tuple[str, str]:
    """Name and features of this processor."""
    return llvmlite.binding.get_host_cpu_name(), llvmlite.binding.get_host_cpu_features().flatten()


def common_processor(processors: list[tuple[str, str]]) -> tuple[str, str]:
    """Name and features of a processor whose machine code all of the `processors` can run: what they have in common."""
    names = {name for name, _ in processors}
    features = [{f for f in text.split(",") if f.startswith("+")} for _, text in processors]
    return names.pop() if len(names) == 1 else "generic", ",".join(sorted(set.intersection(*features)))


def compile_for(name: str, features: str) -> None:
    """Have kernels compiled for another processor than this one.

    Raises RuntimeError if a module with kernels has been imported, for then the compiler has been set up.
    """
    if "_toplevel_target_context" in vars(cpu_target):
        raise RuntimeError("the compiler is set up for this processor already")
    numba_config.CPU_NAME, numba_config.CPU_FEATURES = name, features


def _machine() -> str:
    """What decides machine code beside the sources: the compiler's version and the processor."""
    return " ".join((numba.__version__, os.uname().machine, *processor()))


def _digest(sources) -> str:
    digest = hashlib.sha256(_machine().encode())
    for source in sources:
        digest.update(_content(source))
    return digest.hexdigest()[:16]


@functools.cache
def _content(source: Path) -> bytes:
    """Hash of a file, which many kernels depend on."""
    return hashlib.sha256(source.read_bytes()).digest()


def program_fingerprint() -> str:
    """Name of all sources with kernels, every installed material plugin, the numba version and the CPU."""
    own = [source for folder in ("core", "materials", "contact") for source in (_PACKAGE / folder).rglob("*.py")]
    points = sorted(metadata.entry_points(group="periporo.materials"), key=lambda p: (p.name, p.value))
    plugins = "".join(f"{p.name}={p.value} {p.dist.version if p.dist else ''}" for p in points)
    return hashlib.sha256((_digest(sorted(own)) + plugins).encode()).hexdigest()[:16]


@functools.cache
def _imported(source: Path) -> frozenset[Path]:
    """Files of the program, and of the package that `source` belongs to, that `source` imports."""
    root = _root(source.parent)
    found: set[Path] = set()
    for module, names, plain in _IMPORTS.findall(source.read_text()):
        below = [re.split(r"\s+as\s+|\s", name.strip())[0] for name in names.strip("()").split(",")]
        for name in (plain or module, *(f"{module.removesuffix('.')}.{name}" for name in below if module and name)):
            dots = len(name) - len(name.lstrip("."))
            parts = [part for part in name.split(".") if part]
            place = source.parents[dots - 1] if dots else root
            if parts[:1] == ["periporo"]:
                place, parts = _PACKAGE, parts[1:]
            found |= _files_of(os.path.join(place, *parts))
    return frozenset(p for p in found if p != source)


@functools.cache
def _root(folder: Path) -> Path:
    """The folder that the package lies in to which a folder belongs."""
    return _root(folder.parent) if (folder / "__init__.py").exists() else folder


@functools.cache
def _files_of(module: str) -> frozenset[Path]:
    """The file of a module or package at a path without its ending; none if it is no module."""
    return frozenset(Path(p) for p in (f"{module}.py", f"{module}/__init__.py") if os.path.isfile(p))


@functools.cache
def sources_of(source: Path) -> tuple[Path, ...]:
    """`source` and all that it imports, directly or not, of the program and of its own package."""
    found, new = set(), {source}
    while new:
        found |= new
        new = set().union(*(_imported(path) for path in new)) - found
    return tuple(sorted(found, key=str))  # paths compare part by part, ten times as slowly


def _home() -> Path:
    """The folder that users name for machine code, or the usual one."""
    named = os.environ.get("PERIPORO_CACHE")
    usual = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(named or os.path.join(usual, "periporo"))


def _writable_root() -> Path:
    """The first folder that machine code can be written to: home, or one of our own in the temporary folder."""
    home, reason = _home(), ""
    with contextlib.suppress(OSError):
        home.mkdir(parents=True, exist_ok=True)
        _try_to_write(home)
        return home
    temporary = Path(tempfile.gettempdir()) / f"periporo-{os.getuid()}"
    try:
        _make_private(temporary)
        _try_to_write(temporary)
        return temporary
    except OSError as error:
        reason = error.strerror or str(error)
    raise OSError(f"no folder for compiled kernels: {home} cannot be written, nor {temporary}: {reason}")


def _try_to_write(folder: Path) -> None:
    with tempfile.TemporaryFile(dir=folder) as file:
        file.write(bytes(4096))


def _make_private(folder: Path) -> None:
    """Make a folder that only we can enter. Raises OSError if others could have put something there.

    Machine code that is loaded is carried out, and anyone can make a folder of this name where all may write.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid():
        raise OSError("it is a link, or belongs to another user; remove it, or name a folder in PERIPORO_CACHE")
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise OSError("others can write to it; remove it, or name a folder in PERIPORO_CACHE")
    folder.chmod(0o700)


def _prune(root: Path) -> None:
    """Delete machine code that has not been asked for in a month."""
    for folder in root.iterdir():
        with contextlib.suppress(OSError):  # another rank may be removing it, too
            if folder.is_dir() and time.time() - folder.stat().st_mtime > _UNUSED:
                shutil.rmtree(folder)


remarks: list[str] = []
"""What went wrong with the cache in this process, for users; kernels work all the same."""


def _remark(text: str) -> None:
    if text not in remarks:
        remarks.append(text)


def _tell_unkept(error: OSError) -> None:
    _remark(f"compiled kernels cannot be kept in {CACHE_ROOT}: {error.strerror}; every run compiles them")


COMPILING = "compiling kernels (once, about half a minute)"

CACHE_ROOT: Path | None = None
"""Where machine code is kept; None if nowhere."""
READY_MADE = _home()
"""Where machine code may lie that we cannot add to, for example in the home of all users of a cluster."""

try:
    CACHE_ROOT = _writable_root()
    _prune(CACHE_ROOT)
except OSError as failure:
    _remark(f"{failure}; every run compiles them")


@functools.cache
def cache_folder(source: Path) -> Path | None:
    """Where machine code of the kernels in the file `source` lies; None if it cannot be kept."""
    if CACHE_ROOT is None:
        return None
    name = _digest(sources_of(source))
    folder = CACHE_ROOT / name
    try:
        if not folder.exists() and READY_MADE != CACHE_ROOT and (READY_MADE / name).is_dir():
            _copy(READY_MADE / name, folder)
        folder.mkdir(exist_ok=True)
        os.utime(folder)
    except OSError as error:
        _tell_unkept(error)
        return None
    return folder


def _copy(ready: Path, folder: Path) -> None:
    """Copy machine code that lies ready, at once, for other ranks may do the same."""
    partial = Path(tempfile.mkdtemp(dir=folder.parent))
    try:
        shutil.copytree(ready, partial, dirs_exist_ok=True)
        partial.chmod(0o700)
        with contextlib.suppress(OSError):  # another rank was quicker
            partial.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def cache_is_warm() -> bool:
    """Whether a run of these sources has compiled its kernels on this processor before."""
    roots = [root for root in (CACHE_ROOT, READY_MADE) if root is not None]
    return any((root / program_fingerprint()).exists() for root in roots)


def remember_warm() -> None:
    """Note that a run has compiled its kernels."""
    if CACHE_ROOT is not None:
        with contextlib.suppress(OSError):  # the next run will say once more that it compiles
            (CACHE_ROOT / program_fingerprint()).mkdir(exist_ok=True)


def kernel(function):
    """Decorator of every compiled loop: explicit arrays in, results written in place."""
    folder = cache_folder(Path(function.__code__.co_filename).resolve())
    if folder is None:
        return numba.njit(fastmath=FASTMATH, error_model="numpy")(function)
    numba_config.CACHE_DIR = str(folder)
    try:
        compiled = numba.njit(cache=True, fastmath=FASTMATH, error_model="numpy")(function)
    except (OSError, RuntimeError):  # the folder cannot be written any more: numba finds "no locator"
        _remark(f"compiled kernels cannot be kept in {CACHE_ROOT}; every run compiles them")
        return numba.njit(fastmath=FASTMATH, error_model="numpy")(function)
    if not numba_config.DISABLE_JIT:  # which leaves functions as they are, for a debugger
        make_lean(compiled, _tell_unkept, _remark)
    return compiled


class Inlined:
    """A function that kernels compile; Python calls it as it is written."""

    def __init__(self, function):
        functools.update_wrapper(self, function)
        self.py_func = function

    def __call__(self, *arguments):
        return self.py_func(*arguments)

    @functools.cached_property
    def compiled(self):
        """What the compiler wants, made when it asks: kernels that come from the cache want none."""
        return numba.njit(
            fastmath=FASTMATH, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True
        )(self.py_func)


@numba.extending.typeof_impl.register(Inlined)
def _type_of(value, context):
    return types.Dispatcher(value.compiled)


def inlined(function):
    """Decorator of functions that kernels call; nothing else may be called.

    A call that is left in the machine code goes to the copy in the kernel's own module if that comes from the cache,
    and to one that was optimised apart if it was compiled in this process. They may round differently. What Python
    would need to call machine code is left out, for it takes a third of the compiler's time.
    """
    return function if numba_config.DISABLE_JIT else Inlined(function)


overload = functools.partial(numba.extending.overload, jit_options={"no_cfunc_wrapper": True})
"""Decorator of what kernels carry out in place of a function, by the types of its arguments; lean as `inlined`."""
