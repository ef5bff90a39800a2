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
import tempfile
import time
from importlib import metadata
from pathlib import Path

import numba
from numba.core import config as numba_config

_PACKAGE = Path(__file__).resolve().parents[2]
_UNUSED = 30 * 86400.0  # s after which machine code that no process asked for is deleted
_IMPORTS = re.compile(r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([\w.]+))", re.M)

# NaN and infinity stay visible: the flags that assume them away ("nnan", "ninf") are left out. Sums keep the
# order in which they are written ("reassoc" is left out): it decides the last bit, and costs nothing here.
FASTMATH = {"contract", "arcp", "nsz"}


def _machine() -> str:
    """What decides machine code beside the sources: the compiler's version and the processor."""
    cpu = f"{numba_config.CPU_NAME} {os.uname().machine}"
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        cpu += next((line for line in lines if line.startswith("flags")), "")
    return f"{numba.__version__} {cpu}"


def _digest(sources) -> str:
    digest = hashlib.sha256(_machine().encode())
    for source in sources:
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def program_fingerprint() -> str:
    """Name of all sources with kernels, every installed material plugin, the numba version and the CPU."""
    own = [source for folder in ("core", "materials", "contact") for source in (_PACKAGE / folder).rglob("*.py")]
    points = sorted(metadata.entry_points(group="periporo.materials"), key=lambda p: (p.name, p.value))
    plugins = "".join(f"{p.name}={p.value} {p.dist.version if p.dist else ''}" for p in points)
    return hashlib.sha256((_digest(sorted(own)) + plugins).encode()).hexdigest()[:16]


@functools.cache
def _imported(source: Path) -> frozenset[Path]:
    """Files of the program, and of the package that `source` belongs to, that `source` imports."""
    root = source.parent
    while (root / "__init__.py").exists():
        root = root.parent
    found = set()
    for module, names, plain in _IMPORTS.findall(source.read_text()):
        below = [re.split(r"\s+as\s+|\s", name.strip())[0] for name in names.strip("()").split(",")]
        for name in (plain or module, *(f"{module.removesuffix('.')}.{name}" for name in below if module and name)):
            dots = len(name) - len(name.lstrip("."))
            parts = [part for part in name.split(".") if part]
            place = source.parents[dots - 1] if dots else root
            if parts[:1] == ["periporo"]:
                place, parts = _PACKAGE, parts[1:]
            path = place.joinpath(*parts)
            found |= {p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()}
    return frozenset(p for p in found if p != source)


@functools.cache
def sources_of(source: Path) -> tuple[Path, ...]:
    """`source` and all that it imports, directly or not, of the program and of its own package."""
    found, new = set(), {source}
    while new:
        found |= new
        new = set().union(*(_imported(path) for path in new)) - found
    return tuple(sorted(found))


def _writable_root() -> Path:
    home = os.environ.get("PERIPORO_CACHE") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "periporo"
    )
    for root in (Path(home), Path(tempfile.gettempdir()) / f"periporo-{os.getuid()}"):
        try:
            root.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=root):
                pass
        except OSError:
            continue
        return root
    raise OSError(f"no folder for compiled kernels: neither {home} nor the temporary folder can be written")


def _prune(root: Path) -> None:
    """Delete machine code that has not been asked for in a month."""
    for folder in root.iterdir():
        with contextlib.suppress(OSError):  # another rank may be removing it, too
            if folder.is_dir() and time.time() - folder.stat().st_mtime > _UNUSED:
                shutil.rmtree(folder)


@functools.cache
def cache_folder(source: Path) -> Path:
    """Where machine code of the kernels in the file `source` lies."""
    folder = CACHE_ROOT / _digest(sources_of(source))
    folder.mkdir(exist_ok=True)
    os.utime(folder)
    return folder


COMPILING = "compiling kernels (once, about half a minute)"

CACHE_ROOT = _writable_root()
_prune(CACHE_ROOT)


def cache_is_warm() -> bool:
    """Whether a run of these sources has compiled its kernels on this processor before."""
    return (CACHE_ROOT / program_fingerprint()).exists()


def remember_warm() -> None:
    """Note that a run has compiled its kernels."""
    (CACHE_ROOT / program_fingerprint()).mkdir(exist_ok=True)


def kernel(function):
    """Decorator of every compiled loop: explicit arrays in, results written in place."""
    numba_config.CACHE_DIR = str(cache_folder(Path(function.__code__.co_filename).resolve()))
    return numba.njit(cache=True, fastmath=FASTMATH, error_model="numpy")(function)


inlined = numba.njit(fastmath=FASTMATH, error_model="numpy", forceinline=True)
"""Decorator of functions that kernels call; nothing else may be called.

A call that is left in the machine code goes to the copy in the kernel's own module if that comes from the cache, and to
one that was optimised apart if it was compiled in this process. They may round differently.
"""
