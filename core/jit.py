"""Compilation of kernels: one decorator, and a cache that is never stale.

Numba's on-disk cache looks only at the file of the decorated function, so a change in a function it calls
would go unnoticed. The cache folder is therefore named by a hash of everything that the machine code
depends on: our sources, every installed material plugin, the numba version and the CPU.
"""

import hashlib
import os
import shutil
import tempfile
import time
from importlib import metadata
from pathlib import Path

import numba
from numba.core import config as numba_config

_PACKAGE = Path(__file__).resolve().parent.parent
_KEEP = 4  # cache folders of other versions that are kept

# NaN and infinity stay visible: the flags that assume them away ("nnan", "ninf") are left out. Sums keep the
# order in which they are written ("reassoc" is left out): it decides the last bit, and costs nothing here.
FASTMATH = {"contract", "arcp", "nsz"}


def _fingerprint() -> str:
    digest = hashlib.sha256()
    for folder in ("core", "materials", "contact"):
        for source in sorted((_PACKAGE / folder).rglob("*.py")):
            digest.update(source.read_bytes())
    for point in sorted(metadata.entry_points(group="periporo.materials"), key=lambda p: (p.name, p.value)):
        version = point.dist.version if point.dist else ""
        digest.update(f"{point.name}={point.value} {version}".encode())
    cpu = f"{numba_config.CPU_NAME} {os.uname().machine}"
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        cpu += next((line for line in lines if line.startswith("flags")), "")
    digest.update(f"{numba.__version__} {cpu}".encode())
    return digest.hexdigest()[:16]


def _cache_folder() -> tuple[Path, bool]:
    """The folder of this version's machine code, and whether it held any before."""
    home = os.environ.get("PERIPORO_CACHE") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "periporo"
    )
    for root in (Path(home), Path(tempfile.gettempdir()) / f"periporo-{os.getuid()}"):
        folder = root / _fingerprint()
        warm = folder.is_dir() and any(folder.iterdir())
        try:
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError:
            continue
        _prune(root, folder)
        return folder, warm
    raise OSError(f"no folder for compiled kernels: neither {home} nor the temporary folder can be written")


def _prune(root: Path, current: Path) -> None:
    others = sorted((p for p in root.iterdir() if p.is_dir() and p != current), key=lambda p: p.stat().st_mtime)
    for old in others[:-_KEEP]:
        if time.time() - old.stat().st_mtime > 3600:
            shutil.rmtree(old, ignore_errors=True)  # another rank may be removing it, too


COMPILING = "compiling kernels (once, about half a minute)"

CACHE_FOLDER, CACHE_IS_WARM = _cache_folder()
numba_config.CACHE_DIR = str(CACHE_FOLDER)

kernel = numba.njit(cache=True, fastmath=FASTMATH, error_model="numpy")
"""Decorator of every compiled loop: explicit arrays in, results written in place."""

inlined = numba.njit(fastmath=FASTMATH, error_model="numpy", forceinline=True)
"""Decorator of functions that kernels call; nothing else may be called.

A call that is left in the machine code goes to the copy in the kernel's own module if that comes from the cache, and to
one that was optimised apart if it was compiled in this process. They may round differently.
"""
